"""Views: of the plane Z = 0 of the target's frame, and of one thing from two places."""

import numpy as np

from activeslam_gym.camera import pixel_from_camera_point
from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.kernels import Record


def plane_points(camera: Record, pose: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """(len(y), len(x), 2) where the rays of the pixels (x, y) from ``pose`` (>= 7,) meet the plane [m]."""
    u_d, v_d = camera.u0 - x[None, :], camera.v0 - y[:, None]
    bend = 1.0 / (camera.focal * np.sqrt(1.0 - camera.distortion * (u_d**2 + v_d**2)))
    rays = np.stack((u_d * bend, v_d * bend, np.ones_like(bend)), axis=-1) @ rotation_matrix(pose[3:7]).T
    return pose[:2] - pose[2] * rays[..., :2] / rays[..., 2:]


def projected(camera: Record, pose: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(n, 2) pixels of the ``points`` (n, 3) [m] from ``pose`` (>= 7,).

    Raises:
        ValueError: one is behind the camera.
    """
    R_WC, out = rotation_matrix(pose[3:7]), np.empty((len(points), 2))
    for z, point in zip(out, points):
        if not pixel_from_camera_point(camera, R_WC.T @ (point - pose[:3]), z):
            raise ValueError("a corner of the target is behind the camera")
    return out


def supersampled(low: np.ndarray, high: np.ndarray, samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Columns and rows [px], ``samples`` to a pixel, of the pixels from ``low`` (2,) to before ``high`` (2,)."""
    steps = (np.arange(samples) + 0.5) / samples - 0.5
    x, y = (np.arange(low[axis], high[axis])[:, None] + steps for axis in (0, 1))
    return x.ravel(), y.ravel()


def bounding_box(pixels: np.ndarray, reach: float, shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """First pixel (2,), and the one after the last (2,), of what is ``reach`` pixels around ``pixels`` (n, 2)."""
    low = np.maximum(np.floor(pixels.min(axis=0) - reach).astype(int), 0)
    high = np.minimum(np.ceil(pixels.max(axis=0) + reach).astype(int) + 1, shape[::-1])
    return low, high


def turn_between(one: np.ndarray, other: np.ndarray) -> float:
    """The angle of the turn from quaternion ``one`` (4,) to the ``other`` (4,) [rad]."""
    return 2.0 * float(np.arccos(min(1.0, abs(one @ other))))


def change_of_view(first: np.ndarray, now: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(n,) how differently ``points`` (n, 3) are seen from ``first`` (n, 3) and from ``now`` (3,): the angle [rad]
    between the sight lines and the logarithm of the distances' quotient, as the two sides of a right angle."""
    a, b = points - first, points - now
    far, near = (np.maximum(np.linalg.norm(sight, axis=1), 1e-9) for sight in (a, b))
    angle = np.arccos(np.clip(np.sum(a * b, axis=1) / (far * near), -1.0, 1.0))
    return np.hypot(angle, np.log(near / far))
