"""The model of the sensor `points`: a pixel of each landmark in view, with white noise."""

import numpy as np

from activeslam_gym.camera import View, camera_of, visible
from activeslam_gym.config import Scenario
from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.motion import POSITION, QUATERNION
from activeslam_gym.slam.estimate import Estimate
from activeslam_gym.slam.sight import POSE_DIM, point_measurement


class PointModel:
    """What an estimator and a planner may know of it; ``boxes`` (B, 2, 3) are those known to hide landmarks [m]."""

    def __init__(self, scenario: Scenario, boxes: np.ndarray) -> None:
        self.camera = camera_of(scenario)
        self.noise = scenario.pixel_std**2 * np.eye(2)
        self._boxes = boxes

    def predict(self, camera: np.ndarray, point: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The pixel (2,) of a world ``point`` (3,) from ``camera`` (13,), and its Jacobians (2, 6) and (2, 3).

        NaN where the point is not in front of the camera.
        """
        z, H_x, H_y = np.full(2, np.nan), np.zeros((2, POSE_DIM)), np.zeros((2, 3))
        if not point_measurement(self._view(camera), np.asarray(point, float), z, H_x, H_y):
            z[:] = np.nan
        return z, H_x, H_y

    def visible(self, estimate: Estimate, camera: np.ndarray, points: np.ndarray) -> np.ndarray:
        """(m,) bool: which of the ``points`` (m, 3) would be measured: those `in_view`."""
        return self.in_view(camera, points)

    def in_view(self, camera: np.ndarray, points: np.ndarray) -> np.ndarray:
        """(m,) bool: which of the ``points`` (m, 3) are inside the image of ``camera`` (13,), and not hidden."""
        view, z = self._view(camera), np.empty(2)
        return np.array([visible(view, point, 0.0, z) for point in points], bool)

    def _view(self, camera: np.ndarray) -> View:
        return View(
            self.camera, camera[POSITION.start : QUATERNION.stop], rotation_matrix(camera[QUATERNION]), self._boxes
        )
