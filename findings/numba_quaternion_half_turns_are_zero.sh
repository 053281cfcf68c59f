#!/usr/bin/env bash
# numba-quaternion 0.3.0: `Quaternion.from_rotation_matrix` takes each component's size from the diagonal of the
# matrix, and its sign from a difference of two other elements. For half a turn, the matrix is symmetric, so these
# differences are zero. The library multiplies by a sign of zero. Nothing warns. So half a turn about any axis gets
# the quaternion zero, which stands for no rotation, and divides by zero wherever it is used. The formula that the
# documentation names needs another branch there. Turns of 179.9 degrees are right.
# Prints quaternions of turns, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
pip=("$folder/venv/bin/pip" --quiet --disable-pip-version-check install)
"${pip[@]}" 'numba-quaternion==0.3.0' 'numba==0.68.1' 'numpy==2.4.6' 'scipy==1.17.1'
cd "$folder"
NUMBA_CACHE_DIR="$folder" "$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
from numba_quaternion import Quaternion
from scipy.spatial.transform import Rotation

ok = True
for axis in ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.6, 0.8, 0.0)):
    half = 2.0 * np.outer(axis, axis) - np.eye(3)
    less = Rotation.from_rotvec(np.radians(179.9) * np.array(axis))
    of_half, of_less = Quaternion.from_rotation_matrix(np.array([half, less.as_matrix()])).array
    truth = Rotation.from_matrix(half).as_quat(scalar_first=True)
    print(f"axis {axis}: half a turn {of_half.round(6) + 0.0}, by SciPy {truth.round(6) + 0.0}, up to sign;",
          f"179.9 degrees {of_less.round(4) + 0.0}")
    ok &= np.abs(of_half).max() < 1e-6 and abs(abs(of_less @ less.as_quat(scalar_first=True)) - 1.0) < 1e-6
sys.exit(not ok)
PY
