#!/usr/bin/env bash
# FilterPy 2.0.0: `kinematic_kf(dim, order, dt, dim_z)` makes a filter of constant velocity, acceleration and so on. Its
# documentation has "the measurement is position, one per dimension". The library writes a one for each dimension into
# each row of H. So each measurement is that of the sum of all coordinates. Nothing warns. A robot that stands at (2, 5)
# and measures just that is found at (1.75, 1.75). No measurement tells the difference of x and y.
# Without `dim_z`, the filter of two dimensions has one measurement, the sum.
# Law: a filter that gets the true position again and again finds it. One dimension is right.
# Upstream: github.com/rlabbe/filterpy/issues/229, open, tells that `dim_z` is ignored; the closed issue 206 tells that
# H is assigned incorrectly.
# `kf.H = np.kron(np.eye(dim), np.eye(1, order + 1))` is right.
# Prints H and the estimates of a body at rest, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'filterpy==2.0.0' 'numpy==2.4.6' 'scipy==1.17.1'
cd "$folder"
"$folder/venv/bin/python" -W ignore - <<'PY'
import sys

import numpy as np
from filterpy.common import kinematic_kf

TRUE = np.array((2.0, 5.0))
ok = True
for repaired in (False, True):
    kf = kinematic_kf(dim=2, order=1, dt=0.1, dim_z=2)
    kf.Q *= 1e-9
    if repaired:
        kf.H = np.kron(np.eye(2), np.eye(1, 2))
    for _ in range(300):
        kf.predict()
        kf.update(TRUE[:, None])
    expected = np.array((kf.x[0, 0] + kf.x[2, 0], kf.x[0, 0] - kf.x[2, 0]))
    position = kf.x[[0, 2], 0]
    total = np.array((1.0, 0.0, 1.0, 0.0))
    print(f"H {kf.H.tolist()}: the position is {position.round(4)}, truly {TRUE}; the deviation of x + y is"
          f" {np.sqrt(total @ kf.P @ total):.3f} m, that of x {np.sqrt(kf.P[0, 0]):.3f} m")
    ok &= bool(np.allclose(position, TRUE if repaired else (1.75, 1.75), atol=0.05))
    ok &= bool(np.all(kf.H == (((1, 0, 0, 0), (0, 0, 1, 0)) if repaired else ((1, 0, 1, 0), (1, 0, 1, 0)))))
sums = [kinematic_kf(2, 1).H.tolist(), kinematic_kf(3, 2, dim_z=3, order_by_dim=False).H.tolist()]
print(f"without dim_z: {sums[0]}; three dimensions, ordered by derivatives: {sums[1]}")
one = kinematic_kf(1, 2).H
print(f"one dimension: {one.tolist()}")
ok &= sums == [[[1.0, 0.0, 1.0, 0.0]], [[1.0] * 3 + [0.0] * 6] * 3] and one.tolist() == [[1.0, 0.0, 0.0]]
sys.exit(not ok)
PY
