#!/usr/bin/env bash
# minkf 0.0.5: `run_filter(..., likelihood=True)` returns `loglike`, documented as the log-likelihood of the data, for
# "estimating hyperparameters". For an innovation r with covariance C, it adds r' C^-1 r / 2 and log det(2 pi C). The
# second term lacks its half. Nothing warns. The sign is turned too, so it grows as the data get less likely. Who takes
# the minimum in place of the maximum still gets wrong variances: all of them are half the right ones, and the filter is
# overconfident.
# Law: the logarithm of the Gaussian density, by SciPy 1.17.1. For independent measurements of a constant, the most
# likely variance is the mean square of the residuals.
# Upstream: no issue of github.com/solbes/minkf that was found describes it.
# Right is the negative of `loglike` plus half of the sum of log det(2 pi C), with C of `predict_y=True`.
# Prints the likelihood and the best variances, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'minkf==0.0.5' 'numpy==2.4.6' 'scipy==1.17.1'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys
from importlib.metadata import version

import minkf
import numpy as np
from scipy.optimize import minimize, minimize_scalar
from scipy.stats import multivariate_normal

print("minkf", version("minkf"))
COUNT, ONE = 150, np.array([[1.0]])


def by_library(y, q, r):
    """``loglike`` of the random walk ``y`` for the variances ``q`` and ``r``, and the likelihood by the workaround."""
    found = minkf.run_filter(list(y[:, None]), np.zeros(1), 0.0 * ONE, ONE, ONE, q * ONE, r * ONE, likelihood=True,
                             predict_y=True)
    seen = float(found["loglike"])
    return seen, 0.5 * sum(np.log(np.linalg.det(2.0 * np.pi * c)) for c in found["Cyp"]) - seen


def by_scipy(y, q, r):
    """Logarithm of the likelihood of the same random walk."""
    steps = np.arange(1, len(y) + 1)
    return multivariate_normal.logpdf(y, np.zeros(len(y)), q * np.minimum.outer(steps, steps) + r * np.eye(len(y)))


random = np.random.default_rng(0)
noise = random.normal(size=COUNT)
(seen, repaired), right = by_library(noise, 1e-12, 1.0), by_scipy(noise, 1e-12, 1.0)
print(f"{COUNT} measurements of zero: loglike {seen:.2f}; by SciPy {right:.2f}; with half the term {repaired:.2f}")
ok = np.isclose(repaired, right, rtol=1e-6) and not np.isclose(-seen, right, rtol=0.1)
best = minimize_scalar(lambda r: by_library(noise, 1e-12, r)[0], bounds=(0.05, 5.0), method="bounded").x
square = np.mean(noise**2)
print(f"variance with the least loglike {best:.4f}; mean square {square:.4f}, ratio {best / square:.4f}")
ok &= np.isclose(best / square, 0.5, atol=1e-3)
walk = np.cumsum(random.normal(scale=0.5, size=COUNT)) + random.normal(size=COUNT)
fits = [np.exp(minimize(cost, np.zeros(2), method="Nelder-Mead").x) for cost in (
    lambda x: by_library(walk, *np.exp(x))[0], lambda x: -by_scipy(walk, *np.exp(x)))]
print(f"random walk with the variances 0.25 and 1: by loglike {fits[0][0]:.3f} and {fits[0][1]:.3f}; by SciPy"
      f" {fits[1][0]:.3f} and {fits[1][1]:.3f}")
ok &= np.allclose(fits[0] / fits[1], 0.5, atol=0.01)
sys.exit(not ok)
PY
