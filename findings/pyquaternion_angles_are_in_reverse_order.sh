#!/usr/bin/env bash
# pyquaternion 0.9.9: `yaw_pitch_roll` is documented as intrinsic angles of the convention z-y'-x'': yaw about z, then
# pitch about the new y, then roll about the newest x. It returns the angles of the reverse order, first about x. The
# two agree for a single turn alone. A robot that heads 120 degrees and looks down by 30, without roll, is reported to
# look up by 14, with a roll of 27. The next line of the documentation has the matrix of the reverse order.
# Law: the turns by the three angles, in the documented order, compose to the orientation.
# Upstream: the open issue github.com/KieranWynn/pyquaternion/issues/72.
# Prints angles and what they compose to, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'pyquaternion==0.9.9' 'numpy==2.4.6'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
from pyquaternion import Quaternion

AXES = ((0, 0, 1), (0, 1, 0), (1, 0, 0))  # z, y', x''


def composed(angles):
    """The orientation by yaw, pitch and roll [rad] in the documented order: each turn is about an axis of the body."""
    yaw, pitch, roll = (Quaternion(axis=axis, radians=angle) for axis, angle in zip(AXES, angles))
    return yaw * pitch * roll


found = []
for degrees in ((120.0, 0.0, 0.0), (0.0, 30.0, 0.0), (120.0, 30.0, 0.0)):
    orientation = composed(np.radians(degrees))
    angles = orientation.yaw_pitch_roll
    error = (composed(angles).inverse * orientation).degrees
    yaw, pitch, roll = (Quaternion(axis=axis, radians=angle) for axis, angle in zip(AXES, angles))
    reverse = ((roll * pitch * yaw).inverse * orientation).degrees
    print(f"yaw, pitch, roll {degrees}: returned {tuple(np.degrees(angles).round(1).tolist())},",
          f"off by {abs(error):.2g} degrees in the documented order, by {abs(reverse):.2g} in the reverse one")
    found.append((abs(error) < 1e-5, abs(reverse) < 1e-5))
sys.exit(not (found == [(True, True), (True, True), (False, True)] and abs(error) > 20.0))
PY
