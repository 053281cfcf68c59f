"""CleanRL's ppo.py, unmodified, on the discrete environment: python examples/cleanrl_ppo.py [steps].

The ppo.py that PyPI has (cleanrl 1.2.0) speaks the interface of gym 0.23, behind which this file registers the
environment when it is imported.
"""

import os
import re
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import gym
import gymnasium
import numpy as np

import activeslam_gym  # noqa: F401  (registers the environments)


class Gym023(gym.Env):
    """A Gymnasium environment with the four-tuple of gym 0.23; a time limit is told in the info."""

    def __init__(self, **kwargs: Any) -> None:
        self.env = gymnasium.make("ActiveSLAMDiscrete-v0", **kwargs)
        inner: Any = self.env.observation_space
        self.observation_space = gym.spaces.Box(inner.low, inner.high, inner.shape, inner.dtype)
        self.action_space = gym.spaces.Discrete(int(self.env.action_space.n))  # type: ignore[attr-defined]
        self._seed: int | None = None

    def seed(self, seed: int | None = None) -> list[int | None]:
        """Serves the next reset."""
        self._seed = seed
        return [seed]

    def reset(self, **kwargs: Any) -> np.ndarray:
        """The first observation alone."""
        seed, self._seed = self._seed, None
        return self.env.reset(seed=seed)[0]

    def step(self, action: int) -> tuple[np.ndarray, float, bool, dict[str, Any]]:
        """Observation, reward, done, info."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        return observation, float(reward), terminated or truncated, {**info, "TimeLimit.truncated": truncated}


gym.register("ActiveSLAMDiscrete-v0", entry_point=Gym023)


def main(steps: int = 44_800) -> tuple[float, float]:
    """Train for `steps` decisions; the mean return [bit] of the first and of the last quarter of the episodes."""
    options = {"total-timesteps": steps, "num-envs": 16, "num-steps": 140, "learning-rate": 7e-4, "gamma": 0.995}
    run = f"import runpy, {Path(__file__).stem}; runpy.run_module('cleanrl.ppo', run_name='__main__')"
    command = [sys.executable, "-c", run, "--env-id", "ActiveSLAMDiscrete-v0"]
    command += [text for name, value in options.items() for text in (f"--{name}", str(value))]
    began = time.monotonic()
    path = os.pathsep.join([str(Path(__file__).parent), *filter(None, [os.environ.get("PYTHONPATH")])])
    done = subprocess.run(
        command, env={**os.environ, "PYTHONPATH": path}, stdout=subprocess.PIPE, text=True, check=True
    )
    returns = [float(found) for found in re.findall(r"episodic_return=([-\d.e+]+)", done.stdout)]
    quarter = max(len(returns) // 4, 1)
    first, last = float(np.mean(returns[:quarter])), float(np.mean(returns[-quarter:]))
    print(f"CleanRL ppo.py: {first:.0f} -> {last:.0f} bits, {steps} steps in {time.monotonic() - began:.0f} s")
    return first, last


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
