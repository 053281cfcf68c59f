"""Draw a room: where the points are, and where the camera really starts."""

import numpy as np

from activeslam_gym.camera import camera_of, ray_from_pixel
from activeslam_gym.config import Scenario
from activeslam_gym.geometry import quaternion_exp, rotation_matrix
from activeslam_gym.motion import ANGULAR_VELOCITY, CAMERA_SIZE, POSITION, QUATERNION, VELOCITY

_FIDUCIAL_IMAGE_SHARE = 0.8
"""Fiducials project into the central part of the first image, of this relative width and height."""


def uniform_points(scenario: Scenario, count: int, rng: np.random.Generator) -> np.ndarray:
    """``count`` points (count, 3) [m] uniform in the scenario's room."""
    return (rng.random((count, 3)) - 0.5) * np.array(scenario.room_size)


def draw_start(scenario: Scenario, rng: np.random.Generator) -> np.ndarray:
    """The true first camera (13,), drawn from the scenario's prior about the room's centre, facing +Z."""
    camera = np.empty(CAMERA_SIZE)
    camera[POSITION] = np.array(scenario.position_std) * rng.standard_normal(3)
    camera[QUATERNION] = quaternion_exp(scenario.orientation_std * rng.standard_normal(3))
    camera[VELOCITY] = scenario.velocity_std * rng.standard_normal(3)
    camera[ANGULAR_VELOCITY] = scenario.angular_velocity_std * rng.standard_normal(3)
    return camera


def draw_room(scenario: Scenario, start: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """The fiducials (K, 3) and the landmarks (L, 3) of a room [m].

    Landmarks are uniform in the room; fiducials are uniform in the image of the first camera ``start`` (13,) and in
    depth.
    """
    landmarks = uniform_points(scenario, scenario.landmark_count, rng)
    camera = camera_of(scenario)
    size = np.array([camera.width, camera.height])
    share = 0.5 + _FIDUCIAL_IMAGE_SHARE * (rng.random((scenario.fiducial_count, 2)) - 0.5)
    depths = rng.uniform(*scenario.fiducial_distance, scenario.fiducial_count)
    R_WC = rotation_matrix(start[QUATERNION])
    half = 0.5 * np.array(scenario.room_size)
    fiducials = [
        np.clip(start[POSITION] + depth * (R_WC @ ray_from_pixel(camera, pixel)), -half, half)
        for pixel, depth in zip(share * size, depths, strict=True)
    ]
    return np.reshape(fiducials, (-1, 3)), landmarks
