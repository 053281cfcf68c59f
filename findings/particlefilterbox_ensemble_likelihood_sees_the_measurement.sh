#!/usr/bin/env bash
# particlefilterbox 0.1.0: `EnsemblePF.filter` corrects an ensemble by the ensemble Kalman filter, and returns the
# logarithm of the likelihood of the data. The likelihood of a measurement is its density before it is seen, by the
# predicted ensemble. The library takes the ensemble that the measurement has corrected already, whose mean is close to
# the measurement. Nothing warns. So the likelihood is far too large, by 275 for 100 measurements of a random walk. It
# grows as the assumed noise falls, so the noise that fits best is the least one that is tried.
# Law: the Gaussian density of the linear model, by SciPy 1.17.1. The library's own `BootstrapPF` agrees with it within
# 3, and finds the true noise.
# Upstream: no issue of github.com/nodesecon/particlefilterbox that was found describes it.
# The filtered means are right.
# Prints the likelihoods for five assumed noises, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'particlefilterbox==0.1.0' 'numpy==2.4.6' \
  'scipy==1.17.1' 'pandas==3.1.1'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
from particlefilterbox.core.config import PFConfig
from particlefilterbox.core.model import ParticleFilterModel
from particlefilterbox.filters import BootstrapPF, EnsemblePF
from scipy.stats import multivariate_normal, norm

STEPS, NOISE = 100, 0.5


class Walk(ParticleFilterModel):
    """Random walk with steps of the deviation 1 from zero, measured with the deviation `sigma_y`."""

    k_states = k_obs = 1

    def __init__(self, sigma_y):
        self.sigma_y = sigma_y

    def transition(self, particles, t, rng):
        return particles + rng.normal(size=particles.shape)

    def log_observation_likelihood(self, particles, y_t, t):
        return norm.logpdf(y_t, particles[:, 0], self.sigma_y)

    def initial_distribution(self, n_particles, rng):
        return np.zeros((n_particles, 1))


random = np.random.default_rng(0)
data = np.cumsum(random.normal(size=STEPS)) + random.normal(0.0, NOISE, STEPS)
steps = np.arange(1, STEPS + 1)
noises, table, apart = (0.1, 0.25, NOISE, 1.0, 2.0), [], 0.0
for noise in noises:
    covariance = np.minimum.outer(steps, steps) + noise**2 * np.eye(STEPS)
    config = PFConfig(n_particles=4000, seed=0)
    results = [kind(Walk(noise), config).filter(data) for kind in (EnsemblePF, BootstrapPF)]
    row = [multivariate_normal.logpdf(data, np.zeros(STEPS), covariance), *(r.log_likelihood for r in results)]
    apart = max(apart, np.abs(results[0].filtered_means - results[1].filtered_means).max())
    print(f"assumed noise {noise:g}: by SciPy {row[0]:.1f}, BootstrapPF {row[2]:.1f}, EnsemblePF {row[1]:.1f}")
    table.append(row)
true, ensemble, bootstrap = np.array(table).T
best = [noises[column.argmax()] for column in (true, ensemble, bootstrap)]
print(f"most likely noise: by SciPy {best[0]}, BootstrapPF {best[2]}, EnsemblePF {best[1]}; the means of both filters",
      f"are up to {apart:.2f} apart")
ok = np.abs(bootstrap - true).max() < 5.0 and apart < 0.2 and best == [NOISE, noises[0], NOISE]
sys.exit(not (ok and (np.diff(ensemble) < -10.0).all() and ensemble[0] - true[0] > 200.0))
PY
