#!/usr/bin/env bash
# bayesfilter 0.2.0: `BayesianFilter.run(observations, times, rate_hz)` filters on a grid of times that starts at the
# first one. The initial state belongs to that time: in the example of the package, a body at t m has the initial
# position 0 m at 0 s. Yet `run` predicts by a whole step before the first time. So each state belongs to one step
# later than its time says, until the observations have pulled it back. Nothing warns. A body at 2 m/s whose state is
# known at the start is reported 2 m ahead. After 10 s of observations with a noise of 1 m, 1.6 m are left.
# Law: at the first time, without an observation, the state is the initial one. `run_synchronous` of the same filter
# starts so, and is exact.
# Documentation: the section "Constant-velocity example" of its README.
# Upstream: no issue of github.com/hugohadfield/bayesfilter that was found describes it.
# An initial state that belongs to one step before the first time is right.
# Prints the positions by both methods, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'bayesfilter==0.2.0' 'numpy==2.4.6'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import bayesfilter
import numpy as np
from bayesfilter.distributions import Gaussian
from bayesfilter.filtering import BayesianFilter
from bayesfilter.model import StateTransitionModel
from bayesfilter.observation import Observation

SPEED, NOISE = 2.0, 1.0  # m/s, m
TIMES = np.arange(11.0)  # s
print("bayesfilter", bayesfilter.__version__)


def started(time):
    """A filter whose state is known at ``time``."""
    model = StateTransitionModel(lambda x, dt: np.array((x[0] + dt * x[1], x[1])), 1e-4 * np.eye(2),
                                 lambda _, dt: np.array(((1.0, dt), (0.0, 1.0))))
    return BayesianFilter(model, Gaussian(np.array((SPEED * time, SPEED)), 1e-4 * np.eye(2)))


seen = [Observation(np.array((SPEED * t,)), np.array(((NOISE**2,),)), lambda x: x[:1],
                    lambda _: np.array(((1.0, 0.0),))) for t in TIMES]
errors = {}
for jacobian in (True, False):
    states, grid = started(TIMES[0]).run(seen, TIMES, 1.0, use_jacobian=jacobian)
    early, _ = started(TIMES[0] - 1.0).run(seen, TIMES, 1.0, use_jacobian=jacobian)
    other = started(TIMES[0]).run_synchronous(seen[1:], TIMES, use_jacobian=jacobian)
    assert np.array_equal(grid, TIMES)
    found = [np.array([state.mean()[0] for state in path]) - SPEED * TIMES for path in (states, other, early)]
    name = "extended" if jacobian else "unscented"
    print(f"\n{name} filter: run is ahead by {found[0][0]:.2f} m at 0 s and {found[0][-1]:.2f} m at 10 s;"
          f" run_synchronous by {np.abs(found[1]).max():.2f} m at most;"
          f" run from the state at -1 s by {np.abs(found[2]).max():.2f} m")
    errors[name] = found
ok = all(abs(run[0] - SPEED) < 0.01 and 1.4 < run[-1] < SPEED for run, _, _ in errors.values())
sys.exit(not (ok and all(np.abs(path).max() < 1e-3 for _, *right in errors.values() for path in right)))
PY
