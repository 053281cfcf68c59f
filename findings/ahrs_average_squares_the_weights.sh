#!/usr/bin/env bash
# AHRS 0.4.0: `QuaternionArray.average(weights=...)` is Markley's average, for which the documentation sums w q q^T. It
# multiplies each quaternion by its weight, and then each with itself, so the sum has the weight's square. Nothing
# warns. An attitude with weight 3 beside one with weight 1 counts 9 times as much: the average of headings of 0 and 10
# degrees is 9.0 in the place of 7.5 degrees. A negative weight counts like a positive one.
# Law: a quaternion of weight 3 is worth three equal quaternions. `Rotation.mean` of SciPy 1.17.1 says so too, and is
# equal to the library where SciPy is given squares. Equal weights are right.
# Prints the averages of two headings for some weights, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'ahrs==0.4.0' 'numpy==2.4.6' 'scipy==1.17.1'
cd "$folder"
"$folder/venv/bin/python" -W ignore - <<'PY'
import sys

import numpy as np
from ahrs import QuaternionArray
from scipy.spatial.transform import Rotation

HEADINGS = np.array((0.0, 10.0))


def quaternions(headings):
    """Quaternions (w, x, y, z) of level attitudes with headings in degrees."""
    rotations = Rotation.from_euler("z", np.array(headings)[:, None], degrees=True)
    return np.ascontiguousarray(rotations.as_quat()[:, [3, 0, 1, 2]])


def heading(q):
    """Heading of a quaternion (w, x, y, z), in degrees."""
    return np.degrees(2.0 * np.arctan2(q[3] * np.sign(q[0]), abs(q[0])))


ok = True
for weights in ((1, 1), (1, 3), (2, 1), (1, 10)):
    found = heading(QuaternionArray(quaternions(HEADINGS)).average(weights=np.array(weights, float)))
    repeated = heading(QuaternionArray(quaternions(np.repeat(HEADINGS, weights))).average())
    rotations = Rotation.from_euler("z", HEADINGS[:, None], degrees=True)
    mean, squared = (np.degrees(rotations.mean(np.array(weights) ** power).as_rotvec()[2]) for power in (1, 2))
    print(f"headings of 0 and 10 degrees with weights {weights}: {found:.3f}, by SciPy {mean:.3f}, by it with squared"
          f" weights {squared:.3f}, of repeated quaternions without weights {repeated:.3f} degrees")
    ok &= abs(found - squared) < 1e-6 and abs(repeated - mean) < 1e-6
    ok &= (abs(found - mean) > 0.5) == (weights != (1, 1))
sys.exit(not ok)
PY
