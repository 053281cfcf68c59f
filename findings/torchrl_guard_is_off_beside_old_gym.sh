#!/usr/bin/env bash
# TorchRL 0.14.1 with Gymnasium 1.4.0: `GymWrapper` refuses a batch in the mode NEXT_STEP, Gymnasium's default, since it
# cannot follow its resets. Where the old package gym 0.26.2 is installed too, though the program has no use for it, the
# refusal is gone: TorchRL chooses the check by a library that it finds, before it looks at the environment's own.
# A rollout over the end of an episode then has the last observation in the wrong place, and `check_env_specs` passes.
# The transition that ends the episode leads to zeros. The last observation begins the next episode, with a step that is
# none. Upstream: github.com/pytorch/rl/issues/2477 tells why the mode is not supported.
# Prints the transitions of an environment whose episodes show 100, 101, 102, 103, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
pip=("$folder/venv/bin/pip" --quiet --disable-pip-version-check install)
"${pip[@]}" 'torchrl==0.14.1' 'gymnasium==1.4.0' 'torch==2.13.0' 'numpy==2.4.6'
cd "$folder"
cat >rollout.py <<'PY'
import importlib.util
import sys

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from torchrl.envs import GymWrapper
from torchrl.envs.utils import check_env_specs


class Fixed(gymnasium.Env):
    """Episodes of ``length`` steps, cut by a time limit."""

    observation_space = gymnasium.spaces.Box(0.0, 200.0, (1,), np.float64)
    action_space = gymnasium.spaces.Discrete(2)

    def __init__(self, length):
        self.length = length

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.count = 0
        return np.full(1, 100.0), {}

    def step(self, action):
        self.count += 1
        return np.full(1, 100.0 + self.count), 1.0, False, self.count == self.length, {}


beside = importlib.util.find_spec("gym") is not None
print("gym is installed too:", beside)
try:
    batch = GymWrapper(SyncVectorEnv([lambda: Fixed(3), lambda: Fixed(5)], autoreset_mode=AutoresetMode.NEXT_STEP))
except RuntimeError as error:
    print("refused:", error)
    sys.exit(beside)
data = batch.rollout(5, break_when_any_done=False)[0]
columns = data["observation"], data["next", "observation"], data["next", "reward"], data["next", "done"]
rows = list(zip(*(column.flatten().int().tolist() for column in columns)))
print("taken:", ", ".join(f"{a} -> {b} (reward {r}{', the end' * end})" for a, b, r, end in rows))
check_env_specs(batch)
wrong = [(100, 101, 1, 0), (101, 102, 1, 0), (102, 0, 1, 1), (103, 100, 0, 0), (100, 101, 1, 0)]
sys.exit(not beside or rows != wrong)
PY
"$folder/venv/bin/python" -W ignore rollout.py
"${pip[@]}" 'gym==0.26.2'
"$folder/venv/bin/python" -W ignore rollout.py
