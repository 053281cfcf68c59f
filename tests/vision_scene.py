"""A plane with a smooth texture and a target on it, seen through the lens: truth for the front end's tests."""

import math

import numpy as np

from activeslam_gym.geometry import quaternion_exp, quaternion_product, rotation_matrix
from activeslam_gym.vision.calibration import Calibration
from activeslam_gym.vision.target import Rectangle

LENS = Calibration(320, 240, 195.0, 162.0, 125.0, 1.8e-5)
FACING = np.array((0.0, 0.0, 1.0, 0.0))
"""q_WC of a camera that looks along -Z, upright."""
TARGET = Rectangle(0.21, 0.1485, np.zeros((4, 2)))


def pose_at(position: tuple[float, float, float], turn: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    """(7,) a camera at ``position`` [m] that faces the plane Z = 0, turned by the rotation vector ``turn`` [rad]."""
    return np.concatenate((position, quaternion_product(quaternion_exp(np.array(turn)), FACING)))


def plane_points(pose: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """(n, 2) where the rays of the pixels (x, y) (n,) meet the plane Z = 0 [m]: equation 1 backwards."""
    u_d, v_d = LENS.principal_x_px - x, LENS.principal_y_px - y
    scale = 1.0 / (LENS.focal_px * np.sqrt(1.0 - LENS.distortion * (u_d**2 + v_d**2)))
    rays = np.stack((u_d * scale, v_d * scale, np.ones_like(scale)), axis=-1) @ rotation_matrix(pose[3:]).T
    return pose[:2] - pose[2] * rays[..., :2] / rays[..., 2:]


def texture(X: np.ndarray) -> np.ndarray:
    """Grey values of the plane at X (..., 2) [m]: waves of many directions, the finest 25 mm long."""
    rng = np.random.default_rng(3)
    value = np.full(X.shape[:-1], 150.0)
    for _ in range(10):
        angle, length, phase = rng.uniform(0, math.pi), rng.uniform(0.025, 0.12), rng.uniform(0, 2 * math.pi)
        value += 15.0 * np.sin(2 * math.pi / length * (X @ np.array((math.cos(angle), math.sin(angle)))) + phase)
    return value


def grey_value(X: np.ndarray, target: bool) -> np.ndarray:
    """The plane, with the dark target on a white sheet where there is one."""
    value = texture(X)
    if target:
        a, b = np.abs(X[..., 0]), np.abs(X[..., 1])
        value = np.where((a < 0.165) & (b < 0.135), 220.0, value)
        value = np.where((a < 0.5 * TARGET.width) & (b < 0.5 * TARGET.height), 40.0, value)
    return value


def image_from(pose: np.ndarray, target: bool = False, samples: int = 4) -> np.ndarray:
    """The image (240, 320) uint8 from ``pose``, each pixel the mean of ``samples`` x ``samples`` rays."""
    steps = (np.arange(samples) + 0.5) / samples - 0.5
    total = np.zeros((LENS.image_height, LENS.image_width))
    for dy in steps:
        for dx in steps:
            y, x = np.mgrid[: LENS.image_height, : LENS.image_width].astype(float)
            total += grey_value(plane_points(pose, x + dx, y + dy), target)
    return np.clip(np.rint(total / samples**2), 0, 255).astype(np.uint8)
