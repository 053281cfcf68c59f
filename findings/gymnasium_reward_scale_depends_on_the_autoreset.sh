#!/usr/bin/env bash
# Gymnasium 1.4.0: the vector wrapper `NormalizeReward` divides rewards by the deviation of the discounted return, that
# of each episode so far. In the autoreset mode SAME_STEP, a return starts anew with each episode. In the default,
# NEXT_STEP, and in DISABLED, that of a truncated episode goes on in the next one. So episodes that end by a limit of
# time have one endless return. Nothing warns, and the documentation does not tell it. After 200 episodes of ten
# rewards of 1, each reward is 0.37 in the one mode and 0.06 in the other two.
# Law: the mode says when an environment is reset, and neither rewards nor returns depend on it. After terminations,
# the rewards of all modes differ by a tenth.
# Upstream: github.com/Farama-Foundation/Gymnasium/issues/760, closed, tells it of the single environment.
# Prints the return and the last normalized reward by all modes, and fails if that changes.
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
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers import vector

GAMMA, LENGTH, EPISODES = 0.99, 10, 200


class Steady(gymnasium.Env):
    """Rewards 1 for each step. Episodes have ten steps."""

    observation_space = gymnasium.spaces.Box(0.0, 1.0, (1,), np.float32)
    action_space = gymnasium.spaces.Discrete(2)

    def __init__(self, truncates):
        self.truncates = truncates

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.count = 0
        return np.zeros(1, np.float32), {}

    def step(self, action):
        self.count += 1
        done = self.count == LENGTH
        return np.zeros(1, np.float32), 1.0, done and not self.truncates, done and self.truncates, {}


ok = True
for truncates in (True, False):
    returns, rewards = {}, {}
    for mode in AutoresetMode:
        env = vector.NormalizeReward(SyncVectorEnv([lambda: Steady(truncates)], autoreset_mode=mode), gamma=GAMMA)
        env.reset()
        largest = 0.0
        for _ in range(EPISODES * LENGTH):
            _, reward, terminated, truncated, _ = env.step(np.zeros(1, int))
            largest = max(largest, float(env.accumulated_reward[0]))
            if mode == AutoresetMode.DISABLED and (terminated | truncated).any():
                env.env.reset(options={"reset_mask": terminated | truncated})
            if reward[0] != 0.0:
                rewards[mode.name] = float(reward[0])
        returns[mode.name] = largest
    print(f"episodes of {LENGTH} rewards of 1 that are {'truncated' if truncates else 'terminated'}: the largest return"
          f" {({name: round(value, 2) for name, value in returns.items()})}, the last reward"
          f" {({name: round(float(value), 3) for name, value in rewards.items()})}")
    low, high = (min(rewards.values()), max(rewards.values()))
    ok &= bool(high > 2.0 * low if truncates else high < 1.5 * low)
    others = [name for name in returns if name != "SAME_STEP"]
    ok &= returns["SAME_STEP"] < LENGTH and all((returns[name] > 5 * LENGTH) == truncates for name in others)
sys.exit(not ok)
PY
