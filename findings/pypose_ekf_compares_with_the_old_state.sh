#!/usr/bin/env bash
# PyPose 0.9.5: `pypose.module.EKF` documents the innovation y - h(x-), of the predicted state x-. It computes y - h(x),
# of the state before the prediction, and corrects the predicted state by it. Gain and covariance are those of the
# textbook, so the belief looks right while its mean is not. In the linear system below, where an extended Kalman filter
# must equal the Kalman filter, a measurement that is exactly the predicted one moves the estimate by 9 deviations.
# Upstream: github.com/pypose/pypose/issues/360, closed.
# Prints both means, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'pypose==0.9.5' 'torch==2.13.0' 'numpy==2.4.6'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import pypose
import torch

torch.set_default_dtype(torch.float64)
F, H = torch.tensor([[1.0, 0.5], [0.0, 1.0]]), torch.tensor([[1.0, 0.0]])
Q, R, P0 = 0.01 * torch.eye(2), 0.01 * torch.eye(1), 0.04 * torch.eye(2)


class Constant(pypose.module.NLS):
    """Position and velocity; the position is measured."""

    def state_transition(self, state, input, t=None):
        return state @ F.mT

    def observation(self, state, input, t=None):
        return state @ H.mT


x = torch.tensor([1.0, 2.0])
predicted = F @ x
measured = H @ predicted  # exactly what is expected, so that the mean must not move
mean, P = pypose.module.EKF(Constant(), Q, R)(x, measured, torch.zeros(1), P0)
P_prior = F @ P0 @ F.mT + Q
K = P_prior @ H.mT @ torch.linalg.inv(H @ P_prior @ H.mT + R)
same = torch.allclose(P, (torch.eye(2) - K @ H) @ P_prior)
sigmas = float((mean - predicted)[0] / P[0, 0].sqrt())
print(f"predicted {predicted.tolist()}, PyPose {[round(v, 4) for v in mean.tolist()]}, {sigmas:.1f} deviations apart;",
      f"the covariance is the Kalman filter's: {same}")
wrong = predicted + K @ (measured - H @ x)
sys.exit(not (same and torch.allclose(mean, wrong) and sigmas > 4.0))
PY
