#!/usr/bin/env bash
# OpenCV 5.0.0.93: `recoverPose` chooses among the four motions of an essential matrix by the points before both
# cameras, and counts none that is farther away than 50 times the baseline. The form with a camera matrix alone has no
# argument for it. Between images of a video all points may be that far. Exact pixels of 100 points, 64 to 100
# baselines away, give 0 inliers, and the motion is a guess: with the opposite sign of the same essential matrix the
# rotation is wrong by 180 degrees, without an error. `distanceThresh` gives the true one for both signs.
# Upstream: the issue github.com/opencv/opencv/issues/8032, closed by that argument.
# Prints inliers and errors, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'opencv-python-headless==5.0.0.93' 'numpy==2.4.6'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import cv2
import numpy as np

rng = np.random.default_rng(0)
K = np.array(((500.0, 0.0, 320.0), (0.0, 500.0, 240.0), (0.0, 0.0, 1.0)))
points = np.column_stack((rng.uniform(-3, 3, 100), rng.uniform(-2, 2, 100), rng.uniform(6.4, 10, 100)))
R, t = cv2.Rodrigues(np.array((0.01, 0.02, -0.015)))[0], np.array((0.1, 0.0, 0.0))
E = np.cross(np.eye(3), -t) @ R  # [t]x R, up to its sign: exact


def pixels(at):
    return (at @ K.T)[:, :2] / at[:, 2:]


first, second = pixels(points), pixels(points @ R.T + t)
found = {}
for threshold in (None, 1e6):
    options = {} if threshold is None else {"distanceThresh": threshold}
    for sign in (1.0, -1.0):
        inliers, turn = cv2.recoverPose(sign * E, first, second, K, **options)[:2]
        error = float(np.degrees(np.linalg.norm(cv2.Rodrigues(turn @ R.T)[0])))
        print(f"distanceThresh {threshold}, {sign:+g} E: {inliers} inliers, rotation wrong by {error:.3f} degrees")
        found.setdefault(threshold, []).append((inliers, round(error)))
sys.exit(not (sorted(found[None]) == [(0, 0), (0, 180)] and found[1e6] == [(100, 0), (100, 0)]))
PY
