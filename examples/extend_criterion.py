"""A criterion of your own: score the seven motions by what they would do to the camera's own position."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from scipy.linalg import solve_triangular

import activeslam_gym  # noqa: F401  (registers the environment)
from activeslam_gym import Gaze, Motion, information
from baselines import best


# --8<-- [start:criterion]
def position_variance_reduction(env: Any) -> np.ndarray:
    """(7,) by how much each motion is expected to lower tr P of the camera's position [m^2] (A-optimality).

    By the EKF's update, tr P falls by tr(P_p H^T S^-1 H P_p^T), where P_p are the position's three rows of P.
    """
    inner = env.unwrapped
    camera, motion = inner.setting.models.camera, inner.setting.models.motion
    prospect = inner.prospect  # the belief, and the landmarks that are expected
    frames = round(inner.motion_period / inner.scenario.frame_time)
    P = information.propagated(motion, prospect.covariance, 0.0, frames)  # after the motion, before its measurement
    out = np.zeros(len(Motion))
    for index in Motion:
        pose = information.pose_after(motion, prospect.camera, int(index), 0.0)
        sight = information.sight_from(camera, prospect, pose)  # what is in view there, with Jacobians
        if len(sight.point):
            S, _ = information.innovation_of(P, sight, camera.pixel_std**2)
            HP = information.measured_covariance(P, sight, 3)
            out[index] = np.sum(solve_triangular(np.linalg.cholesky(S), HP, lower=True) ** 2)
    return out


# --8<-- [end:criterion]

if __name__ == "__main__":
    env = gym.make("ActiveSLAM-v0", gaze_period=0.25)
    env.reset(seed=0)
    for _ in range(20):
        env.step((Motion.RIGHT, Gaze.STAY))
    scores = position_variance_reduction(env)
    for index in Motion:
        print(f"{index.name:10} {1e4 * scores[index]:8.3f} cm^2")
    print("best:", Motion(int(best(scores))).name)
