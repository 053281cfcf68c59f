#!/usr/bin/env bash
# scikit-kinematics 0.10.4: `imus.kalman` estimates the orientation of an IMU with a magnetometer. Of each measurement,
# a Kalman filter takes the difference to its prediction. The function takes the difference to the measurement before,
# which is the turn since then, and adds most of it to a prediction that has that turn already. So it turns too far:
# with exact data of 30 degrees/s about the vertical, it has 51 degrees after one second, and 104 after two. Nothing
# warns. A sensor at rest has no error.
# Law: exact data have no error. Gravity and field alone tell each orientation here.
# Upstream: the open issue github.com/thomas-haslwanter/scikit-kinematics/issues/31 asks about that difference.
# `imus.analytical`, which integrates the gyroscope, is right for exact data.
# Prints turns and errors by both functions for exact data, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'scikit-kinematics==0.10.4' 'numpy==2.4.6' \
  'scipy==1.17.1'
cd "$folder"
MPLBACKEND=agg "$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
from scipy.constants import g
from scipy.spatial.transform import Rotation
from skinematics import imus

RATE, N = 100.0, 401
times = np.arange(N) / RATE
start = Rotation.from_euler("ZYX", (30.0, 20.0, 10.0), degrees=True)
found = {}
for name, omega_W in (("at rest", (0, 0, 0)), ("vertical", (0, 0, 30)), ("tilted", (12, -16, 15))):
    turns = Rotation.from_rotvec(np.radians(omega_W) * times[:, None])  # of the world, since the start
    poses = turns * start
    acc, mag = poses.inv().apply((0.0, 0.0, g)), poses.inv().apply((0.5, 0.0, -0.8))
    omega = poses.inv().apply(np.radians(omega_W).astype(float))
    north = np.cross(np.cross(acc, mag), acc)
    axes = [north, np.cross(acc, north), acc]  # of the world, in the sensor: by gravity and field alone
    measured = Rotation.from_matrix(np.stack([a / np.linalg.norm(a, axis=1)[:, None] for a in axes], axis=1))
    assert (measured * poses.inv()).magnitude().max() < 1e-7
    by = {
        "kalman": imus.kalman(RATE, acc, omega, mag),
        "analytical": imus.analytical(start.as_matrix(), omega, np.zeros(3), acc, RATE)[0],
    }
    for function, q in by.items():
        turned = Rotation.from_quat(q[:, [1, 2, 3, 0]])
        errors = np.degrees((turned * turns.inv()).magnitude())
        angles = np.degrees(turned.magnitude())
        found[name, function] = angles, errors
        print(f"{name}, {function}:", "; ".join(
            f"after {times[k]:.0f} s, {np.degrees(turns[k].magnitude()):.1f} degrees as {angles[k]:.1f},"
            f" error {errors[k]:.1f}" for k in (100, 200, 400)))
ok = all(found[name, "analytical"][1].max() < 1e-4 for name in ("at rest", "vertical", "tilted"))
ok &= found["at rest", "kalman"][1].max() < 1e-4
ok &= all(found[name, "kalman"][1][200] > 20.0 for name in ("vertical", "tilted"))
sys.exit(not (ok and abs(found["vertical", "kalman"][0][100] - 50.9) < 1.0))
PY
