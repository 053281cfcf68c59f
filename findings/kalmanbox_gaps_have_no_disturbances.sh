#!/usr/bin/env bash
# kalmanbox 0.1.0: `DisturbanceSmoother().smooth(y, ssm)` estimates the disturbances of the state from all measurements,
# with their variances, "for outlier and structural break detection". Missing measurements are allowed, as NaN. At each
# of them, it leaves out the disturbance of the state too: the mean is zero, and the variance that of the prior. But the
# measurements before and after the gap tell what happened in between. Nothing warns. For a target that moves by 12 m in
# a gap, the disturbances add up to 1.2 m. The library's own smoother moves the state by 1.2 m in each step of the gap.
# Law: smoothed states and disturbances fulfil the model, a_(t+1) = T a_t + R eta_t, at every step. Conditioning the
# joint Gaussian of all disturbances on the measurements, with NumPy, gives their means and variances.
# Upstream: no public issue that was found describes it.
# Right in a gap are Q R' r and Q - Q R' N R Q with the r and N that the library returns, of the next step.
# Prints disturbances beside those of the smoothed states, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install --no-deps 'kalmanbox==0.1.0' 'numpy==2.4.6' \
  'scipy==1.17.1' 'pandas==2.3.3' 'python-dateutil==2.9.0.post0' 'pytz==2026.6' 'tzdata==2026.6' 'six==1.17.0'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys
import warnings
from importlib.metadata import version

import numpy as np
from kalmanbox import StateSpaceRepresentation
from kalmanbox.smoothers.disturbance import DisturbanceSmoother
from kalmanbox.smoothers.rts import RTSSmoother
from kalmanbox.filters.kalman import KalmanFilter

warnings.simplefilter("error")
print("kalmanbox", version("kalmanbox"))
COUNT, FIRST, LAST, NOISE = 30, 10, 18, 0.01
ssm = StateSpaceRepresentation(1, 1)  # a random walk
ssm.T, ssm.Z, ssm.R, ssm.Q = (np.ones((1, 1)) for _ in range(4))
ssm.H, ssm.P1 = np.full((1, 1), NOISE), np.full((1, 1), 100.0)
y = np.where(np.arange(COUNT) < FIRST, 0.0, 12.0)
y[FIRST:LAST + 1] = np.nan
seen = DisturbanceSmoother().smooth(y, ssm)
states = RTSSmoother().smooth(KalmanFilter().filter(y, ssm), ssm).smoothed_state[:, 0]
moved = np.diff(states)
# The same by conditioning: the walk is the first state and the sum of the disturbances.
known = ~np.isnan(y)
sums = np.tril(np.ones((COUNT, COUNT)))[known]
prior = np.diag(np.r_[100.0, np.ones(COUNT - 1)])
gain = np.linalg.solve(sums @ prior @ sums.T + NOISE * np.eye(known.sum()), sums @ prior).T
mean, variance = (gain @ y[known])[1:], np.diag(prior - gain @ sums @ prior)[1:]
found, spread = seen.smoothed_state_disturbance[:-1, 0], seen.state_disturbance_var[:-1, 0, 0]
gap = np.isnan(y[:-1])
for t in (FIRST - 2, FIRST - 1, FIRST, FIRST + 4, LAST, LAST + 1):
    print(f"step {t}{' (gap)' if gap[t] else ''}: disturbance {found[t]:.3f} with variance {spread[t]:.3f}; the"
          f" smoothed state moves by {moved[t]:.3f}; by conditioning {mean[t]:.3f} with variance {variance[t]:.3f}")
print(f"sum of the disturbances {found.sum():.3f} m; the smoothed state moves by {moved.sum():.3f} m")
repaired = seen.r[1:, 0], 1.0 - seen.N[1:, 0, 0]
ok = np.allclose(mean, moved, atol=1e-6) and np.all(found[gap] == 0.0) and np.all(spread[gap] == 1.0)
ok &= np.allclose(found[~gap], mean[~gap], atol=1e-6) and np.allclose(spread[~gap], variance[~gap], atol=1e-6)
ok &= np.allclose(repaired[0], mean, atol=1e-6) and np.allclose(repaired[1], variance, atol=1e-6)
ok &= np.all(mean[gap] > 1.1) and np.isclose(moved.sum(), 12.0, atol=0.1) and found.sum() < 2.0
sys.exit(not ok)
PY
