#!/usr/bin/env bash
# eulerangles 1.0.2: `matrix2euler` finds the Euler angles of a rotation matrix. Where the middle angle is 90 degrees,
# the other two cannot be told apart, and one is set to zero. To see this gimbal lock, the library looks whether one
# element of the matrix is zero. For three different axes, this is the product of two cosines, as cos(pitch) cos(yaw).
# So an outer angle of 90 degrees counts as a gimbal lock too. Nothing warns. A heading of 90 degrees becomes 0. With
# a roll and a pitch beside it, the orientation is off by 108 degrees. Headings of 89.9 degrees are right.
# Prints angles before and after, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'eulerangles==1.0.2' 'numpy==2.4.6' 'scipy==1.17.1'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
from eulerangles import euler2matrix, matrix2euler
from scipy.spatial.transform import Rotation

CONVENTION = {"axes": "xyz", "intrinsic": False, "right_handed_rotation": True}  # roll, pitch, yaw
errors = []
for angles in ((0.0, 0.0, 89.9), (0.0, 0.0, 90.0), (20.0, 10.0, 89.9), (20.0, 10.0, 90.0), (20.0, 10.0, -90.0)):
    truth = Rotation.from_euler("xyz", angles, degrees=True)
    assert np.allclose(euler2matrix(np.array(angles), **CONVENTION), truth.as_matrix())
    back = matrix2euler(truth.as_matrix(), **CONVENTION).ravel()
    assert np.allclose(truth.as_euler("xyz", degrees=True), angles)  # no gimbal lock for SciPy
    errors.append(float(np.degrees((truth.inv() * Rotation.from_euler("xyz", back, degrees=True)).magnitude())))
    print(f"roll, pitch, yaw {angles}: {(back.round(3) + 0.0).tolist()}, an error of {errors[-1]:.3f} degrees")
sys.exit(not (errors[0] < 1e-6 > errors[2] and abs(errors[1] - 90.0) < 1e-6 and min(errors[3:]) > 60.0))
PY
