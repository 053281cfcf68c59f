#!/usr/bin/env bash
# FilterPy 2.0.0: `ExtendedKalmanFilter.predict_update` is documented as one prediction and one update. It evaluates the
# Jacobian of the measurement at the state before the prediction, and the measurement itself after it. So it returns
# another mean and covariance than `predict` and `update` in sequence, which evaluate both at the predicted state: for a
# range to a body that passes by, a deviation of 0.67 m in place of 0.28 m. `x_prior` is the state before the prediction
# too.
# Upstream: the issue github.com/rlabbe/filterpy/issues/271, open.
# Prints both beliefs, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'filterpy==2.0.0' 'numpy==2.4.6' 'scipy==1.17.1'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter


def distance(x):
    return np.array([np.hypot(x[0], 1.0)])


def jacobian(x):
    return np.array([[x[0] / np.hypot(x[0], 1.0), 0.0]])


def begun():
    """Position -0.1, velocity 1, on a line that passes the origin at the distance 1; a step takes 1 s."""
    ekf = ExtendedKalmanFilter(dim_x=2, dim_z=1)
    ekf.x, ekf.F = np.array([-0.1, 1.0]), np.array([[1.0, 1.0], [0.0, 1.0]])
    ekf.P, ekf.Q, ekf.R = 0.25 * np.eye(2), 0.01 * np.eye(2), 0.04 * np.eye(1)
    return ekf


z = np.array([1.5])
apart, at_once = begun(), begun()
apart.predict()
apart.update(z, jacobian, distance)
at_once.predict_update(z, jacobian, distance)
for name, ekf in (("predict, update", apart), ("predict_update", at_once)):
    print(f"{name}: mean {ekf.x.round(4)}, deviations {np.sqrt(np.diag(ekf.P)).round(4)}, x_prior {ekf.x_prior}")
F, P0, H = apart.F, 0.25 * np.eye(2), jacobian(np.array([-0.1, 1.0]))
P = F @ P0 @ F.T + apart.Q
K = P @ H.T / (H @ P @ H.T + apart.R)
early = F @ (-0.1, 1.0) + K @ (z - distance(F @ (-0.1, 1.0)))
sys.exit(not (np.allclose(at_once.x, early) and np.abs(apart.x - at_once.x).max() > 0.2))
PY
