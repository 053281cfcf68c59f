#!/usr/bin/env bash
# poekit 0.1.0: `RotationUtils.eul_2_rotm(angles, seq)` is documented to "convert Euler angles to rotation matrix", for
# the sequences ZYX, ZYZ and XYZ. ZYZ and XYZ are the product of the three turns in this order. ZYX, the default, is the
# transpose of it, which is the turn back. Nothing warns. A heading of 40 degrees turns a vector by 40 degrees to the
# right.
# Law: turns about one axis alone do not depend on the sequence. The library's own `rotZ_to_tform`, `rotY_to_tform` and
# `rotX_to_tform` give the product, and so does SciPy 1.17.1. `quat_to_eulZYX` reads the angles of the product, so the
# way from a quaternion by the angles to a matrix inverts it.
# Upstream: no issue of github.com/VibhuSharma19/poekit that was found describes it.
# The transpose of the result is right.
# Prints the angles between the matrix and the product of the turns, and between it and the inverse, and fails if that
# changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'poekit==0.1.0' 'numpy==2.4.6' 'scipy==1.17.1' \
  'sympy==1.14.0'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
from poekit.rotation_utils import RotationUtils
from scipy.spatial.transform import Rotation

TURNS = {"X": RotationUtils.rotX_to_tform, "Y": RotationUtils.rotY_to_tform, "Z": RotationUtils.rotZ_to_tform}


def between(first, second):
    """Angle [degrees] between two rotation matrices."""
    return np.degrees(Rotation.from_matrix(first.T @ second).magnitude())


ok = True
for sequence in ("ZYX", "ZYZ", "XYZ"):
    for degrees in ((40.0, 0.0, 0.0), (40.0, 20.0, 10.0), (-100.0, 30.0, 60.0)):
        angles = np.radians(degrees)
        seen = RotationUtils.eul_2_rotm(angles, sequence)
        first, second, third = (TURNS[axis](angle)[:3, :3] for axis, angle in zip(sequence, angles))
        product = first @ second @ third
        assert np.allclose(product, Rotation.from_euler(sequence, angles).as_matrix())
        print(f"{sequence}, {degrees} degrees: {between(seen, product):.1f} degrees from the product of the turns,",
              f"{between(seen, product.T):.1f} from its inverse; x points to {(seen @ (1.0, 0.0, 0.0)).round(2) + 0.0}")
        right, wrong = between(seen, product), between(seen, product.T)
        ok &= (right > 30.0 and wrong < 1e-5) if sequence == "ZYX" else (right < 1e-5 and wrong > 30.0)
for number, rotation in enumerate(Rotation.random(3, rng=0)):
    angles = RotationUtils.quat_to_eulZYX(rotation.as_quat(scalar_first=True))
    seen = RotationUtils.eul_2_rotm(angles)
    off, back = between(seen, rotation.as_matrix()), between(seen, rotation.inv().as_matrix())
    print(f"quaternion {number}, by its angles to a matrix: {off:.1f} degrees off, {back:.1f} from its inverse")
    ok &= off > 3.0 and back < 1e-5
sys.exit(not ok)
PY
