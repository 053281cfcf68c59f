#!/usr/bin/env bash
# pfilter 0.2.5: `ParticleFilter.copy()` promises "an exact copy, that can be run forward" independently of the first
# filter. It passes on all functions but `noise_fn`. Nothing warns. The copy has no process noise, so its particles
# follow the dynamics alone. `predictor()`, the library's way to look ahead, runs such a copy. Its uncertainty does not
# grow: after 50 steps of a random walk, it claims 0.8 m where 7 m are true. A copy that goes on with measurements of a
# motion to 10 m cannot follow, and stays at 2.3 m.
# Law: a copy does what the filter does. The variance of a random walk grows by that of a step, in each step.
# Upstream: the closed pull request github.com/johnhw/pfilter/pull/18 is named after it; the release has the fault.
# `copy.noise_fn = pf.noise_fn` makes it right.
# Prints the standard deviations of filter, copy and predictor, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'pfilter==0.2.5' 'numpy==2.4.6'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys
from importlib.metadata import version

import numpy as np
from pfilter import ParticleFilter, gaussian_noise, squared_error

STEP, SEEN, STEPS = 1.0, 1.0, 50  # standard deviations of a step and of a measurement [m]; steps
print("pfilter", version("pfilter"))
np.random.seed(0)
pf = ParticleFilter(
    prior_fn=lambda n: np.random.normal(0.0, 1.0, (n, 1)),
    noise_fn=lambda x, **_: gaussian_noise(x, sigmas=[STEP]),
    weight_fn=lambda x, y, **_: squared_error(x, y, sigma=SEEN),
    n_particles=5000,
)
for _ in range(10):
    pf.update(np.array([0.0]))


def ahead(filter_):
    """Standard deviation after ``STEPS`` without a measurement."""
    for _ in range(STEPS):
        filter_.update(None)
    return float(np.std(filter_.particles))


now = float(np.std(pf.particles))
mended = pf.copy()
mended.noise_fn = pf.noise_fn
copied, repaired = ahead(pf.copy()), ahead(mended)
for predicted in pf.predictor(STEPS):
    pass
predicted = float(np.std(predicted.particles))
copy = pf.copy()
for place in np.arange(0.5, 10.5, 0.5):  # moves on by half a metre a step
    copy.update(np.array([place]))
    mended.update(np.array([place]))
true, itself = np.sqrt(now**2 + STEPS * STEP**2), ahead(pf)
print(f"standard deviation now {now:.2f} m; after {STEPS} steps {itself:.2f} m, by the law {true:.2f} m")
print(f"by a copy {copied:.2f} m, by the predictor {predicted:.2f} m, by a copy with the noise {repaired:.2f} m")
print(f"after 20 measurements of a motion to 10 m, the copy is at {copy.mean_state[0]:.2f} m,"
      f" that with the noise at {mended.mean_state[0]:.2f} m")
ok = abs(itself / true - 1.0) < 0.1 and abs(repaired / true - 1.0) < 0.1 and max(copied, predicted) <= 1.01 * now
sys.exit(not (ok and copy.mean_state[0] < 7.0 < mended.mean_state[0]))
PY
