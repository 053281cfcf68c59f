#!/usr/bin/env bash
# kalbee 1.0.0: `InvariantEKF` is documented as a right-invariant Kalman filter of a pose. Its error is a motion in the
# world that goes before the pose, and `update` corrects the pose that way. Such an error stays as it is while the robot
# drives. `predict` transforms its covariance by each step. A turn of the world moves the position too. The Jacobian of
# `update` has no column for it. The two faults meet: a position fix leaves the position where it is, and turns the
# heading to the wrong side. The reported deviations shrink as they should.
# A robot starts with a heading that is off by 0.05 rad, and knows it to 0.05 rad. It drives 10 m, and gets its exact
# position, 0.5 m aside. The filter stays 0.5 m off. The error of the heading doubles, to 100 deviations.
# Law: after an exact position fix, the estimate is there. The posterior is integrated over all headings.
# Upstream: no issue of github.com/LakoreAI/kalbee that was found describes it.
# Prints estimates for three distances, also by the textbook's covariance and Jacobian, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'kalbee==1.0.0' 'numpy==2.4.6' 'scipy==1.17.1'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
from kalbee import InvariantEKF
from scipy.linalg import expm

OFF, NOISE = 0.05, 0.01  # the error and deviation of the heading in rad, and the deviation of the fix in metres
P0 = np.diag([1e-10] * 5 + [OFF**2])  # of the error: translation, then rotation


def cross(v):
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def textbook(start, distance, fix):
    """The pose after the same update; the covariance is constant, and both parts of an error move the position."""
    pose = start.copy()
    pose[0, 3] += distance
    H = np.hstack((np.eye(3), -cross(pose[:3, 3])))
    K = P0 @ H.T @ np.linalg.inv(H @ P0 @ H.T + NOISE**2 * np.eye(3))
    error, twist = K @ (fix - pose[:3, 3]), np.zeros((4, 4))
    twist[:3, :3], twist[:3, 3] = cross(error[3:]), error[:3]
    return expm(twist) @ pose


def seen(pose):
    return pose[1, 3], np.arctan2(pose[1, 0], pose[0, 0])


ok = True
headings = np.linspace(-0.4, 0.4, 80001)
for distance in (1.0, 10.0, 50.0):
    ekf = InvariantEKF(np.eye(4), P0.copy(), np.zeros((6, 6)), NOISE**2 * np.eye(3))
    for _ in range(20):
        ekf.predict(1.0, np.array([distance / 20.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
    before = ekf.pose.copy()
    fix = distance * np.array([np.cos(OFF), np.sin(OFF), 0.0])
    ekf.update(fix)
    away = (distance * np.cos(headings) - fix[0]) ** 2 + (distance * np.sin(headings) - fix[1]) ** 2
    weights = np.exp(-0.5 * ((headings / OFF) ** 2 + away / NOISE**2))
    true = float(weights @ headings / weights.sum())
    std = float(np.sqrt(weights @ (headings - true) ** 2 / weights.sum()))
    (y, heading), book = seen(ekf.pose), seen(textbook(np.eye(4), distance, fix))
    print(f"after {distance:g} m: the fix is {fix[1]:.3f} m aside; the library's estimate goes from {before[1, 3]:.3f}"
          f" to {y:.3f} m, and its heading from 0 to {heading:.4f} rad, with a deviation of"
          f" {np.sqrt(ekf.covariance[5, 5]):.4f}; the posterior has {true:.4f} rad and {std:.4f};"
          f" the textbook {book[1]:.4f} rad and {book[0]:.3f} m")
    ok &= abs(before[0, 3] - distance) < 1e-9 and abs(y) < 1e-3 and abs(heading + true) < 0.02 * OFF
    ok &= abs(np.sqrt(ekf.covariance[5, 5]) / std - 1.0) < 0.05 and heading < -0.9 * OFF
    ok &= abs(book[1] - true) < 0.02 * OFF and abs(book[0] / distance - np.sin(true)) < 0.02 * OFF
sys.exit(not ok)
PY
