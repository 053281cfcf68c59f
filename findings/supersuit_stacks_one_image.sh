#!/usr/bin/env bash
# SuperSuit 3.11.0: `frame_stack_v1` and `frame_stack_v2` stack the last images of an environment. For images of two
# axes, as of grey or depth, and `stack_dim=0`, which is the order of PyTorch, the stack has no past: all images but
# the last are copies of the newest, and the last, where the newest belongs, is zero for ever. A policy that needs two
# images to see motion sees none. Shapes and types agree with the observation space, so no check complains.
# The default `stack_dim=-1` is right, and so is `stack_dim=0` for images of three axes, with a first axis of one.
# Upstream: pull request github.com/Farama-Foundation/SuperSuit/pull/142 added it; no issue that was found tells it.
# Prints the stacks of images that are filled with 1, 2, 3, ..., and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'supersuit==3.11.0' 'pettingzoo==1.27.0' \
  'gymnasium==1.4.0' 'numpy==2.4.6'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import gymnasium
import numpy as np
import supersuit


class Counter(gymnasium.Env):
    """Image k is filled with k."""

    action_space = gymnasium.spaces.Discrete(1)

    def __init__(self, shape):
        self.observation_space = gymnasium.spaces.Box(0.0, 255.0, shape, np.float32)

    def image(self):
        self.k += 1
        return np.full(self.observation_space.shape, self.k, np.float32)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.k = 0
        return self.image(), {}

    def step(self, action):
        return self.image(), 0.0, False, False, {}


seen = {}
for stack in (supersuit.frame_stack_v1, supersuit.frame_stack_v2):
    for shape, axis in (((84, 84), -1), ((1, 84, 84), 0), ((84, 84), 0)):
        env = stack(Counter(shape), 4, stack_dim=axis)
        env.reset()
        for _ in range(5):
            observation, *_ = env.step(0)
        assert env.observation_space.contains(observation)
        images = np.moveaxis(observation, axis, 0)
        assert np.ptp(images, axis=(1, 2)).max() == 0.0
        seen[stack.__name__, shape, axis] = images[:, 0, 0].tolist()
        print(f"{stack.__name__}, images {shape}, stack_dim={axis}: {images[:, 0, 0]}")
right = [value == [3.0, 4.0, 5.0, 6.0] for value in seen.values()]
wrong = all(seen[key] == [6.0, 6.0, 6.0, 0.0] for key in seen if key[1:] == ((84, 84), 0))
sys.exit(not (right == [True, True, False] * 2 and wrong))
PY
