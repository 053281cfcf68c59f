#!/usr/bin/env bash
# matrix-mdp-gym 1.1.1: `reset(seed=...)` is documented: "seed for random number generator". The library passes the seed
# to Gymnasium, which seeds the generator of the environment. Then it draws all states from NumPy's global generator.
# Nothing warns. Episodes with one seed differ, and even the first states do. A draw elsewhere in the program changes
# the episode.
# Law: Gymnasium documents that an episode after a reset with a seed repeats for the same actions. Its own
# `check_env` rejects the environment.
# Upstream: no issue of github.com/Paul-543NA/matrix-mdp-gym that was found describes it.
# `numpy.random.seed` before each reset repeats an episode.
# Prints the states of episodes with one seed, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'matrix-mdp-gym==1.1.1' 'gymnasium==1.4.0' \
  'numpy==2.4.6'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys
import warnings
from importlib.metadata import version

import gymnasium
import matrix_mdp  # registers the environment
import numpy as np
from gymnasium.utils.env_checker import check_env

STATES, ACTIONS, STEPS, EPISODES, SEED = 10, 2, 12, 20, 7
print("matrix-mdp-gym", version("matrix-mdp-gym"), matrix_mdp.__name__)
random = np.random.default_rng(0)
transitions = random.dirichlet(np.ones(STATES), size=(STATES, ACTIONS)).transpose(2, 0, 1)  # next state, state, action
env = gymnasium.make("matrix_mdp/MatrixMDP-v0", p_0=np.full(STATES, 1.0 / STATES), p=transitions,
                     r=np.zeros((STATES, STATES, ACTIONS)))
warnings.simplefilter("error")


def episode(globally=False):
    """States of an episode with the same actions; NumPy's global generator is seeded first if ``globally``."""
    if globally:
        np.random.seed(SEED)
    states = [int(env.reset(seed=SEED)[0])]
    for i in range(STEPS):
        states.append(int(env.step(i % ACTIONS)[0]))
    return tuple(states)


seeded, repeated = [episode() for _ in range(EPISODES)], {episode(globally=True) for _ in range(EPISODES)}
for states in seeded[:3]:
    print(f"states after a reset with seed {SEED}: {states}")
firsts = {states[0] for states in seeded}
print(f"{EPISODES} episodes with one seed: {len(set(seeded))} different ones, {len(firsts)} first states; with a global"
      f" seed {len(repeated)}")
warnings.simplefilter("default")
np.random.seed(SEED)
try:
    check_env(env.unwrapped, skip_render_check=True)
    rejected = ""
except AssertionError as problem:
    rejected = str(problem)
print("check_env:", rejected)
sys.exit(not (len(set(seeded)) == EPISODES and len(firsts) > 3 and len(repeated) == 1
              and "non-deterministic" in rejected))
PY
