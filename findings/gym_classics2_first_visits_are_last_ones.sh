#!/usr/bin/env bash
# gym-classics2 1.0.3: `MC_control_ES` estimates action values by the returns of episodes. The documentation prefers it
# to `MC_control_ES_textbook`, which "stores every first-visit return", as it needs less memory. The library goes
# through an episode from its end, and takes each pair of state and action where it meets it first. That is the last
# visit. Nothing warns. After a last visit, the agent never comes back, so its return is that of a lucky end. A robot
# leaves a room by a door that is stuck nine times of ten, at the price of 1 for each try. The value of a try is -10.
# The library says -1.
# Law: the value of a geometric waiting time in closed form. In the library's own gridworld, `value_iteration` and
# `backup` compute the values from the model.
# Upstream: no issue of github.com/mhahsler/gym-classics2 that was found describes it.
# `MC_control_ES_textbook` is right. Where no episode visits a pair twice, both are.
# Prints the values by both functions and the true ones, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'gym-classics2==1.0.3' 'gymnasium==1.4.0' \
  'numpy==2.4.6' 'matplotlib==3.11.2' 'tqdm==4.70.1'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import io
import sys
from contextlib import redirect_stderr

import gym_classics2
import gymnasium
import numpy as np
from gym_classics2.algorithms.dynamic_programming import backup, value_iteration
from gym_classics2.algorithms.monte_carlo_methods import MC_control_ES, MC_control_ES_textbook
from gym_classics2.envs.abstract.base_env import BaseEnv


class Door(BaseEnv):
    """State 0 is the room, state 1 is outside. The only action is a try, and the door opens with a probability."""

    def __init__(self, opens):
        self.opens = opens
        super().__init__(starts=[0], action_labels=["push"])

    def _sample_random_elements(self, state, action):
        return [self.np_random.random() < self.opens]

    def _next_state(self, state, action, opened):
        return (1, self.opens) if opened or state == 1 else (0, 1.0 - self.opens)

    def _reward(self, state, action, next_state):
        return -1.0 if state == 0 else 0.0

    def _done(self, state, action, next_state):
        return next_state == 1

    def _generate_transitions(self, state, action):
        for opened in (False, True):
            yield self._deterministic_step(state, action, opened)


def run(function, *args, **options):
    """Result of a function of the library, without its progress bar."""
    with redirect_stderr(io.StringIO()):
        return function(*args, **options)


ok = True
for opens in (1.0, 0.5, 0.2, 0.1):
    env = Door(opens)
    env.reset(seed=0)
    seen, textbook = (run(function, env, 1.0, n=3000, max_episode_len=1000, rng=0)[1][0, 0]
                      for function in (MC_control_ES, MC_control_ES_textbook))
    print(f"door that opens with {opens:g}: MC_control_ES {seen:.2f}, textbook {textbook:.2f}, due {-1.0 / opens:.2f}")
    ok &= seen == -1.0 and np.isclose(textbook, -1.0 / opens, rtol=0.1)
gym_classics2.register()
env = gymnasium.make("ClassicGridworld-v1").unwrapped
env.reset(seed=0)
values = run(value_iteration, env, 0.95, 1e-9)
true = np.array([[backup(env, 0.95, values, state, action) for action in env.actions()] for state in env.states()])
inside = [state for state in env.states() if values[state] > 0.0]  # terminal states have no value
errors = []
for function in (MC_control_ES, MC_control_ES_textbook):
    found = run(function, env, 0.95, n=5000, max_episode_len=1000, rng=0)[1]
    errors.append(np.sqrt(np.mean((found - true)[inside] ** 2)))
print(f"ClassicGridworld-v1, 5000 episodes: error of the values {errors[0]:.3f} by MC_control_ES, {errors[1]:.3f} by"
      " the textbook")
sys.exit(not (ok and errors[0] > 2.0 * errors[1]))
PY
