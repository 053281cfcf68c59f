#!/usr/bin/env bash
# oflibnumpy 1.1.1: `track_pts(flow, 's', pts)` moves points by a flow field, interpolated bilinearly between the four
# pixels around. It is documented to be a little less exact than `s_exact_mode=True`, with errors "in the order of e-2".
# The library exchanges the weights of two neighbours: the one to the right gets the weight of the one below. Nothing
# warns. So a fraction of a column interpolates along the column, and a fraction of a row along the row. Between a still
# column and one that moves by 5 px, 90 % of the way, a point stands still in place of moving by 4.5 px. In a flow with
# a slope, as of a camera that turns about its axis or zooms, each fraction adds the slope of the other direction.
# Law: bilinear interpolation reproduces each bilinear function. SciPy 1.17.1, and the library's own exact mode for
# linear ones, agree.
# Upstream: no issue of github.com/RViMLab/oflibnumpy that was found describes it.
# Points in whole numbers, and points with equal fractions, are right, and so is `s_exact_mode=True`.
# Prints the errors for some flows and fractions, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install --no-deps 'oflibnumpy==1.1.1' 'numpy==2.4.6' \
  'scipy==1.17.1' 'opencv-python-headless==4.11.0.86'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys
import warnings
from importlib.metadata import version

import numpy as np
import oflibnumpy
from scipy.interpolate import RegularGridInterpolator

warnings.simplefilter("error")
print("oflibnumpy", version("oflibnumpy"))
HEIGHT, WIDTH = 40, 60
row, column = np.mgrid[:HEIGHT, :WIDTH].astype(float)
FLOWS = {  # motion to the right and downwards in px
    "a still half beside one that moves by 5 px": (5.0 * (column > 30), 0.0 * row),
    "turn by 0.1 rad": (-0.1 * (row - 20), 0.1 * (column - 30)),
    "zoom by 10 %": (0.1 * (column - 30), 0.1 * (row - 20)),
}
ok = True
for name, (right, down) in FLOWS.items():
    flow = np.stack((right, down), axis=-1).astype("float32")
    exact = RegularGridInterpolator((np.arange(HEIGHT), np.arange(WIDTH)), flow[..., ::-1].astype(float))
    for fraction in ((0.0, 0.0), (0.0, 0.9), (0.9, 0.0), (0.3, 0.7), (0.5, 0.5)):
        point = np.array([(12.0, 30.0)]) + fraction
        swapped = np.array([(12.0, 30.0)]) + fraction[::-1]
        seen = (oflibnumpy.track_pts(flow, "s", point) - point)[0]
        slow = (oflibnumpy.track_pts(flow, "s", point, s_exact_mode=True) - point)[0]
        due = exact(point)[0]
        error = np.linalg.norm(seen - due)
        print(f"{name}, fractions of row and column {fraction}: moves by {np.round(seen[::-1], 3) + 0.0}, right is"
              f" {np.round(due[::-1], 3) + 0.0}; off by {error:.3f} px, in the exact mode by"
              f" {np.linalg.norm(slow - due):.0e} px")
        ok &= np.allclose(seen, exact(swapped)[0], atol=1e-5)  # as if the fractions were exchanged
        ok &= "still" in name or np.allclose(slow, due, atol=1e-5)
        ok &= (error < 1e-5) == (fraction[0] == fraction[1])
    if "still" in name:
        ok &= np.isclose(exact([(12.0, 30.9)])[0, 1], 4.5) and np.isclose(
            oflibnumpy.track_pts(flow, "s", np.array([(12.0, 30.9)]))[0, 1], 30.9)
sys.exit(not ok)
PY
