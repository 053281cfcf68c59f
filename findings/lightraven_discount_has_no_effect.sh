#!/usr/bin/env bash
# lightRaven 0.1.0: the importance sampling estimators `IS`, `PDIS`, `WIS` and `CWPDIS` estimate the return of a policy
# from episodes of another one. They take `gamma`, documented as "the discount factor. Mostly predefined by the MDP",
# 0.9 by default. They store it, and none of them uses it. Nothing warns. All estimates are those of the sum of rewards.
# For episodes of 100 steps with a reward of 1, each estimate is 100. With the default discount, 10 is true.
# Law: the return is the sum of gamma^t r_t (Sutton and Barto, Reinforcement Learning, equation 3.8). If the policy is
# the one that has made the episodes, all weights are 1, and the estimate is the mean return.
# Upstream: no issue of github.com/M0gician/lightRaven that was found describes it.
# Rewards that are multiplied by gamma^t beforehand give right estimates.
# Prints the estimates by the discount, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
pip=("$folder/venv/bin/pip" --quiet --disable-pip-version-check install)
"${pip[@]}" 'numpy==2.4.6' 'scipy==1.17.1' 'numba==0.68.1' 'llvmlite==0.50.0'
"${pip[@]}" --no-deps 'lightRaven==0.1.0' # it asks for old environments too
cd "$folder"
cat >discount.py <<'PY'
import sys
from importlib.metadata import version

import numpy as np
from lightRaven.policy import FAPolicy
from lightRaven.sampling import CWPDIS, IS, PDIS, WIS

STEPS, EPISODES = 100, 20
print("lightRaven", version("lightRaven"))
random = np.random.default_rng(0)
policy = FAPolicy(2, 2, np.zeros(4))  # both actions have the probability 1/2
episodes = [
    (random.normal(size=(STEPS, 2)), random.integers(0, 2, STEPS), np.ones(STEPS), np.full(STEPS, 0.5))
    for _ in range(EPISODES)
]


def estimates(gamma, rewarded=1.0):
    """Mean estimate by each of the estimators, for rewards that are multiplied by ``rewarded`` in each step."""
    found = []
    for estimator in (IS, PDIS, WIS, CWPDIS):
        data = [(s, a, r * rewarded ** np.arange(STEPS), p) for s, a, r, p in episodes]
        sampler = estimator(data, gamma=gamma)
        sampler.load_eval_policy(policy)
        found.append(float(np.mean(sampler.get_est(n_batch=1) if estimator in (WIS, CWPDIS) else sampler.get_est())))
    return np.array(found)


ok = True
for gamma in (1.0, 0.9, 0.5):
    true = float(np.sum(gamma ** np.arange(STEPS)))
    found, before = estimates(gamma), estimates(gamma, gamma)
    print(f"gamma {gamma:g}: true return {true:.2f}, IS {found[0]:.2f}, PDIS {found[1]:.2f}, WIS {found[2]:.2f},"
          f" CWPDIS {found[3]:.2f}; with discounted rewards {before.round(2).tolist()}")
    ok &= np.allclose(found, STEPS) and np.allclose(before, true)
sys.exit(not ok)
PY
NUMBA_DISABLE_JIT=1 "$folder/venv/bin/python" -W ignore discount.py # the same without minutes of compilation
