#!/usr/bin/env bash
# Gymnasium 1.4.0: `MaxAndSkipObservation(env, skip=4)` repeats each action, and promises "the max between the two last
# frames". It stores the third and the fourth frame of an action. Where the episode ends at the first or second one,
# none is stored, and the maximum is that of the action before. Where it ends at the third, the maximum is of this frame
# and of the fourth of the action before. Nothing warns. So the last observation of an episode, from which a truncated
# one is bootstrapped, is up to two frames old. Where an episode ends within its first action, its observation is that
# of the *previous episode*, or zero if there was none.
# Law: the wrapper returns the maximum of two frames of one action. Episodes whose length divides by 4 are right.
# Upstream: github.com/Farama-Foundation/Gymnasium/pull/1692, open, describes it; not in 1.4.0.
# Prints the last observations of episodes that count their steps, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'gymnasium==1.4.0' 'numpy==2.4.6'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import gymnasium
import numpy as np
from gymnasium.wrappers import MaxAndSkipObservation


class Counter(gymnasium.Env):
    """Observes the episode and its step. Episodes have the given lengths."""

    observation_space = gymnasium.spaces.Box(0.0, 1000.0, (2,), np.float32)
    action_space = gymnasium.spaces.Discrete(2)

    def __init__(self, lengths):
        self.lengths, self.episode, self.count = lengths, 0, 0

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.episode, self.count = self.episode + 1, 0
        return np.array((self.episode, 0), np.float32), {}

    def step(self, action):
        self.count += 1
        observation = np.array((self.episode, self.count), np.float32)
        return observation, 0.0, False, self.count == self.lengths[self.episode - 1], {}


def last(lengths):
    """Last observations of the episodes, as (episode, step)."""
    env = MaxAndSkipObservation(Counter(lengths), skip=4)
    found = []
    for _ in lengths:
        env.reset()
        done = False
        while not done:
            observation, _, _, done, _ = env.step(0)
        found.append(tuple(int(number) for number in observation))
    return found


ok = True
for lengths, expected in (
    ((8,), [(1, 8)]), ((9,), [(1, 8)]), ((10,), [(1, 8)]), ((11,), [(1, 11)]), ((1, 8, 2), [(0, 0), (2, 8), (2, 8)])
):
    found = last(lengths)
    print(f"episodes of {lengths} steps end at the observations (episode, step) {found}")
    ok &= found == expected
sys.exit(not ok)
PY
