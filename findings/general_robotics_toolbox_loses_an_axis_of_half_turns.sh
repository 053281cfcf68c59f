#!/usr/bin/env bash
# General Robotics Toolbox 0.7.3: `R2rot` returns the axis and the angle of a rotation matrix. A half turn tells its
# axis by products of the components alone. Where the axis has no x, the sign of z should come from the product of y
# and z. The library takes it from that of x and z, which is zero. So z is lost, and the axis is no unit vector. Nothing
# warns. (0, 0.6, 0.8) becomes (0, 0.6, 0). An exchange of y and z, with x reversed, is such a turn. `rot` makes a
# matrix of the result that scales, down to a determinant of 0. Where the matrix has rounding errors, the sign of z is
# theirs: the half turn about (0, 0.6, -0.8) by `rot` itself comes back as one about (0, 0.6, 0.8).
# Axes with an x are right, and so are turns that are 0.1 degrees short of a half.
# Law: `rot` undoes `R2rot`. SciPy 1.17.1 returns the true axis.
# Upstream: no issue of github.com/rpiRobotics/rpi_general_robotics_toolbox_py that was found describes it.
# `q2rot(R2q(R))` is right.
# Prints the axes of half turns and the matrices they make, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'general-robotics-toolbox==0.7.3' \
  'urdf-parser-py==0.0.4' 'numpy==2.4.6' 'scipy==1.17.1'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import general_robotics_toolbox as rox
import numpy as np
from scipy.spatial.transform import Rotation

AXES = ((0.0, 1.0, 1.0), (0.0, 3.0, 4.0), (0.0, 3.0, -4.0), (3.0, 0.0, 4.0), (0.0, 0.0, 1.0), (1.0, 2.0, -2.0))
ok = True
for axis in AXES:
    k = np.array(axis) / np.linalg.norm(axis)
    half = 2.0 * np.outer(axis, axis) / np.dot(axis, axis) - np.eye(3)  # exact zeros stay zeros
    found, angle = rox.R2rot(half)
    made = rox.rot(np.array(found), angle)
    scipy, quaternion = Rotation.from_matrix(half).as_rotvec() / np.pi, np.array(rox.q2rot(rox.R2q(half))[0])
    rounded, short = (rox.R2rot(rox.rot(k, turn))[0] for turn in (np.pi, np.radians(179.9)))
    print(f"half turn about {k.round(3)}: {np.round(found, 3)} and {np.degrees(angle):.0f} degrees, a matrix with the"
          f" determinant {np.linalg.det(made):.3f}; SciPy {scipy.round(3)}, by the quaternion {quaternion.round(3)};"
          f" of the library's own half turn {np.round(rounded, 3)}, of 179.9 degrees {np.round(short, 3)}")
    loses = k[0] == 0.0 and k[1] != 0.0
    ok &= bool(np.allclose(found, (0.0, k[1], 0.0) if loses else k)) and abs(angle - np.pi) < 1e-9
    ok &= (np.linalg.det(made) < 0.1) == loses and bool(np.allclose(short, k))
    ok &= bool(np.allclose(rounded, np.abs(k) if loses else k, atol=1e-6))
    ok &= all(abs(abs(other @ k) - 1.0) < 1e-9 for other in (scipy, quaternion))
sys.exit(not ok)
PY
