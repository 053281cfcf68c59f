"""A pixel of each point in view, with white noise: the sensor `points` as an object, to derive others from."""

import numpy as np

from activeslam_gym.camera import View, camera_of, visible
from activeslam_gym.config import Scenario
from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.motion import POSITION, QUATERNION
from activeslam_gym.sensors.sensor import POINTS, Detections
from activeslam_gym.slam.sight import POSE_DIM, point_measurement
from activeslam_gym.world.truth import Truth


class PointSensor:
    """A `Sensor`: the pixels of fiducials and landmarks.

    A subclass may predict more numbers, with a larger ``noise``; they are measured as they are predicted. A point on a
    surface is seen from all sides, unlike by `points`.

    Raises:
        ValueError: the scenario has clutter or another true lens, which the sensor `points` alone simulates.
    """

    def __init__(self, scenario: Scenario, seed: np.random.SeedSequence) -> None:
        self.lens, self.noise = camera_of(scenario), scenario.pixel_std**2 * np.eye(2)
        self.boxes = np.zeros((0, 2, 3))
        """(B, 2, 3) those that are known to hide landmarks [m]."""
        self._key, self._scenario = seed.generate_state(2), scenario
        if scenario.sensor != POINTS:  # whose detections are simulated, where an estimator is foreign
            for name, absent in (("clutter_rate", 0.0), ("true_focal_px", None), ("true_distortion", None)):
                if (given := getattr(scenario, name)) != absent:
                    raise ValueError(f"scenario.{name} must be {absent}, got {given}: a sensor of one's own has none")

    def measure(self, truth: Truth, time: float) -> Detections:
        """Measure what is visible, and hidden by nothing; the draws of a point are its own."""
        camera, points = truth.camera, np.vstack((truth.fiducials, truth.landmarks))
        rng = np.random.default_rng((*self._key, round(1e6 * time)))
        noise = rng.standard_normal((len(points), len(self.noise))) @ np.linalg.cholesky(self.noise).T
        shown = self.visible(camera, points) & ~truth.scene.blocks(truth.position, points)
        labels = np.flatnonzero(shown & (rng.random(len(points)) >= self._scenario.missed_detection_probability))
        values = [self.predict(camera, points[k])[0] + noise[k] for k in labels]
        return Detections(np.reshape(values, (-1, len(self.noise))), labels)

    def predict(self, camera: np.ndarray, point: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The pixel (2,) of a world ``point`` (3,) from ``camera`` (13,), and its Jacobians (2, 6) and (2, 3).

        NaN where the point is not in front of the camera.
        """
        z, H_x, H_y = np.full(2, np.nan), np.zeros((2, POSE_DIM)), np.zeros((2, 3))
        if not point_measurement(self._view(camera), np.asarray(point, float), z, H_x, H_y):
            z[:] = np.nan
        return z, H_x, H_y

    def visible(self, camera: np.ndarray, points: np.ndarray) -> np.ndarray:
        """(m,) bool: which of the ``points`` (m, 3) are inside the image of ``camera`` (13,), and not hidden."""
        view, z = self._view(camera), np.empty(2)
        return np.array([visible(view, point, 0.0, z) for point in points], bool)

    def _view(self, camera: np.ndarray) -> View:
        return View(
            self.lens, camera[POSITION.start : QUATERNION.stop], rotation_matrix(camera[QUATERNION]), self.boxes
        )
