"""Restart where the target contradicts the belief, and shows another pose by itself.

A target is small. Before the camera has moved, its two mirrored poses (see `first_sight.start_pose`) are nearly alike,
and so are a map and the same map inside out. The filter follows one of the two, now and then the wrong one, and new
features, whose depths are unknown, confirm it. The target's corners do not: they lie beside where the belief expects
them, image after image, and one pose explains them all (`slam.restart` is the same for points).
"""

import numpy as np

from activeslam_gym.camera import camera_point, pixel_from_camera_point
from activeslam_gym.geometry import rotation_error, rotation_matrix
from activeslam_gym.kernels import Record, compiled
from activeslam_gym.motion import QUATERNION
from activeslam_gym.slam.sight import POSE_DIM
from activeslam_gym.vision.first_sight import start_pose
from activeslam_gym.vision.relocalisation import PRIOR

_LEAST = 4  # fiducials that tell of a pose
_KEPT = 0.9  # of the running mean, by an image
_CONTRADICTED = 0.5
"""Running mean of the NIS of matched corners, per degree of freedom, over which they contradict the belief. R is wide
enough for a lens that is known badly: while the belief is right, 0.05 to 0.2."""
_MOST = 2.0  # that one image counts in it: one alone contradicts nothing
_EXPLAINED = 0.2  # share of this image's that the corners' own pose leaves
_DISTINCT = 22.5  # squared Mahalanobis distance of that pose from the belief's: 99.9 % of chi-square with 6 dof


class Restart:
    """Watches the ``fiducials`` (K, 3) of a target, in a ``camera`` whose corners have the deviation ``corner_std``
    [px]."""

    def __init__(self, camera: Record, fiducials: np.ndarray, corner_std: float) -> None:
        self._camera, self._fiducials, self._std = camera, fiducials, corner_std
        self._nis = 0.0

    def camera_instead(
        self, found: np.ndarray, mean: np.ndarray, covariance: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """The camera (13,) and its covariance (12, 12) by the corners of an image alone, where those of this and of the
        last images contradict the belief of the camera, ``mean`` (13,) and ``covariance`` (12, 12); else None.

        ``found``: (M,) DETECTION of the image, with the filter's answer.
        """
        own = found[(found["match"] < 0) & (found["match"] >= -len(self._fiducials))]
        points, pixels, R = self._fiducials[-1 - own["match"]], own["pixel"], own["R"]
        if len(own) < _LEAST:
            return None
        nis = _mean_nis(self._camera, mean, points, pixels, R)
        self._nis = _KEPT * self._nis + (1.0 - _KEPT) * min(nis, _MOST)
        if self._nis < _CONTRADICTED:
            return None
        try:
            pose, spread = start_pose(self._camera, points, pixels, self._std)
        except ValueError:
            return None
        camera, around = np.concatenate((pose, np.zeros(6))), PRIOR.copy()
        around[:POSE_DIM, :POSE_DIM] = spread
        left = _mean_nis(self._camera, pose, points, pixels, R)
        apart = np.concatenate((pose[:3] - mean[:3], rotation_error(pose[3:], mean[QUATERNION])))
        distance = apart @ np.linalg.solve(spread + covariance[:POSE_DIM, :POSE_DIM], apart)
        if left > _EXPLAINED * nis or distance < _DISTINCT:
            return None
        self._nis = 0.0
        return camera, around


@compiled
def _mean_nis(camera: Record, pose: np.ndarray, points: np.ndarray, pixels: np.ndarray, R: np.ndarray) -> float:
    """Mean over n points of r^T R^-1 r / 2, r the ``pixels`` (n, 2) less those of the ``points`` (n, 3) from ``pose``
    (>= 7,); ``R`` (n, 2, 2). Infinite where one is behind the camera."""
    R_WC, z, total = rotation_matrix(pose[QUATERNION]), np.empty(2), 0.0
    for k in range(points.shape[0]):
        if not pixel_from_camera_point(camera, camera_point(R_WC, pose, points[k]), z):
            return np.inf
        u, v, cov = pixels[k, 0] - z[0], pixels[k, 1] - z[1], R[k]
        square = cov[1, 1] * u * u - 2.0 * cov[0, 1] * u * v + cov[0, 0] * v * v
        total += 0.5 * square / (cov[0, 0] * cov[1, 1] - cov[0, 1] * cov[0, 1])
    return total / points.shape[0]
