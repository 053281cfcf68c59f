"""A scene of your own: a sphere ahead of the start. Landmarks are on its surface and on the upright walls."""

import numpy as np

from activeslam_gym import Scenario


class SphereScene:
    def __init__(self, scenario: Scenario, rng: np.random.Generator) -> None:
        self.bounds, self.radius = np.outer((-0.5, 0.5), scenario.room_size), 0.5
        self.centre = np.array((rng.uniform(-0.2, 0.2), 0.0, 1.8))

    def blocks(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        length = np.linalg.norm(b - a, axis=1)
        near, far = self.crossings(a[None], (b - a) / length[:, None])
        return (near < length - 1e-6) & (far > 1e-6) & (far - near > 1e-6)

    def clearance(self, p: np.ndarray, directions: np.ndarray, farthest: float) -> np.ndarray:
        near, far = self.crossings(p, directions)
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

    def crossings(self, p: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        along = np.sum(directions * (self.centre - p), axis=1)
        root = np.sqrt(np.maximum(self.radius**2 + along**2 - np.sum((self.centre - p) ** 2, axis=1), 0.0))
        return np.where(root > 0.0, along - root, np.inf), np.where(root > 0.0, along + root, -np.inf)
