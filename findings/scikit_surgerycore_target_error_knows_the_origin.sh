#!/usr/bin/env bash
# scikit-surgerycore 0.8.3: `compute_tre_from_fle(fiducials, mean_fle_squared, target)` estimates the squared error of a
# target after a registration by points (Fitzpatrick 1998, equation 46). It needs distances from the principal axes of
# the fiducials. The function draws each axis from the centroid to the *end* of a unit vector at the origin, and takes
# rows of the matrix of eigenvectors for the vectors, which are its columns. Nothing warns. So the estimate depends on
# where the origin of the coordinates is. The same five points and target give 0.24 to 7 mm^2 in the place of 3.2.
# Law: moving all points together changes no error. 4000 registrations by `orthogonal_procrustes` of the package have
# the error of the equation with right axes.
# Prints the estimates for some origins, that of the equation, and the errors of registrations, fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'scikit-surgerycore==0.8.3' 'numpy==2.4.6'
cd "$folder"
"$folder/venv/bin/python" -W ignore - <<'PY'
import sys

import numpy as np
from sksurgerycore.algorithms.errors import compute_tre_from_fle
from sksurgerycore.algorithms.procrustes import orthogonal_procrustes

FIDUCIALS = np.array(((0.0, 0.0, 0.0), (200.0, 0.0, 0.0), (0.0, 100.0, 0.0), (0.0, 0.0, 50.0), (150.0, 80.0, 20.0)))
TARGET = np.array(((100.0, 50.0, 300.0),))
rng = np.random.default_rng(0)


def equation(fiducials, target):
    """Equation 46 with the principal axes, for a squared error of the fiducials of 1."""
    centred = fiducials - fiducials.mean(axis=0)
    total = 3.0
    for axis in np.linalg.svd(centred)[2]:
        d, f = (points - np.outer(points @ axis, axis) for points in (target - fiducials.mean(axis=0), centred))
        total += (d**2).sum() / (f**2).sum(axis=1).mean()
    return total / 3.0 / len(fiducials)


def registrations(fiducials, target, number=4000):
    """Mean squared error of the target, for that of each fiducial of 1."""
    total = 0.0
    for noise in rng.normal(0.0, np.sqrt(1.0 / 3.0), (number, *fiducials.shape)):
        R, t, _ = orthogonal_procrustes(fiducials, fiducials + noise)
        total += ((R @ target.T + t - target.T) ** 2).sum()
    return total / number


found = []
for origin in ((0.0, 0.0, 0.0), (1000.0, 0.0, 0.0), (0.0, 0.0, -2000.0), (-1000.0, 500.0, 300.0)):
    moved, target = FIDUCIALS + origin, TARGET + origin
    found.append((compute_tre_from_fle(moved, 1.0, target), equation(moved, target), registrations(moved, target)))
    print("moved by {}: estimated {:.3f} mm^2, by the equation {:.3f}, registrations {:.3f}".format(origin, *found[-1]))
estimated, right, sampled = np.array(found).T
ok = np.allclose(right, right[0]) and np.allclose(sampled, right, rtol=0.1)
sys.exit(not (ok and np.ptp(estimated) > 5.0 and estimated.min() < 0.5))
PY
