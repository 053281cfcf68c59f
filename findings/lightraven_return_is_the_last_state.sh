#!/usr/bin/env bash
# lightRaven 0.1.0: `PDIS` estimates the return of a policy by importance sampling per decision: each reward is weighted
# by the product of the ratios so far, and all are added up. For a `TabularPolicy`, the library keeps the sum in a
# variable `s`, and reads the number of the state into the same `s` at each step. Nothing warns. So what is left is the
# number of the last state, plus the last weighted reward. Episodes that end in state 7 have a return near 7, and near 3
# if the same state is numbered 3.
# Law: the numbers of the states must not matter. Sutton and Barto, Reinforcement Learning, section 5.9, has
# the sum. The library's own `PDIS` with an `FAPolicy` that sees the states as unit vectors, which is the same policy,
# obeys both.
# Upstream: no issue of github.com/M0gician/lightRaven that was found describes it.
# `IS` and `WIS` with a `TabularPolicy` are right.
# Prints the estimates for two numberings of the states, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
pip=("$folder/venv/bin/pip" --quiet --disable-pip-version-check install)
"${pip[@]}" 'numpy==2.4.6' 'scipy==1.17.1' 'numba==0.68.1' 'llvmlite==0.50.0'
"${pip[@]}" --no-deps 'lightRaven==0.1.0' # it asks for old environments too
cd "$folder"
cat >states.py <<'PY'
import sys
from importlib.metadata import version

import numpy as np
from lightRaven.policy import FAPolicy, TabularPolicy
from lightRaven.sampling import IS, PDIS

STATES, EPISODES = 8, 20_000
NUMBERINGS = {"ends in 7": [0, 1, 2, 3, 4, 5, 6, 7], "ends in 3": [7, 6, 5, 4, 0, 1, 2, 3]}
print("lightRaven", version("lightRaven"))
random = np.random.default_rng(0)
weights = np.zeros((STATES, 2))
weights[:, 1] = 0.2  # prefers the second action, which has the reward 1; the first one has none
preferred = 1.0 / (1.0 + np.exp(-0.2))
actions = random.integers(0, 2, (EPISODES, STATES))  # by a policy that has no preference
true = STATES * preferred

ok = True
for name, numbers in NUMBERINGS.items():
    order = np.array(numbers)  # an episode passes each of the states once
    behaviour = np.full(STATES, 0.5)
    tabular = [(order, a, a.astype(float), behaviour) for a in actions]
    features = [(np.eye(STATES)[order], a, a.astype(float), behaviour) for a in actions]
    found = []
    cases = (PDIS, tabular, TabularPolicy), (IS, tabular, TabularPolicy), (PDIS, features, FAPolicy)
    for estimator, data, policy in cases:
        sampler = estimator(data, gamma=1.0)
        sampler.load_eval_policy(policy(STATES, 2, weights.ravel()))
        found.append(float(sampler.get_est().mean()))
    print(f"{name}: true return {true:.2f}; PDIS {found[0]:.2f}, IS {found[1]:.2f}, PDIS by features {found[2]:.2f}")
    ok &= abs(found[0] - (order[-1] + preferred)) < 0.1 and np.allclose(found[1:], true, atol=0.1)
sys.exit(not ok)
PY
NUMBA_DISABLE_JIT=1 "$folder/venv/bin/python" -W ignore states.py # the same without minutes of compilation
