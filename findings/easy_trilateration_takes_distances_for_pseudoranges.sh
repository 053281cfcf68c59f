#!/usr/bin/env bash
# easy-trilateration 0.1.4: `solve(Trilateration(circles))` finds a point by its distances to known ones. The library
# fits a third unknown, the radius of the result, and takes it off all distances. That is the model of a receiver with
# an unknown clock. The documentation does not tell it, and nothing warns. So three exact distances have two solutions.
# For a quarter of random beacons and points, the library returns the wrong one, tens of metres away, though it does not
# have these distances. With four beacons, noise counts for more outside of them. 100 m beside their square, noise of 1
# m becomes an error of 15 m in place of 2.
# Law: three distances determine a point, by linear equations. The fit of two unknowns from the same start, by SciPy
# 1.17.1, has the least error.
# Upstream: no issue of github.com/agusalex/Least-Squares-Trilateration that was found describes it.
# The radius of the result tells how much was taken off. For exact distances, the point is right where it is zero.
# Prints how often exact distances give the wrong point, and the errors by noise, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'easy-trilateration==0.1.4' 'numpy==2.4.6' \
  'scipy==1.17.1' 'matplotlib==3.11.2'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
from easy_trilateration.least_squares import solve
from easy_trilateration.model import Circle, Trilateration
from scipy.optimize import least_squares


def by_library(beacons, distances):
    """Point and radius of the result."""
    result = solve(Trilateration([Circle(*b, d) for b, d in zip(beacons.tolist(), distances.tolist())]))
    return np.array((result.center.x, result.center.y)), result.radius


def by_scipy(beacons, distances):
    """Point of the fit of two unknowns to squared distances, which the library fits too."""
    return least_squares(lambda p: np.sum((beacons - p) ** 2, axis=1) - distances**2, (0.0, 0.0)).x


def linear(beacons, distances):
    """Point by the differences of squared distances to the first beacon."""
    squares = np.sum(beacons**2, axis=1) - distances**2
    return np.linalg.solve(2.0 * (beacons[1:3] - beacons[0]), squares[1:3] - squares[0])


random = np.random.default_rng(0)
wrong, misfits = [], []
for _ in range(500):
    beacons, point = random.uniform(0.0, 100.0, (3, 2)), random.uniform(0.0, 100.0, 2)
    distances = np.linalg.norm(beacons - point, axis=1)
    assert np.allclose(linear(beacons, distances), point, atol=1e-6)
    found, radius = by_library(beacons, distances)
    error = np.linalg.norm(found - point)
    lengths = np.linalg.norm(beacons - found, axis=1)
    solved = np.allclose(lengths, np.abs(distances - radius), rtol=0.0, atol=1e-3)
    if solved and error > 1.0:  # a solution of the equations of the library, and no failure of its optimiser
        wrong.append(error)
        misfits.append(np.abs(lengths - distances).max())
print(f"three beacons, exact distances: {len(wrong)} of 500 points are another solution; in the median, it is"
      f" {np.median(wrong):.0f} m away, and misses a distance by {np.median(misfits):.0f} m")
square = np.array(((0.0, 0.0), (100.0, 0.0), (0.0, 100.0), (100.0, 100.0)))
for point in ((50.0, 50.0), (150.0, 50.0), (200.0, 50.0)):
    exact, errors = np.linalg.norm(square - point, axis=1), []
    for _ in range(300):
        distances = exact + random.normal(size=4)
        found = by_library(square, distances)[0], by_scipy(square, distances)
        errors.append(np.sum(np.square(np.subtract(found, point)), axis=1))
    rms = np.sqrt(np.mean(errors, axis=0))
    print(f"four beacons, noise of 1 m, point at {point}: error {rms[0]:.1f} m, by SciPy {rms[1]:.1f} m")
ok = 80 < len(wrong) < 170 and np.median(wrong) > 20.0 and np.median(misfits) > 10.0
sys.exit(not (ok and rms[0] > 5.0 * rms[1]))
PY
