#!/usr/bin/env bash
# MO-Gymnasium 1.3.2 (Gymnasium 1.4.0): `wrappers.vector.MORecordEpisodeStatistics` reports the return of each episode
# of a batch, `r`, and the discounted one, `dr`. When an episode ends, the wrapper sets the return to zero, and leaves
# the discounted return. So `dr` is the sum over all episodes since the last call of `reset`, which nobody calls where a
# batch resets itself. A learning curve of `dr` rises steadily for a policy that learns nothing.
# The wrapper for a single environment, which is reset at each episode, is right.
# Law: without discount, gamma = 1, both returns are equal; equal episodes have equal returns.
# Upstream: the merged pull request github.com/Farama-Foundation/MO-Gymnasium/pull/142, which this release lacks.
# Prints both returns of equal episodes, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'mo-gymnasium==1.3.2' 'gymnasium==1.4.0' \
  'numpy==2.4.6'
cd "$folder"
export PYGAME_HIDE_SUPPORT_PROMPT=1
"$folder/venv/bin/python" - <<'PY'
import sys

import gymnasium
import numpy as np
from mo_gymnasium.wrappers import MORecordEpisodeStatistics as OfOne
from mo_gymnasium.wrappers.vector import MORecordEpisodeStatistics as OfBatch
from mo_gymnasium.wrappers.vector import MOSyncVectorEnv

LENGTH, EPISODES = 4, 3


class Constant(gymnasium.Env):
    """Rewards of 1 and -2 at each of LENGTH steps."""

    observation_space = gymnasium.spaces.Box(0.0, LENGTH, (1,))
    action_space = gymnasium.spaces.Discrete(2)
    reward_space = gymnasium.spaces.Box(-2.0, 1.0, (2,))

    def _observation(self):
        return np.array([self.steps], np.float32)

    def reset(self, seed=None, options=None):
        super().reset(seed=seed)
        self.steps = 0
        return self._observation(), {}

    def step(self, action):
        self.steps += 1
        return self._observation(), np.array([1.0, -2.0], np.float32), self.steps == LENGTH, False, {}


def of_one(gamma):
    """Returns and discounted returns of each episode, by the wrapper of a single environment."""
    env, rows = OfOne(Constant(), gamma=gamma), []
    for _ in range(EPISODES):
        env.reset(seed=0)
        for _ in range(LENGTH):
            info = env.step(0)[-1]
        rows.append((info["episode"]["r"], info["episode"]["dr"]))
    return np.array(rows, float)


def of_batch(gamma):
    """Returns and discounted returns of each episode of the first of two, by the wrapper of a batch."""
    envs, rows = OfBatch(MOSyncVectorEnv([Constant, Constant]), gamma=gamma), []
    envs.reset(seed=0)
    while len(rows) < EPISODES:
        info = envs.step(np.zeros(2, int))[-1]
        if "episode" in info:
            rows.append((info["episode"]["r"][0], info["episode"]["dr"][0]))
    return np.array(rows, float)


ok = True
for gamma in (1.0, 0.9):
    due = np.array([1.0, -2.0]) * sum(gamma**k for k in range(LENGTH))
    for name, rows in (("single", of_one(gamma)), ("batch", of_batch(gamma))):
        print(f"gamma {gamma:g}, {name}: r {rows[:, 0].tolist()}, dr {rows[:, 1].round(3).tolist()}")
        times = np.arange(1, EPISODES + 1) if name == "batch" else np.ones(EPISODES)
        ok &= np.allclose(rows[:, 0], [LENGTH, -2.0 * LENGTH]) and np.allclose(rows[:, 1], np.outer(times, due))
sys.exit(not ok)
PY
