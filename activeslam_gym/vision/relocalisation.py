"""The camera's pose from the looks of the map alone, after the map was lost.

Templates are searched in the whole image, as they looked when the map was seen last. Most of what is found are
outliers; a pose that explains many at once (Fischler and Bolles 1981) is the camera's. It becomes a vague prior
of the camera, independent of the map, and the ordinary search and update do the rest.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from activeslam_gym.camera import ray_from_pixel
from activeslam_gym.kernels import Record
from activeslam_gym.vision.opencv import opencv
from activeslam_gym.vision.views import pose_of

_TOLERANCE = 4.0  # a pixel that is farther from its prediction does not support a pose [px]
_TRIALS = 500  # poses that are tried
PRIOR = np.diag(np.repeat((0.15, 0.1, 0.5, 1.0), 3) ** 2)
"""(12, 12) covariance of position [m], rotation [rad], velocity [m/s] and angular velocity [rad/s]. Far more than a
pose of seven features errs by, since its error is the map's too, which the prior does not know."""


def locate(camera: Record, ids: np.ndarray, points: np.ndarray, pixels: np.ndarray, least: int) -> np.ndarray | None:
    """The pose (7,) from which the most of the ``points`` (n, 3) are at their ``pixels`` (n, 2), or None.

    A feature, by its number ``ids`` (n,), may be at several pixels; ``least`` different ones must agree.
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
    depths = (Rotation.from_rotvec(turn.ravel()).apply(points[chosen]) + shift.ravel())[:, 2]
    return pose_of(turn, shift) if (depths > 0.0).all() else None
