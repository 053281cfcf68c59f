#!/usr/bin/env bash
# PyPose 0.9.5: `pypose.module.UKF` spreads its sigma points along the rows of the lower Cholesky factor L of P. Rows
# serve where the factor is upper; here the points have the covariance L^T L instead of P = L L^T. Where P is not
# diagonal, the predicted covariance is wrong: for a state that stays, without process noise and with a measurement
# that says nothing, P must remain, and the variances 1 and 1 become 1.81 and 0.19. A symmetric root, given as `msqrt`,
# is right.
# Prints P before and after, and fails if that changes.
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


class Still(pypose.module.NLS):
    """A state that stays, and is measured."""

    def state_transition(self, state, input, t=None):
        return state

    def observation(self, state, input, t=None):
        return state


def root(P):
    """The symmetric root."""
    values, vectors = torch.linalg.eigh(P)
    return vectors @ torch.diag(values.sqrt()) @ vectors.mT


P = torch.tensor([[1.0, 0.9], [0.9, 1.0]])
found = []
for msqrt in (None, root):
    ukf = pypose.module.UKF(Still(), torch.zeros(2, 2), 1e12 * torch.eye(2), msqrt=msqrt)
    found.append(ukf(torch.zeros(2), torch.zeros(2), torch.zeros(2), P)[1])
L = torch.linalg.cholesky(P)
print("P", P.tolist(), "| after, by Cholesky:", found[0].round(decimals=4).tolist(),
      "| by a symmetric root:", found[1].round(decimals=4).tolist())
sys.exit(not (torch.allclose(found[0], L.mT @ L, atol=1e-6) and torch.allclose(found[1], P, atol=1e-6)))
PY
