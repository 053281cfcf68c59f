#!/usr/bin/env bash
# gnss-lib-py 1.1.0: a filter of `BaseExtendedKalmanFilter` gives a model of the dynamics and `linearize_dynamics`,
# which "should return A matrix", its derivative by the state. Both read `self.state`. `predict` writes the predicted
# state there first, and asks for the derivative then. An extended Kalman filter has the derivative at the state
# before the prediction. Nothing warns. So the uncertainty of a turn is laid on the wrong side: for a vehicle that
# drives a quarter of a circle, of unknown heading, the predicted uncertainty lies along x in place of y.
# Prints predicted deviations and those of samples, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
pip=("$folder/venv/bin/pip" --quiet --disable-pip-version-check install)
"${pip[@]}" 'numpy==2.4.6' 'scipy==1.17.1'
"${pip[@]}" --no-deps 'gnss-lib-py==1.1.0' # the rest is for files and maps
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import importlib.util
import pathlib
import sys

import numpy as np
from scipy.optimize import approx_fprime

folder = pathlib.Path(importlib.util.find_spec("gnss_lib_py").origin).parent
spec = importlib.util.spec_from_file_location("filters", folder / "utils" / "filters.py")
filters = importlib.util.module_from_spec(spec)
spec.loader.exec_module(filters)
LENGTH = 10.0  # metres, driven along the heading before a turn to the left by 90 degrees


def drive(state):
    x, y, heading = np.ravel(state)
    return np.array([x + LENGTH * np.cos(heading), y + LENGTH * np.sin(heading), heading + np.pi / 2.0])


class Vehicle(filters.BaseExtendedKalmanFilter):
    def dyn_model(self, u, predict_dict=None):
        return drive(self.state).reshape(3, 1)

    def linearize_dynamics(self, predict_dict=None):
        heading = float(self.state[2, 0])
        return np.array([[1.0, 0.0, -LENGTH * np.sin(heading)], [0.0, 1.0, LENGTH * np.cos(heading)], [0.0, 0.0, 1.0]])

    def measure_model(self, update_dict=None):
        return self.state[:2]

    def linearize_measurements(self, update_dict=None):
        return np.eye(2, 3)


start, covariance = np.zeros(3), np.diag([0.1**2, 0.1**2, 0.05**2])
vehicle = Vehicle({"state_0": start.reshape(3, 1), "sigma_0": covariance, "Q": np.zeros((3, 3)), "R": np.eye(2)}, {})
vehicle.predict()
derivative = approx_fprime(start, drive)
truth = derivative @ covariance @ derivative.T
samples = np.array([drive(sample) for sample in np.random.default_rng(0).multivariate_normal(start, covariance, 20000)])
found = [np.sqrt(np.diag(matrix))[:2] for matrix in (vehicle.sigma, truth, np.cov(samples.T))]
for name, deviations in zip(("library", "derivative at the start", "20000 samples"), found):
    print(f"{name}: deviation along x {deviations[0]:.3f} m, along y {deviations[1]:.3f} m")
sys.exit(not (np.allclose(found[1], found[2], atol=0.01) and np.allclose(found[0], found[1][::-1], atol=0.01)))
PY
