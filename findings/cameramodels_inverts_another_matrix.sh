#!/usr/bin/env bash
# cameramodels 0.2.13: a `PinholeCameraModel` has the matrix K of the raw images, and P of the rectified ones, as
# ROS's CameraInfo. `K_inv` is documented as the "inverse of intrinsic camera matrix for the raw (distorted) images".
# The library takes the focal lengths and the principal point of P for it. Nothing warns. Where a calibration has been
# rectified, the two matrices differ, so K_inv is no inverse of K. With a principal point that rectification moves by
# 25 pixels, the rays of raw pixels are off by three degrees.
# Prints products of the matrices and angles of rays, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
pip=("$folder/venv/bin/pip" --quiet --disable-pip-version-check install)
"${pip[@]}" 'cameramodels==0.2.13' 'numpy==2.4.6' 'scipy==1.17.1' 'pillow==13.0.0' 'pyyaml==6.0.3'
"${pip[@]}" 'opencv-python-headless==5.0.0.93'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
from cameramodels import PinholeCameraModel

K = np.array([[520.0, 0.0, 325.0], [0.0, 522.0, 250.0], [0.0, 0.0, 1.0]])
P = np.array([[490.0, 0.0, 350.0, -60.0], [0.0, 490.0, 245.0, 0.0], [0.0, 0.0, 1.0, 0.0]])  # of the right camera
found = []
for name, projection in (("P with K's numbers", np.c_[K, np.zeros(3)]), ("P of a stereo rectification", P)):
    camera = PinholeCameraModel(480, 640, K, projection)
    assert np.allclose(camera.K, K) and np.allclose(camera.P, projection)
    off = float(np.abs(camera.K_inv @ K - np.eye(3)).max())
    pixels = np.array([[325.0, 250.0, 1.0], [0.0, 0.0, 1.0], [639.0, 479.0, 1.0]])
    rays, truth = pixels @ camera.K_inv.T, np.linalg.solve(K, pixels.T).T
    cosines = (rays * truth).sum(1) / np.linalg.norm(rays, axis=1) / np.linalg.norm(truth, axis=1)
    angles = np.degrees(np.arccos(cosines.clip(-1.0, 1.0)))
    of_p = np.allclose(camera.K_inv, np.linalg.inv(projection[:, :3]))
    print(f"{name}: K_inv K differs from the identity by {off:.3f}; rays of the centre and two corners are off by",
          f"{angles.round(2).tolist()} degrees; inverse of P: {of_p}")
    found.append((off, angles[0], of_p))
sys.exit(not (found[0][0] < 1e-5 and found[1][0] > 0.05 and 2.0 < found[1][1] < 4.0 and found[1][2]))
PY
