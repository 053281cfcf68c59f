#!/usr/bin/env bash
# ekf-slam 0.0.2: `KnownCorrespondence.update(z)` corrects a robot and its map by ranges and bearings. The difference of
# a measured and an expected bearing has to be wrapped into half a turn. The library wraps that of the range too. So a
# range that is 4 m longer than expected counts as 2.28 m shorter. Nothing warns. A robot whose wheels slip for 4 m
# measures that it stands still. The filter moves it by 6.28 m, and its covariance is as small as for the true place.
# Law: a unit of length must not matter. With lengths in units of 10 m, the same numbers give the true place.
# Textbook: Thrun, Burgard, Fox, Probabilistic Robotics, table 10.1: the innovation of a range is a plain difference.
# Upstream: no issue of github.com/achen4290/ekf-slam that was found describes it.
# Differences of ranges below 3.14 units are right.
# Prints the position after slips of 1 to 6 m, in metres and in units of 10 m, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'ekf-slam==0.0.2' 'numpy==2.4.6'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys
from importlib.metadata import version

import numpy as np
from ekf_slam import KnownCorrespondence

RANGE, RANGE_STD, BEARING_STD, SLIP_STD = 20.0, 0.1, 0.01, 5.0  # m, m, rad, m
print("ekf-slam", version("ekf-slam"))


def place(slip, unit):
    """Estimate [m] of a robot that stands at 0, and its standard deviation, if the wheels turn for ``slip`` metres."""
    noise = np.diag(((RANGE_STD / unit) ** 2, BEARING_STD**2))
    motion = np.diag(((SLIP_STD / unit) ** 2, (0.01 / unit) ** 2, 1e-8))
    ekf = KnownCorrespondence(np.zeros(3), 1, noise, motion)
    seen = np.array([[RANGE / unit, 0.0, 0.0]])  # one landmark straight ahead
    ekf.update(seen)
    ekf.predict(np.array((slip / unit, 0.0)))
    ekf.update(seen)
    return ekf.robot_pos()[0] * unit, np.sqrt(ekf.cov[0, 0]) * unit


ok = True
for slip in (1.0, 2.0, 3.0, 4.0, 5.0, 6.0):
    (metres, std), (tens, _) = place(slip, 1.0), place(slip, 10.0)
    print(f"slip of {slip:g} m: at {metres:.2f} m, standard deviation {std:.2f} m; with units of 10 m at {tens:.2f} m;"
          " truly at 0.00 m")
    ok &= abs(tens) < 0.05 and std < 0.3 and abs(metres - (0.0 if slip < np.pi else 2.0 * np.pi)) < 0.05
sys.exit(not ok)
PY
