#!/usr/bin/env bash
# robot-kinematics 1.1.0: `Jacobian(robot, joints).compute()` is documented as the geometric Jacobian, whose columns
# are the motions of the hand by each joint. In the Denavit-Hartenberg convention of the package, joint i turns about
# the z axis of the frame before it. The library takes the frame behind it. Nothing warns. So each column is that of
# the next joint: the first column belongs to the second joint, and the first joint has none. The last column has no
# translation. The methods of inverse kinematics and the measures of singularity take this matrix: in each of 20
# poses, the UR5 arm of the package counts as singular.
# Prints columns, their errors and singular values, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
pip=("$folder/venv/bin/pip" --quiet --disable-pip-version-check install)
"${pip[@]}" 'numpy==2.4.6' 'scipy==1.17.1' 'matplotlib==3.11.2'
"${pip[@]}" --no-deps 'robot-kinematics==1.1.0' # the rest is for files of robots and windows
cd "$folder"
MPLCONFIGDIR="$folder" "$folder/venv/bin/python" - <<'PY'
import sys
from unittest import mock

for name in ("lxml", "lxml.etree", "xmltodict", "pybullet", "numba"):
    sys.modules[name] = mock.MagicMock()

import numpy as np
from robot_kinematics.core.jacobian import Jacobian
from robot_kinematics.robots.serial import UR5Manipulator
from scipy.spatial.transform import Rotation

STEP = 1e-6
robot = UR5Manipulator()
rng = np.random.default_rng(0)
errors, shifted, least = [], [], []
for _ in range(20):
    joints = rng.uniform(-2.0, 2.0, 6)
    found, truth = Jacobian(robot, joints).compute(), np.zeros((6, 6))
    for i, step in enumerate(STEP * np.eye(6)):  # by differences of the package's own forward kinematics
        before, after = robot.forward_kinematics(joints - step), robot.forward_kinematics(joints + step)
        turn = Rotation.from_matrix(after.rotation @ before.rotation.T).as_rotvec()
        truth[:, i] = np.concatenate([after.position - before.position, turn]) / (2.0 * STEP)
    errors.append(float(np.abs(found - truth).max()))
    shifted.append(float(np.abs(found[:, :-1] - truth[:, 1:]).max()))
    least.append([float(np.linalg.svd(matrix, compute_uv=False)[-1]) for matrix in (found, truth)])
for name, matrix in (("library", found), ("differences", truth)):
    first, second = (matrix.T[:2].round(3) + 0.0).tolist()
    print(f"{name}: first column {first}, second {second}")
print(f"20 poses: largest error of an element from {min(errors):.2f} to {max(errors):.2f}; with columns moved by one,",
      f"{max(shifted):.0e}; largest of the least singular values {max(one for one, _ in least):.0e},",
      f"by differences {max(one for _, one in least):.2f}")
sys.exit(not (min(errors) > 0.3 and max(shifted) < 1e-6 and max(one for one, _ in least) < 1e-9))
PY
