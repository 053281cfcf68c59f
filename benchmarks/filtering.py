"""Predict + update of our filter alone, without association, on a map of points: what a plain EKF does too."""

from __future__ import annotations

import numpy as np
from numba import njit

from activeslam_gym.camera import CameraModel, camera_of
from activeslam_gym.motion import MotionModel, motion_of
from activeslam_gym.slam.belief import Belief, empty_belief
from activeslam_gym.slam.measurement import UNSEEN, predict_measurements
from activeslam_gym.slam.prediction import predict
from activeslam_gym.slam.update import innovation_covariance, stack, update

from .setups import SEEN, fill_with_points, map_scenario, points_around


@njit  # no cache: it would not notice an edit of the kernels inside
def predict_and_update(
    camera: CameraModel, motion: MotionModel, belief: Belief, fiducials: np.ndarray, u: np.ndarray, frames: int
) -> int:
    """``frames`` times predict, and update by everything in view at its predicted pixel; how much was seen at last."""
    seen = 0
    for _ in range(frames):
        predict(motion, belief, u)
        predictions = predict_measurements(camera, belief, fiducials)
        rows = np.flatnonzero(predictions.visibility != UNSEEN)
        HP = stack(belief, fiducials.shape[0], rows, predictions)
        S = innovation_covariance(belief, fiducials.shape[0], rows, predictions, HP, camera.pixel_std**2)
        update(belief, HP, S, np.zeros(HP.shape[0]))
        seen = rows.shape[0]
    return seen


class PointFilter:
    """`predict_and_update` on a map of ``landmarks`` points, `SEEN` of them in view."""

    def __init__(self, landmarks: int) -> None:
        scenario, rng = map_scenario(landmarks), np.random.default_rng(landmarks)
        self.camera, self.motion = camera_of(scenario), motion_of(scenario, 1.0)
        self.belief = empty_belief(scenario)
        fill_with_points(self.belief, scenario, points_around(landmarks, rng), rng)
        if self.run(1) != SEEN:
            raise RuntimeError(f"{self.run(1)} points in view instead of {SEEN}")

    def run(self, frames: int) -> int:
        """So many frames; the points seen in the last."""
        return predict_and_update(self.camera, self.motion, self.belief, np.zeros((0, 3)), np.zeros(6), frames)
