"""A sensor of your own: pixel and range of each landmark, measurements of three numbers."""

from typing import Any

import gymnasium as gym
import numpy as np

import baselines
import examples.extend_estimator  # noqa: F401  (registers "numpy-ekf", which takes measurements of any size)
from activeslam_gym import Scenario
from activeslam_gym.evaluation import run_episode
from activeslam_gym.sensors.points import PointModel
from activeslam_gym.sensors.sensor import SENSORS, Detections
from activeslam_gym.slam.estimate import Estimate
from activeslam_gym.world.truth import Truth


@SENSORS.register("range-and-bearing")
class RangeSensor:
    """The pixel of each landmark in view, and its distance with a deviation of 5 cm."""

    def __init__(self, scenario: Scenario, seed: np.random.SeedSequence) -> None:
        self._seed, self._model = seed, RangeModel(scenario)

    def measure(self, truth: Truth, time: float) -> Detections:
        """Noise is a function of the seed and the time alone."""
        rng = np.random.default_rng((*self._seed.generate_state(2), round(1e3 * time)))
        points = np.concatenate((truth.fiducials, truth.landmarks))
        camera = np.concatenate((truth.position, truth.quaternion, truth.velocity, truth.angular_velocity))
        noise = rng.standard_normal((len(points), 3)) @ np.sqrt(self._model.noise)
        labels = np.flatnonzero(self._model.in_view(camera, points))
        values = [self._model.predict(camera, points[k])[0] + noise[k] for k in labels]
        return Detections(np.array(values).reshape(-1, 3), labels)

    def model(self) -> "RangeModel":
        return self._model


class RangeModel:
    """The model: that of the points, with a third number."""

    def __init__(self, scenario: Scenario) -> None:
        self._points = PointModel(scenario, np.zeros((0, 2, 3)))
        self.noise = np.diag((scenario.pixel_std**2, scenario.pixel_std**2, 0.05**2))

    def predict(self, camera: np.ndarray, point: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        z, H_x, H_y = self._points.predict(camera, point)
        distance = float(np.linalg.norm(point - camera[:3]))
        sight = (point - camera[:3]) / distance
        along = np.concatenate((-sight, np.zeros(3)))
        return np.append(z, distance), np.vstack((H_x, along)), np.vstack((H_y, sight))

    def inverse_depth(self, value: np.ndarray) -> tuple[float, float]:
        """Mean and deviation of 1 / range [1/m], for an estimator that initialises landmarks."""
        return 1.0 / value[2], np.sqrt(self.noise[2, 2]) / value[2] ** 2

    def in_view(self, camera: np.ndarray, points: np.ndarray) -> np.ndarray:
        return self._points.in_view(camera, points)

    def visible(self, estimate: Estimate, camera: np.ndarray, points: np.ndarray) -> np.ndarray:
        return self.in_view(camera, points)


if __name__ == "__main__":
    scenario = {"sensor": "range-and-bearing", "estimator": "numpy-ekf", "association": "known"}
    env: Any = gym.make("ActiveSLAM-v0", scenario=scenario, duration=5.0)
    run = run_episode(env, baselines.make("mi-mi", env), seed=0)
    print(f"log score {run.log_score[-1]:.0f} bits, position error {100 * run.position_error[-1]:.1f} cm")
