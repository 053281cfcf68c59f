#!/usr/bin/env bash
# pose3d 2.1.0: `ER.from_angle_axis` sets a rotation from an angle-axis vector, whose direction is the axis and whose
# length is the angle. It divides the vector by its length first, and hands the rest to SciPy as a rotation vector. So
# every vector gives a turn by one radian, 57.3 degrees, about the right axis. Nothing warns. What
# `as_angle_axis(normalized=False)` gives does not come back, unless its length is one.
# Law: a round trip keeps the rotation, and a turn by 90 degrees about z takes x to y.
# Upstream: issues of gitlab.com/johnhal/pose3d_python could not be searched; none found elsewhere describes it.
# `from_quat` and `from_matrix` are right.
# Prints the turns for six angles, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'numpy==2.4.6' 'scipy==1.17.1' 'toml==0.10.2'
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install --no-deps 'pose3d==2.1.0'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
from pose3d import ER
from scipy.spatial.transform import Rotation

AXIS = np.array((2.0, -1.0, 2.0)) / 3.0
ok = True
for degrees in (0.5, 10.0, 57.29577951308232, 90.0, 120.0, 179.0):
    true = Rotation.from_rotvec(np.radians(degrees) * AXIS)
    source, found = ER(), ER()
    source.from_quat(true.as_quat())
    vector = source.as_angle_axis(normalized=False)
    assert np.allclose(vector, true.as_rotvec())
    found.from_angle_axis(vector)
    turn = Rotation.from_matrix(found.as_matrix())
    angle, off = np.degrees(turn.magnitude()), np.degrees((true.inv() * turn).magnitude())
    print(f"{degrees:.2f} degrees: comes back as {angle:.2f} degrees, off by {off:.2f}")
    ok &= np.allclose(turn.as_rotvec(), AXIS) and np.isclose(off, abs(degrees - np.degrees(1.0)), atol=1e-6)
quarter = ER()
quarter.from_angle_axis(np.array((0.0, 0.0, np.pi / 2)))
seen = quarter.apply(np.array((1.0, 0.0, 0.0)))
print(f"a turn by 90 degrees about z takes x to {np.round(seen, 4).tolist()}")
ok &= np.allclose(seen, (np.cos(1.0), np.sin(1.0), 0.0))
sys.exit(not ok)
PY
