#!/usr/bin/env bash
# gpder 1.0.1: `GPUncertaintyOptimizer.minimize_variance(X_util, ..., gamma=g)` plans measurements that reduce the
# variance of a Gaussian process at the points `X_util`, to which it adds noise. `gamma` is documented as the square
# root of the noise's variance, which is gamma^2. The noise has the standard deviation gamma^2, so the variance
# gamma^4: for gamma = 0.1, points move by 0.01, and for gamma = 2 by 4. Nothing warns. What gamma means depends on the
# unit of length: 0.1 m moves points by 1 cm, and 100 mm by 10 m.
# In bayes/bayes_opt.py, `random_state.normal` gets `scale=self.gamma**2`, where it takes a standard deviation.
# Law: the sample deviation of the noise is the square root of its documented variance, in any unit.
# Upstream: no issue of github.com/alexxromero/gpder that was found describes it.
# The square root of the deviation, as `gamma`, is right.
# Prints deviations for four values, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'gpder==1.0.1' 'numpy==2.4.6' 'scipy==1.17.1' \
  'scikit-learn==1.9.1'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
from gpder.bayes import GPUncertaintyOptimizer
from gpder.gaussian_process import GaussianProcessRegressor
from gpder.gaussian_process.kernels import RegularKernel

X = np.array([[-40.0], [0.0], [40.0]])
points = np.linspace(-5.0, 5.0, 300)[:, None]

def deviation(gamma):
    """Standard deviation of what was added to ``points``."""
    gp = GaussianProcessRegressor(RegularKernel(amplitude=1.0, length_scale=5.0, noise_level=0.1), optimizer=None)
    gp.fit(X, np.sin(X))
    plan = GPUncertaintyOptimizer(gp, {"x": (-50.0, 50.0)}, np.sin, random_state=0, verbose=False)
    plan.minimize_variance(points, 1, gamma=gamma, n_restarts_optimizer=0)
    return float(np.std(plan._X_util_temp - points))


ok = True
for gamma in (0.1, 0.5, 1.0, 2.0):
    found, repaired = deviation(gamma), deviation(np.sqrt(gamma))
    print(f"gamma {gamma}: standard deviation {found:.4f}, with its square root {repaired:.4f}")
    ok &= np.isclose(found, gamma**2, rtol=0.1) and np.isclose(repaired, gamma, rtol=0.1)
sys.exit(not ok)
PY
