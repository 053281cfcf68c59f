#!/usr/bin/env bash
# PSpincalc 0.2.7: the package converts "between attitude representations (DCM, Euler angles, Quaternions, and Euler
# vectors)". Its quaternions have the scalar first, as `EV2Q`, `Q2DCM`, `DCM2Q` and `EA2Q` write and read them. `Q2EV`
# reads the scalar from the last place. So the axis and the angle of a quaternion of the package itself are wrong:
# no turn becomes half a turn about x, and a turn of 30 degrees one of 200. Nothing warns. `DCM2EV` and `EA2EV` return
# what `Q2EV` makes, and are wrong too.
# Law: `Q2EV(EV2Q(v))` is the same rotation as v, and `EV2DCM(DCM2EV(D))` is D. SciPy 1.17.1 is the reference.
# Upstream: no issue of github.com/tuxcell/PSpincalc that was found describes it.
# `Q2EV` of a quaternion whose scalar is moved to the end is right.
# Prints what turns of 0 to 170 degrees become, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'PSpincalc==0.2.7' 'numpy==2.4.6' 'scipy==1.17.1'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys
from importlib.metadata import version

import numpy as np
import PSpincalc as spin
from scipy.spatial.transform import Rotation

AXIS = np.array((2.0, -1.0, 2.0)) / 3.0
print("PSpincalc", version("PSpincalc"))


def rotation(vector):
    """Rotation by an Euler vector of the package: the axis, then the angle [rad]."""
    return Rotation.from_rotvec(vector[0, :3] * vector[0, 3])


def error(a, b):
    """Angle [degrees] between two rotations."""
    return np.degrees((a.inv() * b).magnitude())


ok = True
for degrees in (0.0, 1.0, 30.0, 90.0, 170.0):
    true = Rotation.from_rotvec(np.radians(degrees) * AXIS)
    q = spin.EV2Q(np.array((*AXIS, np.radians(degrees))), ignoreAllChk=True)
    matrix = spin.Q2DCM(q.copy()).reshape(3, 3)
    back = spin.Q2EV(q.copy())
    moved = spin.Q2EV(np.roll(q, -1, axis=1))
    again = spin.EV2DCM(spin.DCM2EV(matrix.copy()), ignoreAllChk=True).reshape(3, 3)
    trip = error(Rotation.from_matrix(matrix), Rotation.from_matrix(again))
    by_matrix = Rotation.from_matrix(spin.Q2DCM(spin.DCM2Q(matrix.copy())).reshape(3, 3))
    print(f"{degrees:g} degrees about {AXIS.round(3)}: Q2EV has {np.degrees(back[0, 3]):.1f} about"
          f" {back[0, :3].round(3) + 0.0}, an error of {error(true, rotation(back)):.1f} degrees; DCM to EV to DCM"
          f" {trip:.1f}; Q2EV with the scalar at the end {error(true, rotation(moved)):.1f}")
    written = Rotation.from_quat(q[0], scalar_first=True)
    read = Rotation.from_quat(q[0], scalar_first=False)
    ok &= error(true, written) < 1e-5 and error(true, rotation(moved)) < 1e-5
    ok &= error(Rotation.from_matrix(matrix), true.inv()) < 1e-5 and error(by_matrix, true.inv()) < 1e-5
    ok &= error(read, rotation(back)) < 1e-5 and error(true, rotation(back)) > 60.0 and trip > 60.0
    if degrees == 0.0:
        ok &= abs(np.degrees(back[0, 3]) - 180.0) < 1e-9 and abs(abs(back[0, 0]) - 1.0) < 1e-12
sys.exit(not ok)
PY
