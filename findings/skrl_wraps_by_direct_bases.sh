#!/usr/bin/env bash
# skrl 2.1.1 with Gymnasium 1.2.3: `wrap_env(env)` looks for Gymnasium's name among the direct bases of the
# environment's class alone. A class that inherits from `gymnasium.Env` through another class of the same program is an
# environment by every check of Gymnasium, and is refused unless the wrapper is named: wrap_env(env, wrapper="gymnasium").
# Prints what happens to both classes, and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --quiet --disable-pip-version-check install 'skrl==2.1.1' 'gymnasium==1.2.3' 'torch==2.13.0'
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import sys

import gymnasium
import numpy as np
from gymnasium.utils.env_checker import check_env
from skrl import logger
from skrl.envs.wrappers.torch import wrap_env

logger.setLevel("ERROR")


class Direct(gymnasium.Env):
    observation_space = gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)
    action_space = gymnasium.spaces.Discrete(2)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return np.zeros(2, np.float32), {}

    def step(self, action):
        return np.zeros(2, np.float32), 0.0, False, False, {}


class Base(Direct):
    """An intermediate class."""


class Through(Base):
    """The same environment, one class further from gymnasium.Env."""


def outcome(env, **options):
    try:
        return type(wrap_env(env, verbose=False, **options)).__name__
    except Exception as error:
        return f"{type(error).__name__}"


for one in (Direct, Through):
    check_env(one(), skip_render_check=True)
found = [outcome(Direct()), outcome(Through()), outcome(Through(), wrapper="gymnasium")]
print("direct base:", found[0], "| through another class:", found[1], "| the same, wrapper named:", found[2])
sys.exit(not (found[0] == found[2] == "GymnasiumWrapper" and found[1] == "ValueError"))
PY
