#!/usr/bin/env bash
# TFiltersPy 1.0.6: `KalmanFilter(..., store_covariances=False)` is documented to save memory for long series, at the
# cost of `smooth` alone, which raises an error. `forecast(n)` then starts from the last state of the filter, but from
# the covariance `P0` before the first measurement. Nothing warns. 200 positions have a noise of 0.1 m. The
# forecast of the next one has a standard deviation of 10 m in place of 0.08 m. If `P0` is small, it is overconfident.
# Law: to keep a history changes no number. The covariance of a forecast follows from the filter's last one. For a
# filter in its steady state, it does not depend on `P0`.
# Upstream: no issue of github.com/ubunye-ai-ecosystems/tfilterspy that was found describes it.
# The forecast states are right. With `store_covariances=True`, the covariances are right too.
# Prints the standard deviations of forecasts, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'tfilterspy==1.0.6' 'numpy==2.4.6' 'scipy==1.17.1' \
  'dask==2026.8.0'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys
import warnings
from importlib.metadata import version

import numpy as np
from tfilterspy import KalmanFilter

STEP, COUNT, AHEAD = 0.1, 200, 5  # s
F, H = np.array(((1.0, STEP), (0.0, 1.0))), np.array(((1.0, 0.0),))
Q, R = 0.1 * np.array(((STEP**3 / 3.0, STEP**2 / 2.0), (STEP**2 / 2.0, STEP))), np.array(((0.01,),))
print("TFiltersPy", version("tfilterspy"))
warnings.simplefilter("error")
random = np.random.default_rng(0)
velocity = np.cumsum(random.normal(scale=np.sqrt(0.1 * STEP), size=COUNT))
measured = (STEP * np.cumsum(velocity) + random.normal(scale=0.1, size=COUNT))[:, None]


def forecast(prior, stored):
    """States and standard deviations of positions [m] ahead, for a standard deviation before the first measurement."""
    found = KalmanFilter(F, H, Q, R, np.zeros(2), prior**2 * np.eye(2), store_covariances=stored).fit(measured)
    states, covariances = found.forecast(AHEAD)
    return states, np.sqrt(covariances[:, 0, 0])


ok = True
for prior in (10.0, 1.0, 0.01):
    (states, true), (other, seen) = forecast(prior, True), forecast(prior, False)
    start = np.sqrt((F @ F.T * prior**2 + Q)[0, 0])
    print(f"standard deviation of {prior:g} before the first of {COUNT} positions: forecasts of 1 and {AHEAD} steps"
          f" have {true[0]:.3f} and {true[-1]:.3f} m; without the history {seen[0]:.3f} and {seen[-1]:.3f} m")
    ok &= np.allclose(states, other) and np.isclose(true[0], 0.0751, atol=1e-3) and np.isclose(seen[0], start)
ok &= forecast(0.01, False)[1][0] < 0.3 * forecast(0.01, True)[1][0]
sys.exit(not ok)
PY
