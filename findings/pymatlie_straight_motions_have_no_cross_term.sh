#!/usr/bin/env bash
# pymatlie 0.0.1a1: `SE2.left_jacobian(tau)` of a planar motion (x, y, angle) has y / 2 and -x / 2 in its last column
# where the angle is zero. The library divides the exact terms, which are zero there, by the square of the angle plus
# 1e-15. So the column is zero for a robot that drives straight on. Nothing warns. For small angles, the terms are
# rounding errors. In 32 bits, PyTorch's default, the square makes them large: 10 m with 1e-4 rad have 27 in the place
# of -5, and with 1e-8 rad it is millions.
# `right_jacobian` and the inverse are made of it, so filters and optimisers lose that a wrong heading moves the robot.
# Law: exp(tau + delta) is exp(J delta) exp(tau) for small steps. Finite differences by SciPy 1.17.1 have the column.
# In 64 bits, angles from 0.001 to 3 rad are right.
# Prints the column for some angles, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'pymatlie==0.0.1a1' 'torch==2.13.0' \
  'numpy==2.4.6' 'scipy==1.17.1'
cd "$folder"
"$folder/venv/bin/python" -W ignore - <<'PY'
import sys

import numpy as np
import torch
from pymatlie.se2 import SE2
from scipy.linalg import expm, logm


def hat(tau):
    """Matrix of a planar motion."""
    return np.array(((0.0, -tau[2], tau[0]), (tau[2], 0.0, tau[1]), (0.0, 0.0, 0.0)))


def differences(tau, step=1e-4):
    """Last column of the left Jacobian by finite differences."""
    delta = np.array((0.0, 0.0, step))
    ahead, behind = expm(hat(tau + delta)), expm(hat(tau - delta))
    moved = np.real(logm(ahead @ np.linalg.inv(behind))) / (2.0 * step)
    return moved[:2, 2]


ok = True
for angle in (0.0, 1e-8, 1e-4, 1e-3, 1.0, 3.0):
    tau = np.array((10.0, 2.0, angle))
    true = differences(tau)
    found = {kind: SE2.left_jacobian(torch.tensor(tau[None], dtype=kind))[0, :2, 2].double().numpy()
             for kind in (torch.float64, torch.float32)}
    print(f"10 m ahead, 2 m to the left and {angle:g} rad: {found[torch.float64].round(4)}, in 32 bits"
          f" {found[torch.float32].round(4)}; by differences {true.round(4)}")
    errors = [float(np.abs(values - true).max()) for values in found.values()]
    if angle == 0.0:
        ok &= not any(values.any() for values in found.values()) and bool(np.allclose(true, (1.0, -5.0), atol=1e-4))
    ok &= (errors[0] < 1e-3) == (angle >= 1e-4) and (angle > 1e-4 or errors[1] > 0.5)
jacobian, inverse = (function(torch.tensor([[10.0, 2.0, 0.0]])) for function in (SE2.right_jacobian,
                                                                                SE2.left_jacobian_inverse))
print(f"right Jacobian of a straight motion {jacobian[0].tolist()}, inverse of the left one {inverse[0].tolist()}")
ok &= not jacobian[0, :2, 2].any() and not inverse[0, :2, 2].any()
sys.exit(not ok)
PY
