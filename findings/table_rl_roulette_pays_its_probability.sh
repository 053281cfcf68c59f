#!/usr/bin/env bash
# table-rl 0.3.0: the environments of the package have the arrays `T` and `R` of transitions and rewards, for its own
# `value_iteration`. `Roulette` is the casino of van Hasselt's paper on double Q-learning: 170 bets that lose 5 cents of
# a dollar on average, and one action that leaves the table. Its `R` has the probabilities of the wins where the
# expected payoffs belong. So each bet seems to gain. Nothing warns. By the library's planner the best policy plays for
# ever, for a value of 47 dollars. `step` plays the true game, in which that policy loses.
# Law: R(s, a, s') is the expected reward of the transition (Sutton and Barto, equation 3.6). The mean over steps is it.
# Paper: van Hasselt, Double Q-learning, 2010, section 4.1: each bet has an expected loss of $0.053.
# Upstream: no issue of github.com/prabhatnagarajan/table-rl that was found describes it.
# An `R` that is computed from `env.win` and `env.probs` makes the planner leave.
# Prints values and means, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'table-rl==0.3.0' 'gymnasium==1.4.0' 'numpy==2.4.6'
cd "$folder"
cat >casino.py <<'PY'
import contextlib
import io
import sys
from importlib.metadata import version

import numpy as np
from table_rl.dp.dp import q_value_iteration
from table_rl.envs.roulette import Roulette

DISCOUNT, SWEEPS, PLAYS = 0.99, 3000, 20_000
print("table-rl", version("table-rl"))
np.random.seed(0)
env = Roulette()
states, actions, _ = env.T.shape


def planned(rewards):
    """Best action at the table and its value."""
    q = q_value_iteration(states, actions, rewards, env.T, DISCOUNT, SWEEPS)[0]
    return int(np.argmax(q)), float(np.max(q))


def played(action):
    """Mean reward of ``PLAYS`` steps with an action."""
    total = 0.0
    with contextlib.redirect_stdout(io.StringIO()):  # it prints each win
        for _ in range(PLAYS):
            env.reset()
            total += env.step(action)[1]
    return total / PLAYS


payoffs = np.array(env.probs) * (np.array(env.win) + 1.0) - 1.0
right = np.zeros_like(env.R)
right[0, 1:, 0] = payoffs
best, value = planned(env.R)
chosen, leave = planned(right)
mean = played(best)
print(f"R says that a bet gains {env.R[0, 1:, 0].min():.3f} to {env.R[0, 1:, 0].max():.3f}; true are"
      f" {payoffs.min():.3f} to {payoffs.max():.3f}")
print(f"planned by R: action {best}, value {value:.1f}; its mean reward over {PLAYS} plays is {mean:.3f}")
print(f"planned by the payoffs: action {chosen}, value {leave:.1f}; action 0 leaves the table")
ok = best != 0 and value > 40.0 and mean < 0.0 and env.R[0, 1:, 0].min() > 0.0
sys.exit(not (ok and chosen == 0 and leave == 0.0))
PY
"$folder/venv/bin/python" -W ignore casino.py
