#!/usr/bin/env bash
# viking-kalman 0.1.0: `kalman_smoothing(X, y, theta1, P1, Q, sig)` is documented to compute "the smoothed estimation
# using the full dataset", with its covariance. The backward pass needs the mean after each measurement. The library
# keeps the mean before it, beside the covariance after it. Nothing warns. So each mean is that of other data, while
# the covariances are right. The last measurement has no effect at all: a change of it by 100 changes nothing. For a
# random walk, the errors of the means are 1.5 times as large as they should be, and too large for their variances.
# Prints errors and their sizes by the variances, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
pip=("$folder/venv/bin/pip" --quiet --disable-pip-version-check install)
"${pip[@]}" 'viking-kalman==0.1.0' 'numpy==2.4.6' 'scipy==1.17.1' 'matplotlib==3.11.2' 'pandas==3.1.1'
cd "$folder"
MPLCONFIGDIR="$folder" "$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
from viking_kalman import kalman_smoothing

N, PRIOR, Q, R = 400, 2.0, 0.3, 0.25  # variances
rng = np.random.default_rng(0)
states = rng.normal(0.0, PRIOR**0.5) + np.cumsum(np.r_[0.0, rng.normal(0.0, Q**0.5, N - 1)])
y = states + rng.normal(0.0, R**0.5, N)


def smooth(y):
    result = kalman_smoothing(np.ones((N, 1)), y, np.zeros(1), PRIOR * np.eye(1), Q * np.eye(1), R**0.5)
    return result["theta_arr"][:, 0], result["P_arr"][:, 0, 0]


found, variances = smooth(y)
steps = np.arange(N)
prior = PRIOR + Q * np.minimum.outer(steps, steps)  # the joint covariance of all states
gain = np.linalg.solve(prior + R * np.eye(N), prior).T
truth, covariance = gain @ y, prior - gain @ prior
assert np.allclose(variances, np.diag(covariance))
rows = []
for name, means in (("library", found), ("by the joint density", truth)):
    errors = means - states
    rows.append((float(np.sqrt((errors**2).mean())), float((errors**2 / variances).mean())))
    print(f"{name}: root mean square error {rows[-1][0]:.3f}, mean of error^2 / variance {rows[-1][1]:.2f}")
changed = y + 100.0 * (steps == N - 1)
effect = float(np.abs(smooth(changed)[0] - found).max()), float((gain @ (changed - y))[-1])
print(f"the last measurement plus 100: the means change by {effect[0]:g}, by the joint density by {effect[1]:.1f}")
ok = rows[0][0] > 1.3 * rows[1][0] and rows[0][1] > 1.7 > rows[1][1]
sys.exit(not (ok and effect[0] == 0.0 and effect[1] > 50.0))
PY
