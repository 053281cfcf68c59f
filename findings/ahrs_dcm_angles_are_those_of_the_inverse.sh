#!/usr/bin/env bash
# AHRS 0.4.0: `DCM(rpy=angles)` makes a matrix of angles about z, y and x. `DCM.to_rpy()` and `to_angles()` read other
# angles from it: the formula is that of the transposed matrix, so they are roll, pitch and yaw of the inverse. For one
# angle, the sign is wrong. For several, all values are. Nothing warns.
# `Quaternion.to_angles()` of the same library, from `DCM.to_quaternion()`, has the right angles of the same rotation.
# Law: angles of a matrix make this matrix again. SciPy 1.17.1 agrees with the constructor and with `Quaternion`.
# Prints the angles and those read back, in degrees, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'ahrs==0.4.0' 'numpy==2.4.6' 'scipy==1.17.1'
cd "$folder"
"$folder/venv/bin/python" -W ignore - <<'PY'
import sys

import numpy as np
from ahrs import DCM, Quaternion
from scipy.spatial.transform import Rotation

ok = True
for yaw, pitch, roll in ((30.0, 0.0, 0.0), (0.0, 20.0, 0.0), (0.0, 0.0, 9.0), (30.0, 20.0, 10.0), (120.0, -50.0, 70.0)):
    dcm = DCM(rpy=np.radians((yaw, pitch, roll)))
    scipy = Rotation.from_euler("ZYX", (yaw, pitch, roll), degrees=True)
    found = np.degrees(dcm.to_rpy())
    quaternion = np.degrees(Quaternion(dcm.to_quaternion()).to_angles())
    inverse = scipy.inv().as_euler("ZYX", degrees=True)[::-1]
    print(f"roll, pitch and yaw {(roll, pitch, yaw)}: from the matrix {found.round(2)}, from the quaternion"
          f" {quaternion.round(2)}, those of the inverse {inverse.round(2)}")
    ok &= bool(np.allclose(dcm, scipy.as_matrix())) and bool(np.allclose(quaternion, (roll, pitch, yaw)))
    ok &= bool(np.allclose(found, inverse)) and not np.allclose(found, (roll, pitch, yaw), atol=5.0)
    ok &= bool(np.allclose(dcm.to_angles(), dcm.to_rpy()))
sys.exit(not ok)
PY
