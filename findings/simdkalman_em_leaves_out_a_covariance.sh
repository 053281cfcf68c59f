#!/usr/bin/env bash
# simdkalman 1.0.4: `KalmanFilter.em` fits process and measurement noise by expectation maximization, as the project's
# own example does. The step for the process noise needs the covariance between each state and the one before. For step
# j, it takes `pairwise_covariances[j]`, which belongs to j + 1 and j. So it leaves out the first pair, and has a zero
# in place of the last one. Nothing warns. The process noise becomes too large, most where series are short or states
# slow. For 50 measurements of a value that hardly moves, one step from the true variance makes it nine times as large.
# In 8 of 20 series, the likelihood falls.
# Law: a step of expectation maximization never lowers the likelihood of the data. The right step comes from the joint
# Gaussian of all states, by linear algebra alone; it raises the likelihood of all 20 series.
# Upstream: no issue of github.com/oseiskar/simdkalman that was found describes it. A comment there calls `em` undocumented.
# `compute(gains=True)` has the right covariances; a step of one's own has to take those at j - 1.
# Prints the process noise and the likelihood after one step, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'simdkalman==1.0.4' 'numpy==2.4.6'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys
from importlib.metadata import version

import numpy as np
from simdkalman import KalmanFilter

COUNT, SERIES, Q, R, P = 50, 20, 1e-4, 1.0, 1.0  # measurements; series; variances
print("simdkalman", version("simdkalman"))


def likelihood(q, r, y):
    """Logarithm of the likelihood of the series ``y`` for the variances of process and measurement noise."""
    model = KalmanFilter([[1.0]], [[q]], [[1.0]], [[r]])
    return float(model.compute(y[None], 0, [[0.0]], [[P]], smoothed=False, log_likelihood=True).log_likelihood[0])


def expected(y):
    """Right step for both variances, by the joint Gaussian of a random walk; log likelihood but for a constant."""
    prior = P + Q * np.minimum.outer(np.arange(COUNT), np.arange(COUNT))
    total = prior + R * np.eye(COUNT)
    gain = np.linalg.solve(total, prior).T
    mean, covariance = gain @ y, prior - gain @ prior
    second = covariance + np.outer(mean, mean)
    square = np.diag(second)
    q = np.mean(square[1:] + square[:-1] - 2.0 * np.diag(second, -1))
    r = np.mean((y - mean) ** 2 + np.diag(covariance))
    value = -0.5 * (np.linalg.slogdet(total)[1] + y @ np.linalg.solve(total, y))
    return q, r, value


random, rows = np.random.default_rng(0), []
for _ in range(SERIES):
    walk = np.sqrt(P) * random.normal() + np.cumsum(np.r_[0.0, np.sqrt(Q) * random.normal(size=COUNT - 1)])
    y = walk + np.sqrt(R) * random.normal(size=COUNT)
    model = KalmanFilter([[1.0]], [[Q]], [[1.0]], [[R]])
    fitted = model.em(y, n_iter=1, initial_value=np.zeros((1, 1, 1)), initial_covariance=[[P]])
    q, r = fitted.process_noise.item(), fitted.observation_noise.item()
    right_q, right_r, before = expected(y)
    result = model.compute(y[None], 0, [[0.0]], [[P]], smoothed=True, gains=True)
    first = result.pairwise_covariances[0, 0].item()
    shifted = q - 2.0 * first / (COUNT - 1)
    start = likelihood(Q, R, y)
    rows.append((q, right_q, shifted, r, right_r, likelihood(q, r, y) - start,
                 likelihood(right_q, right_r, y) - start, start - before))
q, right_q, shifted, r, right_r, change, right_change, offset = np.array(rows).T
print(f"process noise {Q:g} before; after one step of {SERIES} series, {q.min():.2e} to {q.max():.2e};"
      f" the right step {right_q.min():.2e} to {right_q.max():.2e}")
print(f"log likelihood changes by {change.min():.3f} to {change.max():.3f}, and falls in {np.sum(change < 0)} series;"
      f" by the right step {right_change.min():.4f} to {right_change.max():.4f}")
print(f"with the pairs shifted, the process noise is off by up to {np.abs(shifted - right_q).max():.1e};"
      f" the measurement noise is off by up to {np.abs(r - right_r).max():.1e}")
ok = np.all(q > 9.0 * right_q) and np.sum(change < 0.0) == 8 and np.all(right_change >= -1e-9)
ok &= np.allclose(shifted, right_q, rtol=1e-8) and np.allclose(r, right_r) and np.allclose(offset, 0.0, atol=1e-8)
sys.exit(not ok)
PY
