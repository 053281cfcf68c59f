#!/usr/bin/env bash
# OpenCV 5.0.0.93: `fisheye.undistortPoints` clips the *distorted* angle to 90 degrees, though only the angle of the ray
# is bounded by it. A lens whose coefficients enlarge the angle, as a stereographic fisheye does, passes 90 degrees of
# distorted angle at 77 degrees from the axis already. From there on, points of `fisheye.projectPoints` come back with
# wrong angles, without an error: 88 degrees as 79. COLMAP (pycolmap 4.2.1, the model OPENCV_FISHEYE, the same
# coefficients) projects to the same pixels, and returns the true angles.
# Upstream: the issue github.com/opencv/opencv/issues/26174 and the open pull request 27199.
# Prints the angles that both return, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'opencv-python-headless==5.0.0.93' \
  'pycolmap==4.2.1' 'numpy==2.4.6'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import cv2
import numpy as np
import pycolmap

k = np.array((1 / 12, 1 / 120, 17 / 20160, 31 / 362880))  # 2 tan(a / 2), the stereographic lens, to the ninth power
K = np.array(((300.0, 0.0, 640.0), (0.0, 300.0, 480.0), (0.0, 0.0, 1.0)))
camera = pycolmap.Camera(model="OPENCV_FISHEYE", width=1280, height=960, params=[300, 300, 640, 480, *k])
rows = []
for degrees in (30, 60, 76, 77, 80, 88):
    a = np.radians(degrees)
    point = np.array((0.8 * np.sin(a), 0.6 * np.sin(a), np.cos(a)))
    pixel = cv2.fisheye.projectPoints(point.reshape(1, 1, 3), np.zeros(3), np.zeros(3), K, k)[0]
    same = np.abs(pixel.ravel() - camera.img_from_cam(point.reshape(1, 3)).ravel()).max() < 1e-6
    by_opencv = cv2.fisheye.undistortPoints(pixel, K, k).ravel()
    by_colmap = camera.cam_from_img(pixel.reshape(1, 2)).ravel()
    angles = [np.degrees(np.arctan(np.hypot(*ray))) for ray in (by_opencv, by_colmap)]
    print(f"{degrees} degrees, at pixel ({pixel[0, 0, 0]:.1f}, {pixel[0, 0, 1]:.1f}) in both: {same};",
          f"OpenCV returns {angles[0]:.3f}, COLMAP {angles[1]:.3f}")
    rows.append((degrees, same, *angles))
near, far = rows[:3], rows[3:]
ok = all(same and abs(colmap - true) < 1e-6 for true, same, _, colmap in rows)
ok &= all(abs(opencv - true) < 1e-6 for true, _, opencv, _ in near)
sys.exit(not (ok and all(true - opencv > 0.5 for true, _, opencv, _ in far) and abs(rows[-1][2] - 78.78) < 0.01))
PY
