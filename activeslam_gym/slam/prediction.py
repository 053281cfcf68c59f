"""Prediction of the mean and the joint covariance, cross-covariances included."""

from __future__ import annotations

import numpy as np

from activeslam_gym.compilation import part
from activeslam_gym.linalg import copy_into
from activeslam_gym.motion import (
    ANGULAR_VELOCITY,
    CAMERA_DIM,
    MotionModel,
    process_covariance,
    transition,
    transition_jacobian,
)
from activeslam_gym.slam.belief import DIM, FRAME, Belief


@part
def predict(motion: MotionModel, belief: Belief, u: np.ndarray) -> None:
    """One frame ahead under the known accelerations ``u`` (6,): x = f(x, u), P = F P F^T + Q in the camera's rows."""
    x = transition(belief.camera, u, motion.dt)
    F_x = transition_jacobian(x[ANGULAR_VELOCITY], motion.dt)
    copy_into(belief.camera, x)
    propagate(belief.covariance, belief.size[DIM], F_x, process_covariance(motion, F_x))
    belief.size[FRAME] += 1


@part
def propagate(P: np.ndarray, dim: int, F: np.ndarray, Q: np.ndarray) -> None:
    """P_cc = F P_cc F^T + Q and P_cy = F P_cy on the leading ``dim`` rows of ``P``, for any camera transition."""
    rows = np.zeros((CAMERA_DIM, dim))
    for i in range(CAMERA_DIM):
        for k in range(CAMERA_DIM):
            factor = F[i, k]
            if factor != 0.0:
                for j in range(dim):
                    rows[i, j] += factor * P[k, j]
    for i in range(CAMERA_DIM):
        for j in range(CAMERA_DIM, dim):
            P[i, j] = rows[i, j]
            P[j, i] = rows[i, j]
    for i in range(CAMERA_DIM):
        for j in range(i + 1):
            value = Q[i, j]
            for k in range(CAMERA_DIM):
                value += rows[i, k] * F[j, k]
            P[i, j] = value
            P[j, i] = value
