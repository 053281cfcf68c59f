#!/usr/bin/env bash
# AHRS 0.4.0: `DCM(array)` is an array that takes over the memory of the given one, and not its strides. A transposed
# matrix of NumPy is the same memory with other strides. So `DCM(R.T)` is R, the inverse of the rotation that was given.
# Nothing warns. Its attribute `A` is right, and the methods use either: `DCM(R.T) @ v` turns by R, `to_quaternion()` is
# that of the inverse. `QuaternionArray` does the same, and mixes components of quaternions whose columns were exchanged
# (`q[:, [3, 0, 1, 2]]`, which turns SciPy's order to that of the library).
# Law: an object of a matrix has its entries. The products of the object and those of its own attribute `A` differ.
# A copy in rows (`np.ascontiguousarray`) is right.
# Prints the headings and the quaternions of such objects, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'ahrs==0.4.0' 'numpy==2.4.6' 'scipy==1.17.1'
cd "$folder"
"$folder/venv/bin/python" -W ignore - <<'PY'
import sys

import numpy as np
from ahrs import DCM, QuaternionArray
from scipy.spatial.transform import Rotation


def heading(R):
    """Heading of a rotation about the z axis, by where it turns the x axis to, in degrees."""
    x, y, _ = np.asarray(R @ np.array((1.0, 0.0, 0.0)))
    return np.degrees(np.arctan2(y, x))


ok = True
R = Rotation.from_euler("z", 30.0, degrees=True).as_matrix()
for name, matrix, right in (("R", R, True), ("R.T", R.T, False), ("copy of R.T", np.ascontiguousarray(R.T), True)):
    dcm = DCM(matrix)
    w, _, _, z = dcm.to_quaternion()
    by_quaternion = np.degrees(2.0 * np.arctan2(z, w))
    print(f"DCM({name}): the matrix turns by {heading(matrix):.1f} degrees, the object by {heading(dcm):.1f}, its"
          f" attribute A by {heading(dcm.A):.1f}, its quaternion by {by_quaternion:.1f}")
    ok &= bool(np.allclose(dcm.A, matrix)) and bool(np.allclose(dcm, matrix)) == right
    ok &= bool(np.allclose(dcm, matrix if right else matrix.T)) and abs(by_quaternion - heading(matrix)) < 1e-6

scipy = Rotation.from_euler("z", ((0.0,), (30.0,), (60.0,)), degrees=True).as_quat()
given = scipy[:, [3, 0, 1, 2]]
for name, array in (("exchanged columns", given), ("a copy in rows", np.ascontiguousarray(given))):
    found = QuaternionArray(array)
    print(f"QuaternionArray of {name}: given {given[1].round(3)}, the object has {np.asarray(found)[1].round(3)}, its"
          f" parts w and z {found.w[1]:.3f} and {found.z[1]:.3f}")
    ok &= bool(np.allclose(np.asarray(found), given)) == (name == "a copy in rows")
    ok &= bool(np.allclose((found.w, found.z), (given[:, 0], given[:, 3])))
sys.exit(not ok)
PY
