#!/usr/bin/env bash
# RealSense SDK (pyrealsense2 2.59.1): the colour images of D400 cameras have the lens `inverse_brown_conrady`. By its
# documentation, this is the Brown-Conrady polynomial that removes distortion, so it takes a pixel to a ray. The SDK
# uses it the other way, from the ray to the pixel, and iterates to find the ray. Rays by the documentation are 11 px
# off in a corner, for the coefficients below. OpenCV's usual model, given the same coefficients, agrees within 0.02 px.
# Upstream: the closed issues github.com/realsenseai/librealsense/issues/6382 and 7335 ask about it. Pull request 8523
# changed the rays and not the text.
# Prints the distances in pixels, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'pyrealsense2==2.59.1.11053' 'numpy==2.4.6' \
  'opencv-python-headless==5.0.0.93' 'libusb-package==1.0.30.0'
cd "$folder"
usb=$(find "$folder/venv" -name 'libusb-1.0.so*' -print -quit) # the SDK's wheel brings none; no device is needed
ln -s "$usb" libusb-1.0.so.0
LD_LIBRARY_PATH="$folder" "$folder/venv/bin/python" - <<'PY'
import sys

import cv2
import numpy as np
import pyrealsense2 as rs

FOCAL, CENTRE = 450.0, np.array((320.0, 240.0))
k1, k2, p1, p2, k3 = coefficients = [-0.05, 0.06, 0.001, -0.0005, -0.02]
lens = rs.intrinsics()
lens.width, lens.height, lens.fx, lens.fy = 640, 480, FOCAL, FOCAL
lens.ppx, lens.ppy = CENTRE.tolist()
lens.model, lens.coeffs = rs.distortion.inverse_brown_conrady, coefficients
K = np.array(((FOCAL, 0.0, CENTRE[0]), (0.0, FOCAL, CENTRE[1]), (0.0, 0.0, 1.0)))
worst = np.zeros(3)
for pixel in np.array(((20.0, 30.0), (320.0, 240.0), (600.0, 400.0), (620.0, 20.0))):
    ray = np.array(rs.rs2_deproject_pixel_to_point(lens, pixel.tolist(), 1.0))
    again = np.array(rs.rs2_project_point_to_pixel(lens, ray.tolist()))
    x, y = (pixel - CENTRE) / FOCAL
    r2 = x * x + y * y
    radial = 1.0 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    tangential = 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x), 2.0 * p2 * x * y + p1 * (r2 + 2.0 * y * y)
    documented, zero = np.multiply((x, y), radial) + tangential, np.zeros(3)
    by_opencv = cv2.projectPoints(ray.reshape(1, 1, 3), zero, zero, K, np.array(coefficients))[0].ravel()
    distances = again - pixel, FOCAL * (ray[:2] - documented), by_opencv - pixel
    worst = np.maximum(worst, np.linalg.norm(distances, axis=1))
print(f"{lens.model}: there and back {worst[0]:.5f} px, rays beside the documented ones {worst[1]:.2f} px,",
      f"beside OpenCV's usual model {worst[2]:.3f} px")
sys.exit(not (worst[0] < 1e-3 and worst[1] > 10.0 and worst[2] < 0.02))
PY
