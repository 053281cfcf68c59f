#!/usr/bin/env bash
# dm-robotics-transformations 0.10.0: `rmat_to_euler(matrix, "ZYX")` finds yaw, pitch and roll. At a pitch of 90 degrees
# up or down, yaw and roll cannot be separated. The library sets the yaw to 0 and computes the roll. It has one formula
# for both poles, which is that of +90 degrees. At -90 degrees, both arguments of its arctangent have the wrong sign. So
# the roll is off by 180 degrees: a robot that looks straight up or down comes back turned by half a turn. It warns of
# the pole, as it does at +90 degrees, where it is right.
# The orders XZY and YZX have it at one pole too. XYZ, YXZ and ZXY have a formula for each pole.
# Law: `euler_to_rmat` undoes `rmat_to_euler`. SciPy 1.17.1 has the same matrix for the angles by `euler_to_rmat`.
# Upstream: github.com/google-deepmind/dm_control/pull/555, open, tells it of the same functions of dm_control.
# `quat_to_mat(mat_to_quat(matrix))` is right.
# Prints the turn between matrices and their Euler angles, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'dm-robotics-transformations==0.10.0' \
  'absl-py==2.3.1' 'numpy==2.4.6' 'scipy==1.17.1'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
from dm_robotics.transformations import transformations
from scipy.spatial.transform import Rotation

WRONG = {("ZYX", -90.0), ("XZY", -90.0), ("YZX", 90.0)}
ok = True
for order in ("ZYX", "XZY", "YZX", "XYZ", "YXZ", "ZXY"):
    for middle in (-90.0, 90.0, -89.0, 89.0):
        angles = np.array((20.0, middle, 10.0))
        R = Rotation.from_euler(order, angles, degrees=True)
        made = transformations.euler_to_rmat(np.radians(angles), order)
        found = transformations.rmat_to_euler(R.as_matrix(), order)
        back = Rotation.from_euler(order, found)
        quaternion = transformations.mat_to_quat(R.as_matrix())
        off = np.degrees((back.inv() * R).magnitude())
        if abs(middle) == 90.0:
            print(f"{order} {angles}: comes back as {np.degrees(found).round(2)}, which is {off:.4f} degrees off")
        ok &= bool(np.allclose(made, R.as_matrix()) and np.isclose(off, 180.0 * ((order, middle) in WRONG), atol=1e-4))
        ok &= bool(np.allclose(transformations.quat_to_mat(quaternion)[:3, :3], R.as_matrix()))
sys.exit(not ok)
PY
