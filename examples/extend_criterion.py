"""A criterion of your own: motions by what their measurements would do to the variance of the camera's position."""

from typing import Any

import gymnasium as gym
import numpy as np

from activeslam_gym import Gaze, Motion
from activeslam_gym.information import CRITERIA
from baselines.greedy import Greedy


@CRITERIA.register("position_variance")
def position_variance(P: np.ndarray, sight: Any, pixel_var: float) -> float:
    """tr(P_p H^T S^-1 H P_p^T), P_p the position's three rows of P: how much the EKF's update lowers tr P_pp [m^2]."""
    HP = sight.HP[:, :3]
    return np.sum(HP * np.linalg.solve(sight.S, HP))


if __name__ == "__main__":
    env: Any = gym.make("ActiveSLAM-v0")
    observation, _ = env.reset(seed=0)
    policy = Greedy(env, motion_criterion="position_variance", gaze_criterion="fisher_trace")
    for _ in range(20):
        observation, *_ = env.step(policy.predict(observation)[0])
    scores = env.unwrapped.motion_scores("position_variance")
    for index in Motion:
        print(f"{index.name:10} {1e4 * scores[index]:8.3f} cm^2")
    motion, gaze = policy.predict(observation)[0]
    print("chosen:", Motion(motion).name, Gaze(gaze).name)
