#!/usr/bin/env bash
# FilterPy 2.0.0: `CubatureKalmanFilter` propagates points that have the mean and the covariance of the state. The
# prediction adds the process noise Q to the covariance, but not to the points. The update measures those points. So its
# innovation and its gain have the covariance without Q. Nothing warns. The filter trusts measurements too little, and
# does not take off enough of the covariance. Beside measurements with a deviation of 1 m and a large process noise, it
# reports a deviation of 4.2 m for positions that are within 0.9 m.
# Law: for a linear system, a cubature filter is the Kalman filter. `UnscentedKalmanFilter` of the package draws new
# points from the predicted covariance, and is equal to `KalmanFilter` to the last digits.
# Upstream: no issue of github.com/rlabbe/filterpy that was found describes it; issue 280 tells of another argument.
# `f.sigmas_f = spherical_radial_sigmas(f.x, f.P)` between prediction and update, from the filter's module, repairs it.
# Prints the errors and the reported deviations of the filters, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'filterpy==2.0.0' 'numpy==2.4.6' 'scipy==1.17.1'
cd "$folder"
"$folder/venv/bin/python" -W ignore - <<'PY'
import sys

import numpy as np
from filterpy.kalman import CubatureKalmanFilter, KalmanFilter, MerweScaledSigmaPoints, UnscentedKalmanFilter
from filterpy.kalman.CubatureKalmanFilter import spherical_radial_sigmas

DT, N = 0.5, 400
F = np.array(((1.0, DT), (0.0, 1.0)))
H = np.array(((1.0, 0.0),))


def transition(x, dt):
    return F @ x


def measure(x):
    return H @ x


ok = True
for deviation in (0.1, 2.0, 20.0):
    rng = np.random.default_rng(0)
    Q = deviation**2 * np.array(((DT**3 / 3.0, DT**2 / 2.0), (DT**2 / 2.0, DT)))
    states, x = [], np.zeros(2)
    for noise in rng.multivariate_normal(np.zeros(2), Q, N):
        x = F @ x + noise
        states.append(x)
    positions = np.array(states)[:, 0]
    measured = positions + rng.normal(size=N)
    linear = KalmanFilter(2, 1)
    linear.F, linear.H = F, H
    points = MerweScaledSigmaPoints(2, 0.5, 2.0, 1.0)
    found = {}
    for name, kalman in (
        ("KalmanFilter", linear),
        ("UnscentedKalmanFilter", UnscentedKalmanFilter(2, 1, DT, measure, transition, points)),
        ("CubatureKalmanFilter", CubatureKalmanFilter(2, 1, DT, measure, transition)),
        ("new points", CubatureKalmanFilter(2, 1, DT, measure, transition)),
    ):
        kalman.x = np.zeros(2) if name == "UnscentedKalmanFilter" else np.zeros((2, 1))
        kalman.P, kalman.Q, kalman.R = np.eye(2), Q, np.eye(1)
        path = []
        for z in measured:
            kalman.predict()
            if name == "new points":
                kalman.sigmas_f = spherical_radial_sigmas(kalman.x, kalman.P)
            kalman.update(np.array((z,)) if name == "UnscentedKalmanFilter" else np.array(((z,),)))
            path.append(kalman.x.ravel()[0])
        error = np.sqrt(np.mean((np.array(path) - positions) ** 2))
        found[name] = np.array((error, np.sqrt(kalman.P[0, 0]), np.sqrt(kalman.P[1, 1])))
        print(f"process noise {deviation:g}: {name} has an error of {error:.3f} m and reports deviations of"
              f" {found[name][1]:.3f} m and {found[name][2]:.3f} m/s")
    right, cubature = found["KalmanFilter"], found["CubatureKalmanFilter"]
    ok &= all(np.allclose(found[name], right, rtol=1e-6) for name in ("UnscentedKalmanFilter", "new points"))
    ok &= bool(np.all(cubature[1:] > right[1:]) and (deviation < 20.0 or cubature[1] > 4.0 * right[1]))
sys.exit(not ok)
PY
