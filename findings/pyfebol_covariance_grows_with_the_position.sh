#!/usr/bin/env bash
# PyFEBOL 0.5.4: `ParticleFilter` localises a transmitter by its bearings, and `covariance()` returns the covariance of
# its position. The library computes it from a histogram of a tenth of the particles. Their weights sum to 0.1, but the
# library computes as if they summed to 1. Nothing warns. So a tenth of the mean square, less a hundredth of the squared
# mean, stands in for the variance. Far from the origin, a target known to 2 m gets a standard deviation of 24 m. Its
# coordinates seem fully correlated. `maxEigenvalue` and the cost model by it take this value.
# Law: a covariance does not change if everything is shifted. NumPy computes it from the particles and their weights.
# Upstream: no issue of github.com/cdrckrgt/PyFEBOL that was found describes it.
# `centroid()` is right.
# Prints the standard deviations for some targets, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'PyFEBOL==0.5.4' 'numpy==2.4.6' 'scipy==1.17.1' \
  'fast-histogram==0.14'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys
import warnings
from importlib.metadata import version

import numpy as np
from PyFEBOL.filter import ParticleFilter
from PyFEBOL.searchdomain import SearchDomain
from PyFEBOL.sensor import BearingOnlySensor

LENGTH, BUCKETS, PARTICLES, STEPS, RANGE, NOISE = 100.0, 50, 5000, 30, 15.0, 5.0  # m; cells of a side; ...; m; degrees
print("PyFEBOL", version("PyFEBOL"))
warnings.simplefilter("error")


def localise(x, y):
    """A filter after bearings to a target at rest from places around it."""
    np.random.seed(0)
    domain, sensor = SearchDomain(LENGTH, init=(x / LENGTH, y / LENGTH)), BearingOnlySensor(NOISE)
    found = ParticleFilter(domain, BUCKETS, sensor, 0.1, PARTICLES)
    for angle in np.linspace(0.0, 4.0 * np.pi, STEPS):
        pose = x + RANGE * np.cos(angle), y + RANGE * np.sin(angle), 0.0
        found.update(pose, sensor.observe(domain.getTheta(), pose))
    return found


ok, largest = True, []
for target in ((20.0, 20.0), (50.0, 50.0), (80.0, 80.0), (80.0, 20.0)):
    tracked = localise(*target)
    seen = tracked.covariance()
    true = np.cov(tracked.x_particles, tracked.y_particles, aweights=tracked.weights)
    mean = np.array(tracked.centroid())
    share = tracked.getBelief().sum()
    print(f"target at {target}, centroid at ({mean[0]:.1f}, {mean[1]:.1f}) m: standard deviations"
          f" {np.sqrt(seen[0, 0]):.1f} and {np.sqrt(seen[1, 1]):.1f} m, correlation"
          f" {seen[0, 1] / np.sqrt(seen[0, 0] * seen[1, 1]):.2f}; by NumPy {np.sqrt(true[0, 0]):.1f} and"
          f" {np.sqrt(true[1, 1]):.1f} m, correlation {true[0, 1] / np.sqrt(true[0, 0] * true[1, 1]):.2f}; the"
          f" histogram sums to {share:.2f}")
    expected = 0.1 * (np.diag(true) + mean**2) - 0.01 * mean**2
    ok &= np.allclose(np.diag(seen), expected, rtol=0.1) and np.isclose(share, 0.1, atol=0.01)
    ok &= np.linalg.norm(mean - target) < 3.0 and np.sqrt(true.max()) < 5.0
    largest.append(tracked.maxEigenvalue())
ok &= largest[2] > 5.0 * largest[0]
sys.exit(not ok)
PY
