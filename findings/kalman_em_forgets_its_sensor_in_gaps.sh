#!/usr/bin/env bash
# kalman-em 0.2.3: `KalmanEM.fit(Y)` estimates a linear model of states and measurements by expectation maximization.
# Missing measurements are allowed, as NaN. To estimate the observation matrix H, the products of measurements and
# states are summed over the measurements that there are. The squares of the states, by which they are divided, are
# summed over all steps. Nothing warns. With half of the measurements missing, H is about half of its value after one
# step, and goes to zero in the next ones. The likelihood, which cannot fall in this method, falls in each step. The
# fit starts at the true model here. Without gaps, it stays there.
# Prints H and the likelihoods, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'kalman-em==0.2.3' 'numpy==2.4.6' 'scipy==1.17.1'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
from kalman_em import KalmanEM
from scipy.stats import multivariate_normal

F, H, Q, R = 0.95, 2.0, 0.09, 0.25
rng = np.random.default_rng(0)
x = np.zeros(400)
for t in range(1, len(x)):
    x[t] = F * x[t - 1] + rng.normal(0.0, Q**0.5)
y = H * x + rng.normal(0.0, R**0.5, len(x))
gaps = rng.random(len(x)) < 0.5
truth = {"F": [[F]], "H": [[H]], "Q": [[Q]], "R": [[R]], "mu0": [0.0], "Sigma0": [[1.0]]}


def log_likelihood(params, y):
    """The joint density of the measurements that there are, by the covariance of all of them."""
    F, H, Q, R, mu, variance = (float(np.ravel(params[key])[0]) for key in ("F", "H", "Q", "R", "mu0", "Sigma0"))
    means, variances = [], []
    for _ in y:  # as the library does, with a step before the first measurement
        mu, variance = F * mu, F * F * variance + Q
        means.append(mu)
        variances.append(variance)
    index = np.arange(len(y))
    lag = np.abs(index[:, None] - index)
    states = F**lag * np.array(variances)[np.minimum(index[:, None], index)]
    seen = ~np.isnan(y)
    covariance = H * H * states[np.ix_(seen, seen)] + R * np.eye(seen.sum())
    return float(multivariate_normal(H * np.array(means)[seen], covariance).logpdf(y[seen]))


found = {}
for name, data in (("complete", y), ("with gaps", np.where(gaps, np.nan, y))):
    row = []
    for steps in (1, 2, 3, 20):
        model = KalmanEM(d=1, n_iter=steps, tol=0.0, verbose=False)
        model.fit(data, init_params={key: np.array(value) for key, value in truth.items()}, standardise=False)
        row.append((float(model.params_["H"][0, 0]), log_likelihood(model.params_, data)))
    start = log_likelihood(truth, data)
    assert abs(start - model.log_liks_[0]) < 1e-6
    print(f"{name}: H {[round(h, 3) for h, _ in row]} after 1, 2, 3 and 20 steps; log likelihoods of the results",
          f"{[round(value, 1) for _, value in row]}, at the true model {start:.1f}")
    found[name] = row, start
(complete, start), (gapped, gapped_start) = found["complete"], found["with gaps"]
ok = all(1.7 < h < 2.3 and value > start for h, value in complete)
ok &= gapped_start - 10.0 > gapped[0][1] > gapped[3][1] + 50.0
sys.exit(not (ok and gapped[0][0] < 1.1 and abs(gapped[3][0]) < 0.1))
PY
