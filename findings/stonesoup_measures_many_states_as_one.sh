#!/usr/bin/env bash
# Stone Soup 1.9.1: measurement models take one state or many, as columns of `StateVectors`, for sigma points, particles
# and the numerical Jacobian. `CartesianToElevationRateBearingRateRangeRate` mixes the columns: its elevation rate and
# range rate of many states differ from those of each state alone. Its own `jacobian`, which evaluates all perturbed
# states at once, therefore says that the range rate does not depend on the velocity, and an extended Kalman filter
# learns no velocity from a range rate. The other models treat columns apart.
# Prints range rates and their derivatives, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'stonesoup==1.9.1' 'numpy==2.4.6' 'scipy==1.17.1'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
from stonesoup.models.measurement import nonlinear
from stonesoup.types.array import StateVector, StateVectors
from stonesoup.types.state import State

X = np.array([[10.0, 1, 20, -2, 15, 0.5], [-5.0, 3, 8, 1, 4, -1.0]]).T  # x, vx, y, vy, z, vz, two states
MODELS = "CartesianToElevationBearingRangeRate", "CartesianToElevationRateBearingRateRangeRate"
found = []
for name in MODELS:
    model = getattr(nonlinear, name)(ndim_state=6, mapping=(0, 2, 4), velocity_mapping=(1, 3, 5), noise_covar=np.eye(6))
    together = np.array(model.function(State(StateVectors(X)), noise=False), float)[-1]
    alone = np.array([float(model.function(State(StateVector(x)), noise=False)[-1]) for x in X.T])
    by_velocity = np.array(model.jacobian(State(StateVector(X[:, 0]))), float)[-1, 1::2]
    print(f"{name}: range rates alone {alone.round(3)}, together {together.round(3)};",
          f"derivatives by the velocity {by_velocity.round(3)}")
    found.append((np.abs(together - alone).max(), by_velocity))
truth = X[::2, 0] / np.linalg.norm(X[::2, 0])
ok = found[0][0] < 1e-9 and np.allclose(found[0][1], truth, atol=1e-4)
sys.exit(not (ok and found[1][0] > 0.1 and np.abs(found[1][1]).max() < 1e-6))
PY
