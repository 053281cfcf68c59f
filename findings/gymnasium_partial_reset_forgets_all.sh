#!/usr/bin/env bash
# Gymnasium 1.4.0: with `AutoresetMode.DISABLED`, `reset(options={"reset_mask": mask})` is the documented way to reset
# some environments of a batch. `SyncVectorEnv` takes the mask out of the caller's dictionary, so the wrapper
# `gymnasium.wrappers.vector.RecordEpisodeStatistics` no longer finds it, and clears the statistics of the environments
# that still run. Their episodes are reported shorter, with a lower return, without a warning.
# Upstream: the open pull request github.com/Farama-Foundation/Gymnasium/pull/1696.
# A batch that leaves the dictionary as it is does not suffer from it.
# Prints the lengths that the wrapper reports for episodes of 3 and 5 steps, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'gymnasium==1.4.0'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers.vector import RecordEpisodeStatistics


class Fixed(gymnasium.Env):
    """Episodes of ``length`` steps, with the reward 1 for each."""

    observation_space = gymnasium.spaces.Box(0.0, 10.0, (1,), np.float32)
    action_space = gymnasium.spaces.Discrete(2)

    def __init__(self, length):
        self.length = length

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.count = 0
        return np.zeros(1, np.float32), {}

    def step(self, action):
        self.count += 1
        return np.full(1, self.count, np.float32), 1.0, self.count == self.length, False, {}


def reported(mode):
    """The lengths of the first episodes that the wrapper reports, for each of two environments."""
    batch = RecordEpisodeStatistics(SyncVectorEnv([lambda: Fixed(3), lambda: Fixed(5)], autoreset_mode=mode))
    batch.reset(seed=0)
    lengths = [[], []]
    for _ in range(20):
        _, _, ended, _, info = batch.step(np.zeros(2, int))
        for k in np.flatnonzero(ended):
            lengths[k].append(int(info["episode"]["l"][k]))
        if ended.any() and mode is AutoresetMode.DISABLED:
            batch.reset(options={"reset_mask": ended})
    return lengths[0][:3], lengths[1][:3]


automatic, by_mask = reported(AutoresetMode.NEXT_STEP), reported(AutoresetMode.DISABLED)
print("episodes of 3 and 5 steps, automatic reset:", automatic, "| reset by mask:", by_mask)
sys.exit(not (automatic == ([3, 3, 3], [5, 5, 5]) and by_mask[1] == [2, 1, 3]))
PY
