"""A sensor of your own: the pixel of each landmark in view, and its distance with a deviation of 5 cm."""

import numpy as np

from activeslam_gym import Scenario
from activeslam_gym.sensors.points import PointSensor


class RangeSensor(PointSensor):
    def __init__(self, scenario: Scenario, seed: np.random.SeedSequence) -> None:
        super().__init__(scenario, seed)
        self.noise = np.diag((*self.noise.diagonal(), 0.05**2))

    def predict(self, camera: np.ndarray, point: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        z, H_x, H_y = super().predict(camera, point)
        distance = np.linalg.norm(point - camera[:3])
        sight = (point - camera[:3]) / distance
        return np.append(z, distance), np.vstack((H_x, (*-sight, 0.0, 0.0, 0.0))), np.vstack((H_y, sight))


if __name__ == "__main__":
    import gymnasium as gym

    import baselines
    from activeslam_gym.evaluation import run_episode

    env = gym.make("ActiveSLAM-v0", sensor=RangeSensor, duration=5.0)
    run = run_episode(env, baselines.make("mi-mi", env), seed=0)
    print(f"log score {run.log_score[-1]:.0f} bits, position error {100 * run.position_error[-1]:.1f} cm")
