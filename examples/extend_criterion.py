"""A criterion of your own: score the seven motions by what they would do to the camera's own position."""

from typing import Any

import gymnasium as gym
import numpy as np

import activeslam_gym  # noqa: F401  (registers the environment)
from activeslam_gym import Gaze, Motion
from activeslam_gym.information.candidates import pose_after, propagated, sight_after
from activeslam_gym.information.criteria import Criterion
from activeslam_gym.slam.sight import Sight
from baselines import best


# --8<-- [start:criterion]
def position_variance(P: np.ndarray, sight: Sight, pixel_var: float) -> float:
    """tr(P_p H^T S^-1 H P_p^T), P_p the position's three rows of P: how much the EKF's update lowers tr P_pp [m^2]."""
    HP = sight.HP[:, :3].copy()
    return np.sum(HP * np.linalg.solve(sight.S, HP))


# --8<-- [end:criterion]


# --8<-- [start:scores]
def motion_scores(env: Any, criterion: Criterion) -> np.ndarray:
    """(7,) by a criterion, of what is in view at the end of each motion: as the environment's own `motion_scores`."""
    inner = env.unwrapped
    camera, motion, prospect = inner.setting.models.camera, inner.setting.models.motion, inner.prospect
    frames = round(inner.motion_period / inner.scenario.frame_time)
    P = propagated(motion, prospect.covariance, 0.0, frames)  # after the motion, before its measurements
    poses = [pose_after(motion, prospect.camera, int(index), 0.0, frames) for index in Motion]
    sights = [sight_after(camera, prospect, P, pose) for pose in poses]
    return np.array([criterion(P, sight, camera.pixel_std**2) for sight in sights])


# --8<-- [end:scores]

if __name__ == "__main__":
    env = gym.make("ActiveSLAM-v0", gaze_period=0.25)
    env.reset(seed=0)
    for _ in range(20):
        env.step((Motion.RIGHT, Gaze.STAY))
    scores = motion_scores(env, position_variance)
    for index in Motion:
        print(f"{index.name:10} {1e4 * scores[index]:8.3f} cm^2")
    print("best:", Motion(int(best(scores))).name)
