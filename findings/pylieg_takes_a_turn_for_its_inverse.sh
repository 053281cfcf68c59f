#!/usr/bin/env bash
# pylieg 0.2.5: `Quaternion.as_rotation` returns the rotation of a quaternion as an `SO3`. For a unit quaternion with
# the scalar r and the vector v, the matrix is v v' + r^2 I + 2 r [v] + [v]^2. The library leaves out 2 r [v]. Nothing
# warns. A quaternion and its inverse get the same matrix, which is no rotation: a turn by 90 degrees becomes the
# projection onto its axis. Only the identity and half turns are right.
# Law: the matrix of a product is the product of matrices, that of the inverse is the transpose, and the determinant is
# 1. SciPy 1.17.1 has the matrix.
# Upstream: no issue of github.com/pvangoor/pylie that was found describes it.
# The part of the library's own `Adjoint` that belongs to the vector is right.
# Prints the errors for some angles, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'pylieg==0.2.5' 'numpy==2.4.6' 'scipy==1.17.1' \
  'matplotlib==3.11.2'
cd "$folder"
MPLBACKEND=Agg "$folder/venv/bin/python" - <<'PY'
import sys
from importlib.metadata import version

import numpy as np
from pylie import SO3, Quaternion
from scipy.spatial.transform import Rotation

print("pylieg", version("pylieg"))
AXIS = np.array((1.0, 2.0, 2.0)) / 3.0
ok = True
for degrees in (0.0, 10.0, 45.0, 90.0, 135.0, 180.0):
    half = np.radians(degrees) / 2.0
    turn = Quaternion(np.r_[np.cos(half), np.sin(half) * AXIS])
    seen, back = turn.as_rotation().as_matrix(), turn.inv().as_rotation().as_matrix()
    true = Rotation.from_rotvec(2.0 * half * AXIS).as_matrix()
    own, adjoint = SO3.exp(2.0 * half * AXIS).as_matrix(), turn.Adjoint()[1:, 1:]
    error, same = np.linalg.norm(seen - true, 2), np.linalg.norm(seen - back, 2)
    determinant = np.linalg.det(seen)
    print(f"turn by {degrees:g} degrees: a unit vector is off by up to {error:.3f}; determinant {determinant:.3f};"
          f" the inverse turn differs by {same:.1e}; Adjoint is off by {np.linalg.norm(adjoint - true, 2):.1e}")
    ok &= np.allclose(error, np.abs(np.sin(2.0 * half)), atol=1e-9) and same < 1e-12
    ok &= np.allclose(determinant, np.cos(2.0 * half) ** 2, atol=1e-9)
    ok &= np.allclose(own, true) and np.allclose(adjoint, true)
sys.exit(not ok)
PY
