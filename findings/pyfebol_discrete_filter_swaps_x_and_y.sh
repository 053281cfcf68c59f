#!/usr/bin/env bash
# PyFEBOL 0.5.4: `DiscreteFilter` localises a transmitter by its bearings on a grid, whose rows are y and whose columns
# are x. `centroid()` takes the rows for x and the columns for y. Nothing warns. A target in the lower right corner of
# the domain is reported in the upper left one. `covariance()` exchanges the two variances too.
# Law: the mean of the library's own grid, by the coordinates that its update gives to the cells, is close to the
# target.
# Upstream: no issue of github.com/cdrckrgt/PyFEBOL that was found describes it.
# On the diagonal of the domain, the centroid is right.
# Prints the centroids for some targets, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'PyFEBOL==0.5.4' 'numpy==2.4.6' 'scipy==1.17.1' \
  'fast-histogram==0.14'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys
import warnings
from importlib.metadata import version

import numpy as np
from PyFEBOL.filter import DiscreteFilter
from PyFEBOL.searchdomain import SearchDomain
from PyFEBOL.sensor import BearingOnlySensor

LENGTH, BUCKETS, NOISE = 100.0, 50, 3.0  # m; cells of a side; degrees
POSES = [(x, y, 0.0) for x, y in ((5.0, 5.0), (95.0, 95.0), (5.0, 95.0), (95.0, 5.0), (50.0, 5.0), (5.0, 50.0))]
print("PyFEBOL", version("PyFEBOL"))
warnings.simplefilter("error")
centers = (np.arange(BUCKETS) + 0.5) * LENGTH / BUCKETS
ok = True
for target in ((80.0, 20.0), (20.0, 80.0), (70.0, 45.0), (60.0, 60.0)):
    np.random.seed(0)
    domain, sensor = SearchDomain(LENGTH, init=np.divide(target, LENGTH).tolist()), BearingOnlySensor(NOISE)
    grid = DiscreteFilter(domain, BUCKETS, sensor)
    for pose in 4 * POSES:
        grid.update(pose, sensor.observe(domain.getTheta(), pose))
    columns, rows = grid.df.sum(axis=0), grid.df.sum(axis=1)
    x, y = columns @ centers, rows @ centers
    seen = grid.centroid()
    print(f"target at {target}: centroid ({seen[0]:.1f}, {seen[1]:.1f}); mean of the grid ({x:.1f}, {y:.1f})")
    ok &= np.allclose(seen, (y, x)) and np.linalg.norm((x - target[0], y - target[1])) < 5.0
    ok &= np.allclose(np.diag(grid.covariance()), (rows @ (centers - y) ** 2, columns @ (centers - x) ** 2))
sys.exit(not ok)
PY
