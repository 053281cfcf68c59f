#!/usr/bin/env bash
# PoseLib 2.0.5 takes cameras as COLMAP writes them, and knows seven of its lens models. Any other name, as
# RADIAL_FISHEYE or FOV, is accepted, without an exception or a warning. `estimate_absolute_pose` then returns the
# identity, and `info["inliers"]` marks every point as an inlier. Only `num_inliers`, which is zero, tells the failure.
# COLMAP (pycolmap 4.2.1) finds the pose with each of the lenses.
# Upstream: the open issues github.com/PoseLib/PoseLib/issues/34 and 133 ask for more models; neither tells the result.
# Prints the poses by both for each lens, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'poselib==2.0.5' 'pycolmap==4.2.1' 'numpy==2.4.6' \
  'scipy==1.17.1'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
import poselib
import pycolmap
from scipy.spatial.transform import Rotation

LENSES = {
    "OPENCV_FISHEYE": [600.0, 600.0, 640.0, 480.0, 0.02, -0.01, 0.0, 0.0],
    "RADIAL_FISHEYE": [600.0, 640.0, 480.0, 0.02, -0.01],  # the same lens
    "FOV": [600.0, 600.0, 640.0, 480.0, 0.9],
}
rng = np.random.default_rng(0)
points = np.column_stack((rng.uniform(-3, 3, 100), rng.uniform(-2, 2, 100), rng.uniform(4, 9, 100)))
R, t = Rotation.from_rotvec((0.1, -0.2, 0.05)), np.array((0.3, -0.1, 0.2))


def error(quaternion, translation):
    """Of the rotation [degrees] and of the translation [m]."""
    turn = Rotation.from_quat(quaternion) * R.inv()
    return round(float(np.degrees(turn.magnitude())), 2), round(float(np.linalg.norm(translation - t)), 3)


ok = True
for model, parameters in LENSES.items():
    camera = pycolmap.Camera(model=model, width=1280, height=960, params=parameters)
    pixels = np.asarray(camera.img_from_cam(R.apply(points) + t))
    colmap = pycolmap.estimate_and_refine_absolute_pose(pixels, points, camera)["cam_from_world"]
    by_colmap = error(colmap.rotation.quat, colmap.translation)
    as_written = {"model": model, "width": 1280, "height": 960, "params": parameters}
    options = {"max_reproj_error": 2.0, "max_iterations": 1000}
    pose, info = poselib.estimate_absolute_pose(pixels, points, as_written, options, {})
    by_poselib = error(np.roll(pose.q, -1), pose.t)
    marked = int(np.sum(info["inliers"]))
    print(f"{model}: error by COLMAP {by_colmap[0]} degrees and {by_colmap[1]} m,",
          f"by PoseLib {by_poselib[0]} degrees and {by_poselib[1]} m;",
          f"of 100 inliers PoseLib counts {info['num_inliers']} and marks {marked}")
    known = model == "OPENCV_FISHEYE"
    ok &= by_colmap == (0.0, 0.0) and marked == 100 and info["num_inliers"] == (100 if known else 0)
    ok &= by_poselib == (0.0, 0.0) if known else pose.q[0] == 1.0 and not pose.t.any()
sys.exit(not ok)
PY
