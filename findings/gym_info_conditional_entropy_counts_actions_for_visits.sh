#!/usr/bin/env bash
# gym_info 0.1.1: `entropies(env)` reports the entropy of the actions of a run given the states, H(A|S), in bits. It is
# documented as the sum of p(s) H(A|S=s). For p(s), the library counts the rows of a table that has one for each pair of
# state and action that occurred, in place of the visits. Nothing warns. So the weights do not sum to one, and fall with
# the length of the run. In two states, a policy that always tosses a coin has 1 bit. The library reports 0.04 bits for
# 100 steps, and 0.0004 for 10000, as of a policy that is nearly deterministic.
# Law: H(A|S) = H(A, S) - H(S). SciPy 1.17.1 computes both. For actions that do not depend on the states, it is H(A).
# Upstream: the package names no repository; no report of it was found.
# H(S) and H(A) are right. The entropy of pairs of state and action, less `H_S`, is the conditional one.
# Prints the entropies for runs of three lengths, and of CartPole, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'gym_info==0.1.1' 'gymnasium==1.4.0' \
  'numpy==2.4.6' 'scipy==1.17.1' 'matplotlib==3.11.2' 'pandas==3.1.1'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import gym_info
import gymnasium
import numpy as np
from scipy.stats import entropy


class Rooms(gymnasium.Env):
    """Two rooms; the room of a step is the action before it."""

    observation_space = gymnasium.spaces.Box(0.0, 1.0, (1,), np.float32)
    action_space = gymnasium.spaces.Discrete(2)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return np.zeros(1, np.float32), {}

    def step(self, action):
        return np.full(1, action, np.float32), 0.0, False, False, {}


def bits(rows):
    """Entropy of the rows of an array."""
    return entropy(np.unique(rows, axis=0, return_counts=True)[1], base=2.0)


def run(env, steps):
    """Entropies by the library, and H(A, S) - H(S) and H(A) of the same states and actions."""
    env = gym_info.attach(env, obs_bins=2)
    random = np.random.default_rng(0)
    states, actions = [], []
    observation, _ = env.reset(seed=0)
    for action in random.integers(2, size=steps):
        states.append(observation)
        actions.append([action])
        observation, _, terminated, truncated, _ = env.step(action)
        if terminated or truncated:
            observation, _ = env.reset()
    low, high = env.observation_space.low, env.observation_space.high
    everything = np.array(env.buffers.observations)
    low, high = np.where(np.isfinite(low), (low, high), (everything.min(axis=0), everything.max(axis=0)))
    states = np.array(states) >= 0.5 * (low + high)
    return gym_info.entropies(env), bits(np.hstack((states, actions))) - bits(states), bits(states), bits(actions)


ok = True
for steps in (100, 1000, 10000):
    seen, given, of_states, of_actions = run(Rooms(), steps)
    print(f"two rooms, {steps} steps: H(A|S) {seen.H_A_given_S:.4f} bits, by SciPy {given:.4f}; H(A) {seen.H_A:.4f},"
          f" by SciPy {of_actions:.4f}")
    ok &= np.allclose((seen.H_S, seen.H_A), (of_states, of_actions)) and given > 0.95
    ok &= np.isclose(seen.H_A_given_S, 4.0 / steps, rtol=0.05)
seen, given, of_states, of_actions = run(gymnasium.make("CartPole-v1"), 2000)
print(f"CartPole, random actions, 2000 steps: H(A|S) {seen.H_A_given_S:.4f} bits, by SciPy {given:.4f}")
ok &= np.allclose((seen.H_S, seen.H_A), (of_states, of_actions)) and given > 0.9 and seen.H_A_given_S < 0.05
sys.exit(not ok)
PY
