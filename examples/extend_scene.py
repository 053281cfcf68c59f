"""A scene of your own: a sphere in the room, which hides landmarks and stops the camera."""

from typing import Any

import gymnasium as gym
import numpy as np

from activeslam_gym import Gaze, Motion, Scenario
from activeslam_gym.world.scenes import SCENES


@SCENES.register("sphere")
class SphereScene:
    """A sphere of radius 0.5 m ahead of the start. Landmarks are on its surface and on the upright walls."""

    def __init__(self, scenario: Scenario, rng: np.random.Generator) -> None:
        half = 0.5 * np.array(scenario.room_size)
        self.bounds = np.stack((-half, half))
        self.centre, self.radius = np.array((rng.uniform(-0.2, 0.2), 0.0, 1.8)), 0.5

    def blocks(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        length = np.linalg.norm(b - a, axis=1)
        near, far = self._crossings(a[None], (b - a) / length[:, None])
        return (near < length - 1e-6) & (far > 1e-6) & (far - near > 1e-6)

    def clearance(self, p: np.ndarray, directions: np.ndarray, farthest: float) -> np.ndarray:
        near, far = self._crossings(p, directions)
        return np.where(far < 1e-9, farthest, np.clip(near, 0.0, farthest))

    def sample(self, n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        normals = rng.standard_normal((n, 3))
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        points = self.centre + self.radius * normals
        for k in range(n // 3, n):  # on a wall
            axis, side = rng.choice((0, 2)), rng.choice((0, 1))
            points[k], normals[k] = rng.uniform(*self.bounds), 0.0
            points[k, axis], normals[k, axis] = self.bounds[side, axis], 1.0 - 2.0 * side
        return points, normals

    def _crossings(self, p: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where the lines p + t direction enter and leave the sphere; (inf, -inf) where they pass it by."""
        along = np.sum(directions * (self.centre - p), axis=1)
        square = self.radius**2 + along**2 - np.sum((self.centre - p) ** 2, axis=1)
        root = np.sqrt(np.maximum(square, 0.0))
        return np.where(square > 0.0, along - root, np.inf), np.where(square > 0.0, along + root, -np.inf)


def main(steps: int = 28) -> Any:
    """Fly at the sphere; the environment."""
    env: Any = gym.make("ActiveSLAM-v0", scenario={"scene": "sphere"})
    env.reset(seed=0)
    for _ in range(steps):
        *_, info = env.step((Motion.FORWARD, Gaze.STAY))
    truth = env.unwrapped.truth
    gap = truth.scene.clearance(truth.position[None], np.array([(0.0, 0.0, 1.0)]), 3.0)[0]
    hidden = truth.scene.blocks(truth.position, truth.landmarks).sum()
    print(f"after {steps / 4:.0f} s the sphere is {gap:.2f} m ahead and hides {hidden} landmarks")
    print(f"log score {info['log_score']:.0f} bits, position error {100 * info['position_error']:.1f} cm")
    return env


if __name__ == "__main__":
    main()
