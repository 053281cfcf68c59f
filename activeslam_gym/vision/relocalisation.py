"""Lost, and found again: where the camera is, from the looks of the map alone.

Templates are searched in the whole image, as they look from a view that is remembered. What is found is mostly
strangers; a pose that explains many at once (Fischler and Bolles 1981) is where the camera is. It becomes a vague prior
of the camera, independent of the map, and the ordinary search and update do the rest.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from activeslam_gym.camera import ray_from_pixel
from activeslam_gym.kernels import Record
from activeslam_gym.slam.filter import Filter
from activeslam_gym.vision.opencv import opencv
from activeslam_gym.vision.views import turn_between

_TOLERANCE = 4.0
"""A pixel that is farther from where a pose has it does not support that pose [px]."""
_TRIALS = 500
"""Poses that are tried."""
_STDS = np.repeat((0.15, 0.1, 0.5, 1.0), 3)
"""Of the prior: position [m], rotation [rad], velocity [m/s], angular velocity [rad/s]. Far more than a pose of seven
features errs by, since its error is the map's too, which the prior does not know."""


class Views(NamedTuple):
    """Poses (7,) from which the map was seen well."""

    poses: list[np.ndarray]

    def remember(self, pose: np.ndarray, apart: float = 0.25, turned: float = 0.35, most: int = 24) -> None:
        """Keep the ``pose`` (7,) as the newest. The last newest goes if it was near the one before (``apart`` [m],
        ``turned`` [rad]), and of more than ``most`` the oldest."""
        kept = self.poses
        if len(kept) > 1 and _near(kept[-1], kept[-2], apart, turned):
            kept.pop()
        kept.append(pose.copy())
        del kept[:-most]

    def nth(self, attempt: int) -> np.ndarray:
        """The view to try at the ``attempt``, from 0: the newest first, and round again."""
        return self.poses[-1 - attempt % len(self.poses)]


def _near(a: np.ndarray, b: np.ndarray, apart: float, turned: float) -> bool:
    return bool(np.linalg.norm(a[:3] - b[:3]) < apart and turn_between(a[3:], b[3:]) < turned)


def whole_image(camera: Record, count: int, gate: float) -> tuple[np.ndarray, np.ndarray]:
    """Predicted pixels (count, 2) and covariances (count, 2, 2) whose ellipses hold all of the image."""
    half = 0.5 * np.array((camera.width, camera.height))
    return np.tile(half, (count, 1)), np.tile(np.diag(2.0 * half**2 / gate), (count, 1, 1))


def locate(camera: Record, ids: np.ndarray, points: np.ndarray, pixels: np.ndarray, least: int) -> np.ndarray | None:
    """The pose (7,) from which the most of the ``points`` (n, 3) are at their ``pixels`` (n, 2), or None.

    A thing, by its number ``ids`` (n,), may be at several pixels; ``least`` different ones must agree.
    """
    if len(np.unique(ids)) < least:
        return None
    cv2 = opencv()
    rays = np.array([ray_from_pixel(camera, pixel)[:2] for pixel in pixels])
    pinhole, straight, points = np.eye(3), np.zeros(4), np.ascontiguousarray(points)
    there, turn, shift, inliers = cv2.solvePnPRansac(
        points, rays, pinhole, straight, iterationsCount=_TRIALS, reprojectionError=_TOLERANCE / float(camera.focal),
        confidence=0.9999, flags=cv2.SOLVEPNP_AP3P,
    )  # fmt: skip
    if not there or inliers is None or len(np.unique(ids[inliers.ravel()])) < least:
        return None
    chosen = inliers.ravel()
    turn, shift = cv2.solvePnPRefineLM(points[chosen], rays[chosen], pinhole, straight, turn, shift)
    R_CW = Rotation.from_rotvec(turn.ravel())
    if np.any((R_CW.apply(points[chosen]) + shift.ravel())[:, 2] <= 0.0):
        return None
    x, y, z, w = R_CW.inv().as_quat()
    return np.array((*-R_CW.inv().apply(shift.ravel()), w, x, y, z))


def replace_camera(filter: Filter, pose: np.ndarray) -> None:
    """The camera stands, nearly at rest, somewhere around the ``pose`` (7,); the map stays what it is."""
    filter.place_camera(np.concatenate((pose, np.zeros(6))), np.diag(_STDS**2))
