"""Rewards of your own: a registered potential, and a wrapper that gives a translation a price."""

import math
from typing import Any

import gymnasium as gym
import numpy as np

from activeslam_gym import Motion
from activeslam_gym.envs.reward import REWARDS


@REWARDS.register("accuracy")
def accuracy(e: Any) -> float:
    """-log2 of the camera's true position error, against a centimetre [bit], and a bit for each landmark in the map."""
    return e.distinct_landmarks - math.log2(1.0 + e.position_error / 0.01)


class PricedMotion(gym.Wrapper[np.ndarray, Any, np.ndarray, Any]):
    """The reward of ``env`` [bit], less a price for every period in which the camera translates.

    The price is one more of `info["reward_terms"]`.
    """

    def __init__(self, env: gym.Env[np.ndarray, Any], price: float = 1.0) -> None:
        super().__init__(env)
        self.price = price  # [bit] a translation

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        inner: Any = self.env.unwrapped
        is_read = inner.motion_phase == 0  # in between, the motion of an action is ignored
        observation, reward, terminated, truncated, info = self.env.step(action)
        cost = self.price if is_read and action[0] != Motion.STAY else 0.0
        info["reward_terms"]["price"] = -cost
        return observation, float(reward) - cost, terminated, truncated, info


if __name__ == "__main__":
    env = PricedMotion(gym.make("ActiveSLAM-v0", reward="accuracy"), price=2.0)
    env.reset(seed=0)
    total = sum(float(env.step((Motion.RIGHT, 1))[1]) for _ in range(40))
    print(f"{total:.1f} bits in 10 s, ten translations paid")
