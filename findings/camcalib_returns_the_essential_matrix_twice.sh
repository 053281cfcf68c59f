#!/usr/bin/env bash
# camcalib 1.0.5: `camera_calibrate.stereo_calib` calibrates a pair of cameras by images of a chessboard. It is
# documented to return "E: Essential matrix" and "F: Fundamental matrix". OpenCV computes both. The library puts E in
# the place of F too. Nothing warns. F relates pixels, and E relates rays. So the epipolar lines of the F that is
# returned are hundreds of pixels away from the points. The F that follows from the E and the camera matrices of the
# same result is right.
# Prints distances from epipolar lines, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
pip=("$folder/venv/bin/pip" --quiet --disable-pip-version-check install)
"${pip[@]}" 'numpy==2.4.6' 'opencv-python-headless==5.0.0.93' 'tqdm==4.70.1'
"${pip[@]}" --no-deps 'camcalib==1.0.5' # else two builds of OpenCV, with windows
cd "$folder"
"$folder/venv/bin/python" - 2>progress <<'PY'
import glob
import os
import sys

import cv2
import numpy as np
from camcalib import camera_calibrate

cv2.imshow = cv2.waitKey = cv2.destroyAllWindows = lambda *args: None  # there is no screen
listed = glob.glob
glob.glob = lambda pattern: sorted(listed(pattern))  # else the pairs have the order of the file system

SIZE, SQUARE = (800, 600), 40  # pixels; a square of the board is 1 unit
K = np.array([[700.0, 0.0, 400.0], [0.0, 700.0, 300.0], [0.0, 0.0, 1.0]])
R_21, p_21 = cv2.Rodrigues(np.array([0.02, -0.1, 0.03]))[0], np.array([-2.0, 0.1, 0.0])
board = np.kron(np.indices((7, 10)).sum(0) % 2 * 255, np.ones((SQUARE, SQUARE))).astype(np.uint8)
board = cv2.copyMakeBorder(board, SQUARE, SQUARE, SQUARE, SQUARE, cv2.BORDER_CONSTANT, value=255)
corner = 0.5 / SQUARE - 2.0  # a margin and a square before the first inner corner, which is the origin
plane_from_board = np.array([[1.0 / SQUARE, 0.0, corner], [0.0, 1.0 / SQUARE, corner], [0.0, 0.0, 1.0]])
corners = np.array([(x, y, 0.0) for y in range(6) for x in range(9)])
rng = np.random.default_rng(0)
pixels = [[], []]
for i in range(10):
    R_1 = cv2.Rodrigues(rng.uniform(-0.4, 0.4, 3))[0]
    p_1 = R_1 @ (-4.0, -2.5, 0.0) + (rng.uniform(0.5, 1.5), rng.uniform(-0.7, 0.7), rng.uniform(14.0, 17.0))
    for camera, (R, p) in enumerate(((R_1, p_1), (R_21 @ R_1, R_21 @ p_1 + p_21))):
        os.makedirs(f"camera{camera}", exist_ok=True)
        image = cv2.warpPerspective(board, K @ np.c_[R[:, :2], p] @ plane_from_board, SIZE, borderValue=255)
        cv2.imwrite(f"camera{camera}/{i}.png", image)
        points = (corners @ R.T + p) @ K.T
        pixels[camera].append(points / points[:, 2:])
first, second = map(np.concatenate, pixels)  # true pixels, by the pinhole model
result = camera_calibrate.stereo_calib(*(camera_calibrate(SIZE, f"camera{camera}", (9, 6)) for camera in (0, 1)))


def distance(F):
    """The mean distance of the second camera's pixels from the epipolar lines of the first one's."""
    lines = first @ F.T
    return float(np.abs((lines * second).sum(1) / np.linalg.norm(lines[:, :2], axis=1)).mean())


cross = np.array([[0.0, -p_21[2], p_21[1]], [p_21[2], 0.0, -p_21[0]], [-p_21[1], p_21[0], 0.0]])
K_inv = np.linalg.inv(K)
computed = np.linalg.inv(result["mtx_2"]).T @ result["E"] @ np.linalg.inv(result["mtx_1"])
found = [distance(F) for F in (K_inv.T @ cross @ R_21 @ K_inv, computed, result["F"])]
same = np.array_equal(result["F"], result["E"])
print(f"distances from epipolar lines: of the true F {found[0]:.3f} px, of that by E and the matrices {found[1]:.2f},",
      f"of that which is returned {found[2]:.1f}; it is E: {same}")
sys.exit(not (same and found[0] < 1e-6 and found[1] < 3.0 and found[2] > 50.0))
PY
