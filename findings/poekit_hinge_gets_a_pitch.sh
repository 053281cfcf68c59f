#!/usr/bin/env bash
# poekit 0.1.0: `TwistUtils.motion_2_twist(H)` is documented to convert a motion, given as a homogeneous matrix, to its
# twist. For a turn by t about the unit axis w, the velocity v solves ((I - R) [w] + t w w') v = p. In place of the
# outer product w w', the library has the inner product, which is 1, and adds t to all nine elements. Nothing warns. So
# the velocity along the axis is wrong. A door that turns by 90 degrees about a vertical hinge 1 m away rises by 1.6 m.
# How far it rises depends on the frame. For axes whose components sum to zero, as (1, -1, 0), the equation has no
# solution, and NumPy raises an error. If they sum to little, motions are metres off.
# Law: the exponential of the twist is the motion, by SciPy 1.17.1. A turn about a fixed axis has the pitch zero in each
# frame, and the library's own `joint_2_twist` and `twist_pitch` agree.
# Axis and angle are right. The library's `exp_screw` leaves out the pitch, so the way there and back does not show it.
# Prints pitches and errors for a door in three frames, and for other axes, and fails if that changes.
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
from poekit.twist_utils import TwistUtils
from scipy.linalg import expm

ANGLE = 0.5 * np.pi


def motion(twist, angle):
    """Homogeneous matrix of the motion by a twist (v, w)."""
    (a, b, c), (x, y, z) = np.reshape(twist, (2, 3))
    return expm(angle * np.array(((0.0, -z, y, a), (z, 0.0, -x, b), (-y, x, 0.0, c), (0.0, 0.0, 0.0, 0.0))))


def check(axis, point):
    """Pitch [m/rad] by the library, and the distance [m] by which its twist misses the motion."""
    axis = np.array(axis) / np.linalg.norm(axis)
    true = TwistUtils.joint_2_twist(axis, point, "rot")
    due = motion(true, ANGLE)
    assert np.allclose(due @ (*point, 1.0), (*point, 1.0)) and np.isclose(TwistUtils.twist_pitch(true), 0.0)
    seen = TwistUtils.motion_2_twist(due).ravel()
    assert np.allclose(seen[3:], axis)
    miss = (motion(seen, ANGLE) - due)[:3, 3]
    assert np.allclose(np.cross(miss, axis), 0.0)
    return TwistUtils.twist_pitch(seen), np.linalg.norm(miss)


ok = True
for frame, point in (("at the hinge", (0.0, 0.0, 0.0)), ("1 m away", (1.0, 0.0, 0.0)), ("turned", (0.6, -0.8, 0.0))):
    pitch, miss = check((0.0, 0.0, 1.0), point)
    print(f"door, frame {frame}, hinge at {point}: pitch {pitch + 0.0:.2f} m/rad, {miss:.2f} m off")
    ok &= np.isclose(pitch, point[0] - point[1]) and np.isclose(miss, ANGLE * abs(pitch))
for axis in ((1.0, 0.0, 0.0), (1.0, 2.0, 2.0), (1.0, 0.0, 1.0), (1.0, -1.0, 0.1)):
    pitch, miss = check(axis, (0.3, -0.5, 0.8))
    print(f"axis along {axis} through (0.3, -0.5, 0.8): pitch {pitch:.2f} m/rad, {miss:.2f} m off")
    ok &= miss > 0.3
ok &= miss > 20.0
try:
    TwistUtils.motion_2_twist(motion(np.array((0.0, 0.0, 0.0, 1.0, -1.0, 0.0)) / np.sqrt(2.0), ANGLE))
    ok = False
except np.linalg.LinAlgError as error:
    print(f"axis along (1, -1, 0): {error}")
sys.exit(not ok)
PY
