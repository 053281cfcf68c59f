#!/usr/bin/env bash
# dscamera 0.0.4: a `DSCamera` is a double sphere camera with a field of view `fov` in degrees. `world2cam` takes points
# "in camera coordinate", and returns their pixels and a mask of those that are valid. To test the angle from the
# optical axis, the library compares z with the cosine of half the field of view. But z is a length, and a cosine for
# points at the distance 1 alone. Nothing warns. For 120 degrees, a point 0.3 m straight ahead is not valid, and one at
# 80 degrees, 10 m away, is. `to_perspective` gives it points that are tens of units away, so its image is never cut.
# Law: the pixel of a point, and whether a camera sees it, depend on its direction alone. The library's own `cam2world`
# says of the same pixels whether they are in the field of view.
# Upstream: the open issue github.com/matsuren/dscamera/issues/3 asks if other fields of view give valid results.
# Points divided by their distance get the right mask. For 180 degrees, the default, the cosine is zero, and all do.
# Prints both masks for five distances, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'dscamera==0.0.4' 'numpy==2.4.6' \
  'opencv-python-headless==4.12.0.88' --no-deps
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
from dscamera import DSCamera

LENS = {"fx": 180.0, "fy": 180.0, "cx": 320.0, "cy": 240.0, "xi": -0.2, "alpha": 0.57}
ANGLES = np.array((0.0, 30.0, 55.0, 65.0, 80.0))  # from the optical axis, in degrees
x, z = np.sin(np.radians(ANGLES)), np.cos(np.radians(ANGLES))
DIRECTIONS = np.column_stack((x, np.zeros(len(x)), z))
ok = True
for fov in (120.0, 180.0):
    camera = DSCamera(img_size=(480, 640), intrinsic=LENS, fov=fov)
    due = ANGLES <= fov / 2.0
    for distance in (0.1, 0.3, 1.0, 3.0, 10.0):
        pixels, seen = camera.world2cam(distance * DIRECTIONS)
        rays, seen_by_pixel = camera.cam2world([pixels[:, 0], pixels[:, 1]])
        assert np.allclose(rays, DIRECTIONS)
        print(f"field of view {fov:g} degrees, points {distance:g} m away at {ANGLES.astype(int)} degrees:",
              f"world2cam {seen.astype(int)}, cam2world {seen_by_pixel.astype(int)}")
        ok &= np.array_equal(seen_by_pixel, due)
        ok &= np.array_equal(seen, distance * z >= np.cos(np.radians(fov / 2.0)) - 1e-12)
        ok &= np.array_equal(seen, due) == (fov == 180.0 or distance == 1.0)
image = np.full((480, 640), 255, np.uint8)
camera = DSCamera(img_size=(480, 640), intrinsic=LENS, fov=120.0)
u, v = np.meshgrid(np.arange(100) - 50.0, np.arange(100) - 50.0)
angle = np.degrees(np.arctan2(np.hypot(u, v), 10.0))
outside = (camera.to_perspective(image, (100, 100), f=0.1)[angle > 61.0] > 0).mean()
u, v = np.meshgrid((np.arange(512) - 255.5) * np.pi / 256.0, (np.arange(256) - 127.5) * np.pi / 256.0)
angle = np.degrees(np.arccos(np.cos(u) * np.cos(v)))
outside_sphere = (camera.to_equirect(image, (256, 512))[angle > 61.0] > 0).mean()
print(f"filled beyond the field of view of 120 degrees: {outside:.0%} by to_perspective, {outside_sphere:.0%} by",
      "to_equirect")
sys.exit(not (ok and outside > 0.5 and outside_sphere == 0.0))
PY
