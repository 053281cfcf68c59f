#!/usr/bin/env bash
# hecalib 1.3.0: `Cal_Lu` solves the hand-eye calibration A X = X B by unit quaternions. Its quadratic equation has two
# roots, and one of them has the quaternion zero. The library takes the first root unless its norm is negative, and does
# not look at the quaternion. Nothing warns. For 67 of 300 exact data sets, it returns minus the identity in place of
# the rotation, whatever the camera. The translation is off by up to kilometres.
# Law: a rotation has the determinant 1. X solves A X = X B exactly. The library's methods of Tsai, Park, Chou and Li
# find it.
# Upstream: no issue of github.com/ienebuse/hecalib that was found describes it.
# Prints how often each method is wrong, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'hecalib==1.3.0' 'numpy==2.4.6' 'scipy==1.17.1'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys
import warnings
from importlib.metadata import version

import hecalib
import numpy as np
from scipy.spatial.transform import Rotation

COUNT, POSES = 300, 10
print("hecalib", version("hecalib"))


def pose(random):
    """A random pose."""
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = Rotation.random(rng=random).as_matrix(), random.normal(size=3)
    return found


def calibrate(name, seed):
    """Errors of the rotation and the translation [m] for exact data, if it is minus the identity, count of warnings."""
    random = np.random.default_rng(seed)
    camera, board = pose(random), pose(random)
    hand = np.array([pose(random) for _ in range(POSES)])
    eye = np.linalg.inv(board) @ hand @ camera
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        rotation, translation, _ = getattr(hecalib, name)().calibrate(hand, eye)
    return (np.abs(rotation - camera[:3, :3]).max(), np.linalg.norm(translation.ravel() - camera[:3, 3]),
            np.allclose(rotation, -np.eye(3), atol=1e-3), len(told))


ok = True
for name in ("Cal_Tsai", "Cal_Park", "Cal_Chou", "Cal_Li", "Cal_Lu"):
    turns, shifts, inverted, told = np.array([calibrate(name, seed) for seed in range(COUNT)]).T
    wrong = turns > 1e-3
    print(f"{name}: wrong rotations for {wrong.sum()} of {COUNT} data sets, of which {int(inverted.sum())} are minus"
          f" the identity and {(wrong & (told == 0)).sum()} come without a warning; the translation is off by up to"
          f" {shifts.max():.1e} m, for the others by {shifts[~wrong].max():.1e} m")
    ok &= np.array_equal(inverted > 0, wrong) and shifts[~wrong].max() < 1e-3
    ok &= 30 < (wrong & (told == 0)).sum() and shifts.max() > 100.0 if name == "Cal_Lu" else not wrong.any()
sys.exit(not ok)
PY
