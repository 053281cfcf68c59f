#!/usr/bin/env bash
# AHRS 0.4.0: `filters.AngularRate(method="series")` integrates a gyroscope by the series of a matrix exponential, cut
# after `order` terms. Its documentation has powers of the matrix. The code raises each *element* to the power, so all
# terms but the first are wrong, and more of them do not help. After 10 s of 3 rad/s at 100 Hz, the default order 1 is
# off by 0.13 degrees, order 2 and all higher ones by 4.33.
# Law: the series of order k misses less than a term of order k + 1, so order 8 equals the closed form.
# Upstream: no issue of github.com/Mayitzin/ahrs that was found describes it.
# `method="closed"`, the default, is right.
# Prints the error of each order, and of the same series with powers of the matrix, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'ahrs==0.4.0' 'numpy==2.4.6' 'scipy==1.17.1'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import math
import sys

import numpy as np
from ahrs.filters import AngularRate
from scipy.spatial.transform import Rotation

OMEGA, STEP, COUNT = np.array((1.0, -2.0, 2.0)), 0.01, 1000  # rad/s in axes of the body, s
x, y, z = OMEGA
MATRIX = 0.5 * STEP * np.array(((0, -x, -y, -z), (x, 0, z, -y), (y, -z, 0, x), (z, y, -x, 0)))
truth = Rotation.from_rotvec(OMEGA * STEP * COUNT)


def error(q):
    """Angle [degrees] between the quaternion ``q``, scalar first, and the true orientation."""
    return math.degrees((Rotation.from_quat(q, scalar_first=True) * truth.inv()).magnitude())


rates, found = np.tile(OMEGA, (COUNT + 1, 1)), {}
for order in (1, 2, 3, 8):
    by_library = AngularRate(gyr=rates, frequency=1.0 / STEP, method="series", order=order).Q[-1]
    step = sum(np.linalg.matrix_power(MATRIX, k) / math.factorial(k) for k in range(order + 1))
    by_matrix = np.linalg.matrix_power(step, COUNT)[:, 0]
    found[order] = error(by_library), error(by_matrix)
    print(f"order {order}: off by {found[order][0]:.4f} degrees; with powers of the matrix {found[order][1]:.1e}")
closed = error(AngularRate(gyr=rates, frequency=1.0 / STEP, method="closed").Q[-1])
print(f"closed form: off by {closed:.1e} degrees")
ok = closed < 1e-6 and abs(found[1][0] - found[1][1]) < 1e-6 and found[8][1] < 1e-6
sys.exit(not (ok and all(found[order][0] > 4.0 for order in (2, 3, 8))))
PY
