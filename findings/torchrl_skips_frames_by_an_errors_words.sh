#!/usr/bin/env bash
# TorchRL 0.14.1 with Gymnasium 1.4.0: `GymEnv(name, frame_skip=4)` hands an argument `frameskip` to the environment's
# constructor. Where Python's own words say that there is no such argument, TorchRL skips frames itself. All else means
# to it that the environment does. An environment with `**options`, which keeps what it does not know, thus plays every
# frame, without a warning. One that refuses in words of its own cannot be made, even without a `frame_skip`.
# Law: the documentation of `GymEnv` says how often an action is repeated: `frame_skip` times.
# Upstream: github.com/pytorch/rl/pull/896 is of the same lines; no issue that was found tells this.
# `GymWrapper(gymnasium.make(name), frame_skip=4)` makes no such attempt, and skips.
# Prints what three environments show that count their steps, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'torchrl==0.14.1' 'gymnasium==1.4.0' \
  'torch==2.13.0' 'numpy==2.4.6'
cd "$folder"
"$folder/venv/bin/python" -W ignore - <<'PY'
import sys

import gymnasium
import numpy as np
from torchrl.envs import GymEnv, GymWrapper


class Counter(gymnasium.Env):
    """An observation that counts the steps."""

    observation_space = gymnasium.spaces.Box(0.0, 200.0, (1,), np.float64)
    action_space = gymnasium.spaces.Discrete(2)

    def __init__(self, render_mode=None):
        self.render_mode = render_mode

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.count = 0
        return np.zeros(1), {}

    def step(self, action):
        self.count += 1
        return np.full(1, float(self.count)), 1.0, False, False, {}


class WithOptions(Counter):
    """The same, with options of its own, which are kept as they come."""

    def __init__(self, render_mode=None, **options):
        super().__init__(render_mode)
        self.options = options


class OwnWords(Counter):
    """The same, which tells what it allows."""

    def __init__(self, render_mode=None, **options):
        super().__init__(render_mode)
        if options:
            raise TypeError(f"no such option: {', '.join(options)}")


def shown(env):
    """What an environment shows in three steps."""
    return env.rollout(3)["next", "observation"].flatten().int().tolist()


found = {}
for kind in (Counter, WithOptions, OwnWords):
    name = f"{kind.__name__}-v0"
    gymnasium.register(name, entry_point=kind)
    try:
        rows = shown(GymEnv(name, frame_skip=4))
    except TypeError as error:
        rows = str(error).partition(" was raised")[0]
    found[kind.__name__] = rows
    print(f"{kind.__name__}, frame_skip=4: {rows}")
wrapped = shown(GymWrapper(gymnasium.make("WithOptions-v0"), frame_skip=4))
print(f"WithOptions by GymWrapper, frame_skip=4: {wrapped}")
expected = {"Counter": [4, 8, 12], "WithOptions": [1, 2, 3], "OwnWords": "no such option: frameskip"}
sys.exit(found != expected or wrapped != [4, 8, 12])
PY
