#!/usr/bin/env bash
# nfoursid 1.0.2: `Kalman.step(y, u)` is a step of a Kalman filter. The output may be missing, as y=None. Then
# the mean is predicted as it should be. But the covariance is updated as if a measurement had come. Nothing warns. So
# the standard deviations of `to_dataframe` stay small in a gap, while errors grow without bound. For a random walk of
# variance 1 per step, measured with variance 1, 50 steps without measurements leave a variance of 0.6 in place of 50.6.
# The filter is overconfident by a factor of 80, and gives the first measurement after the gap too little weight.
# Law: without a measurement, the covariance becomes A P A' + Q. So it is with a sensor whose noise is without bound,
# and the squared errors of 20000 simulated walks agree.
# Upstream: in issue 3 of github.com/spmvg/nfoursid, which brought missing outputs, the maintainer takes the update of
# the covariance for necessary. No issue that was found says that it is overconfident.
# Right is a filter with a `noise_covariance` whose first block is huge, from the state of the last measurement on.
# Prints variances along a gap, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'nfoursid==1.0.2' 'numpy==2.4.6' 'pandas==2.3.3' \
  'matplotlib==3.11.2'
cd "$folder"
MPLBACKEND=Agg "$folder/venv/bin/python" - <<'PY'
import sys
import warnings
from importlib.metadata import version

import numpy as np
from nfoursid.kalman import Kalman
from nfoursid.state_space import StateSpace

warnings.simplefilter("error")
print("nfoursid", version("nfoursid"))
BEFORE, GAP, WALKS = 30, 50, 20000
ONE = np.ones((1, 1))


def filter_of(noise):
    """Filter of a random walk with variance 1 per step, whose sensor has a variance ``noise``."""
    return Kalman(StateSpace(ONE, np.ones((1, 0)), ONE, np.ones((1, 0))), np.diag((noise, 1.0)))


random = np.random.default_rng(0)
walks = np.cumsum(random.normal(size=(WALKS, BEFORE + GAP)), axis=1) + random.normal(size=(WALKS, 1))
noisy = walks[:, :BEFORE] + random.normal(size=(WALKS, BEFORE))
seen = filter_of(1.0)
for y in noisy[0]:
    seen.step(np.full((1, 1), y), np.zeros((0, 1)))
settled = seen.p_filtereds[-1].item()
for _ in range(GAP):
    seen.step(None, np.zeros((0, 1)))
blind = filter_of(1e12)  # a measurement without information, from the same covariance on
blind.x_predicteds, blind.p_predicteds = [seen.x_predicteds[BEFORE - 1]], [seen.p_predicteds[BEFORE - 1]]
for _ in range(GAP):
    blind.step(np.zeros((1, 1)), np.zeros((0, 1)))
# The same gains for all walks: they do not depend on the data.
mean = np.zeros(WALKS)
for gain, y in zip(seen.kalman_gains[:BEFORE], noisy.T):
    mean += gain.item() * (y - mean)
ok = np.isclose(mean[0], seen.x_filtereds[-1].item()) and np.isclose(settled, 0.5 * (np.sqrt(5.0) - 1.0))
for steps in (1, 5, 20, GAP):
    found = seen.p_filtereds[BEFORE + steps - 1].item()
    right = blind.p_filtereds[steps - 1].item()
    error = np.mean((walks[:, BEFORE + steps - 1] - mean) ** 2)
    print(f"{steps} steps without a measurement: variance {found:.3f}; settled + steps {settled + steps:.3f}; by a"
          f" sensor without information {right:.3f}; of simulated errors {error:.2f}")
    ok &= np.isclose(found, settled, rtol=1e-6) and np.isclose(right, settled + steps, rtol=1e-6)
    ok &= np.isclose(error, settled + steps, rtol=0.05)
deviation = seen.to_dataframe().droplevel(0, axis=1)["next predicted (no input)", "standard deviation"].iloc[-1]
print(f"standard deviation of the next output by to_dataframe: {deviation:.2f}; right is"
      f" {np.sqrt(settled + GAP + 2.0):.2f}")
ok &= np.isclose(deviation, np.sqrt(settled + 2.0), rtol=1e-6)
sys.exit(not ok)
PY
