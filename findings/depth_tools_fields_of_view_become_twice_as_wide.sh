#!/usr/bin/env bash
# depth-tools 0.8.0: `CameraIntrinsics.from_fov(width=..., height=..., fov_rad=..., fov_x=True)` is documented to
# calculate the intrinsics from a field of view. The focal length is half of the width divided by the tangent of half
# the angle. The library multiplies half of the width by the cosine of half the angle. Nothing warns. So the focal
# length is too small, by the sine of half the angle: for 60 degrees, it is half of the true one. A point cloud of a
# depth image by `depth_2_point_cloud` becomes twice as wide, and the field of view 98 degrees. No angle can give a
# focal length above half of the width.
# Prints focal lengths, fields of view and the width of a wall, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
pip=("$folder/venv/bin/pip" --quiet --disable-pip-version-check install)
"${pip[@]}" 'depth-tools==0.8.0' 'numpy==2.4.6' 'typing-extensions==4.16.0' 'matplotlib==3.11.2'
cd "$folder"
MPLCONFIGDIR="$folder" "$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
from depth_tools import CameraIntrinsics, CoordSys, depth_2_point_cloud

WIDTH, HEIGHT, DEPTH = 640, 480, 2.0
ok = True
for degrees in (20.0, 60.0, 120.0):
    angle = np.radians(degrees)
    camera = CameraIntrinsics.from_fov(width=WIDTH, height=HEIGHT, fov_rad=angle, fov_x=True)
    truth = WIDTH / 2.0 / np.tan(angle / 2.0)
    seen = float(2.0 * np.degrees(np.arctan(WIDTH / 2.0 / camera.f_x)))
    depth = np.full((1, HEIGHT, WIDTH), DEPTH, np.float32)
    mask = np.ones_like(depth, bool)
    frame = CoordSys.LH_YUp
    cloud = depth_2_point_cloud(depth_map=depth, depth_mask=mask, intrinsics=camera, out_coord_sys=frame)
    width, true_width = float(np.ptp(cloud[:, 0])), (WIDTH - 1) * DEPTH / truth
    print(f"{degrees:g} degrees: focal length {camera.f_x:.1f} px, true {truth:.1f}; field of view {seen:.1f} degrees;",
          f"a wall at {DEPTH:g} m is {width:.2f} m wide, true {true_width:.2f}")
    ok &= abs(camera.f_x / truth - np.sin(angle / 2.0)) < 1e-9 and width > 1.1 * true_width
sys.exit(not ok)
PY
