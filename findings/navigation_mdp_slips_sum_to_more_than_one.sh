#!/usr/bin/env bash
# navigation-mdp 1.2: `VonNeumannDynamics(state_space, slip_prob=p)` moves an agent on a grid. With the probability p,
# it slips to one of two other directions. `take_action` draws so. `get_next_states_distribution`, which planners
# need, gives the probability p to each of the two directions, and 1 - p to the right one. Nothing warns. So
# probabilities sum to 1 + p, and slips count twice. With p = 0.2, the factor 1.2 of each step outweighs a discount of
# 0.9: the value of a reward of 1 in each step is 10, and value iteration by these probabilities has no limit.
# Prints probabilities and draws, and values of steps, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
pip=("$folder/venv/bin/pip" --quiet --disable-pip-version-check install)
"${pip[@]}" 'navigation-mdp==1.2' 'numpy==2.4.6' 'matplotlib==3.11.2'
cd "$folder"
MPLCONFIGDIR="$folder" "$folder/venv/bin/python" - <<'PY'
import sys

import numpy as np
from navigation_mdp.dynamics import MooreDynamics, VonNeumannDynamics
from navigation_mdp.state import DiscreteStateSpace

SLIP, DRAWS = 0.2, 20000
np.random.seed(0)
space = DiscreteStateSpace(3, 3)
ok = True
for kind in (VonNeumannDynamics, MooreDynamics):
    dynamics = kind(space, slip_prob=SLIP)
    told = {state.location: p for state, p in dynamics.get_next_states_distribution(space[1, 1], "U")}
    drawn = dict.fromkeys(told, 0.0)
    for _ in range(DRAWS):
        drawn[dynamics.take_action(space[1, 1], "U").location] += 1.0 / DRAWS
    print(f"{kind.__name__}: probabilities {[round(p, 3) for p in told.values()]}, sum {sum(told.values()):.3f};",
          f"shares of {DRAWS} draws {[round(p, 3) for p in drawn.values()]}")
    ok &= abs(sum(told.values()) - 1.0 - SLIP) < 1e-9 and abs(list(told.values())[1] - SLIP) < 1e-9
    ok &= np.allclose(list(drawn.values()), (1.0 - SLIP, SLIP / 2, SLIP / 2), atol=0.015)
dynamics = VonNeumannDynamics(space, slip_prob=SLIP)
transition = np.zeros((9, 9))
for state in space.state_lst:
    for successor, p in dynamics.get_next_states_distribution(state, "U"):
        transition[state.idx, successor.idx] += p
values = np.zeros(9)
for steps in (10, 100):
    for _ in range(steps):
        values = 1.0 + 0.9 * transition @ values
print(f"a reward of 1 in each step, discounted by 0.9, is worth {1 / (1 - 0.9):.0f}; by the library {values.max():.0f}")
sys.exit(not (ok and values.min() > 1000.0))
PY
