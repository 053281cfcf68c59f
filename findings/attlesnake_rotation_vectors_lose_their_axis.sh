#!/usr/bin/env bash
# attlesnake 0.2.0: `PRV.from_quaternion(q)` converts a quaternion to its principal rotation vector: an angle and a unit
# axis e. The angle is right. For the axis, the library takes the sine of half of each component in place of dividing by
# the sine of half the angle. Then it normalises the axis, and writes the second component over the first. So e has
# e_y / |e| first, and e_y before the division second. Nothing warns. A turn of 90 degrees about x comes back with the
# axis zero, a turn about y with an axis that is mostly x.
# Law: the library's own inverse, `Quaternion.from_prv`, should give the quaternion back. SciPy 1.17.1 has the axis.
# Turns about z are the only ones of the three axes that come back.
# Upstream: no issue of github.com/mdbernard/attlesnake that was found describes it.
# Right is e = v / |v| of the vector part v.
# Prints axes and errors of the round trip, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'attlesnake==0.2.0' 'numpy==2.4.6' 'scipy==1.17.1'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys
import warnings
from importlib.metadata import version

import numpy as np
from attlesnake.parameter import PRV, Quaternion
from scipy.spatial.transform import Rotation

warnings.simplefilter("error")
print("attlesnake", version("attlesnake"))


def angle(a, b):
    """Angle between two attitudes in degrees."""
    return np.degrees(2.0 * np.arccos(min(1.0, abs(np.dot(a, b)))))


ok = True
for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.6, 0.0, 0.8), (2.0, 1.0, 2.0), (-1.0, 2.0, 2.0)):
    axis = np.array(axis) / np.linalg.norm(axis)
    for degrees in (20.0, 90.0):
        q = Rotation.from_rotvec(np.radians(degrees) * axis).as_quat(scalar_first=True)
        seen = PRV.from_quaternion(Quaternion(*q))
        back = Quaternion.from_prv(seen).q
        repaired = Quaternion.from_prv(PRV(2.0 * np.arccos(q[0]), *(q[1:] / np.linalg.norm(q[1:])))).q
        e = np.array((seen.e1, seen.e2, seen.e3))
        error = angle(q, back)
        print(f"{degrees:g} degrees about {np.round(axis, 3)}: angle {np.degrees(seen.angle):.2f}, axis"
              f" {np.round(e, 3) + 0.0}, round trip off by {error:.2f} degrees")
        ok &= np.isclose(seen.angle, np.radians(degrees)) and angle(q, repaired) < 1e-5
        half = np.sin(0.5 * q[1:])
        ok &= np.allclose(e, (half[1] / np.linalg.norm(half), half[1], half[2] / np.linalg.norm(half)))
        ok &= error < 1e-5 if axis[2] == 1.0 else error > 5.0
sys.exit(not ok)
PY
