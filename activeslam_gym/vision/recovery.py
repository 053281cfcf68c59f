"""A new pose of the camera: by the looks of the map, after it was lost, or by a target that contradicts the belief.

**Relocalisation.** Templates are searched at the corners of the image, as they looked when the map was seen last. Most
of what is found are outliers; a pose that explains many at once (Fischler and Bolles 1981) is the camera's. It becomes
a vague prior of the camera, independent of the map, and the ordinary search and update do the rest.

**Restart.** A target is small. Before the camera has moved, its two mirrored poses (see `first_sight.start_pose`) are
nearly alike, and so are a map and the same map inside out. The filter follows one of the two, now and then the wrong
one, and new features, whose depths are unknown, confirm it. The target's corners do not: they lie beside where the
belief expects them, image after image, and one pose explains them all (`slam.restart` is the same for points).
"""

from contextlib import suppress

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.spatial.transform import Rotation

from activeslam_gym.camera import View
from activeslam_gym.geometry import rotation_error
from activeslam_gym.kernels import Record, compiled
from activeslam_gym.motion import QUATERNION
from activeslam_gym.slam.sight import POSE_DIM
from activeslam_gym.vision.first_sight import rays_of, start_pose
from activeslam_gym.vision.opencv import opencv
from activeslam_gym.vision.templates import TEMPLATE_HALF, TEMPLATE_SIDE, Templates, predict_appearance
from activeslam_gym.vision.views import pixels_of, pose_of

_TOLERANCE = 4.0  # a pixel that is farther from its prediction does not support a pose [px]
_TRIALS = 200  # poses that are tried
_CORNERS, _EDGE = 400, TEMPLATE_HALF + 4  # corners at which templates are tried, so far inside the image [px]
_PLACES, _LEAST_SCORE = 2, 0.5  # corners that a template is searched around, and its correlation there
PRIOR = np.diag(np.repeat((0.15, 0.1, 0.5, 1.0), 3) ** 2)
"""(12, 12) covariance of position [m], rotation [rad], velocity [m/s] and angular velocity [rad/s]. Far more than a
pose of seven features errs by, since its error is the map's too, which the prior does not know."""


@compiled
def drawn_templates(view: View, templates: Templates, places: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(v, 15, 15) float32 the templates at ``places`` (v,) as ``points`` (v, 3) look in ``view``; NaN: not at all."""
    out = np.full((places.shape[0], TEMPLATE_SIDE, TEMPLATE_SIDE), np.float32(np.nan))
    for a in range(places.shape[0]):
        if not predict_appearance(view, templates, places[a], points[a], out[a]):
            out[a] = np.float32(np.nan)
    return out


def likeliest_corners(image: np.ndarray, templates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(m,) which of ``templates`` (v, 15, 15) look like a corner of the ``image`` (h, w) uint8, and (m, 2) where."""
    corners = opencv().goodFeaturesToTrack(image[_EDGE:-_EDGE, _EDGE:-_EDGE], _CORNERS, 1e-3, 3.0)
    if corners is None:
        return np.zeros(0, np.int64), np.zeros((0, 2))
    x, y = corners.reshape(-1, 2).astype(int).T + _EDGE - TEMPLATE_HALF
    patches = sliding_window_view(image, (TEMPLATE_SIDE,) * 2)[y, x]
    score = _normalised(templates) @ _normalised(patches).T
    best = np.argsort(-score, axis=1)[:, :_PLACES]
    row, k = np.nonzero(np.take_along_axis(score, best, axis=1) > _LEAST_SCORE)
    return row, np.stack((x, y), axis=1)[best[row, k]] + float(TEMPLATE_HALF)


def _normalised(patches: np.ndarray) -> np.ndarray:
    """(n, 225) of ``patches`` (n, 15, 15) with mean 0 and length 1; NaN becomes 0."""
    values = patches.reshape(len(patches), -1).astype(np.float32)
    values = np.ma.masked_invalid(values)
    values = (values - values.mean(axis=1, keepdims=True)).filled(0.0)
    return values / np.maximum(np.linalg.norm(values, axis=1, keepdims=True), 1.0)


def locate(camera: Record, ids: np.ndarray, points: np.ndarray, pixels: np.ndarray, least: int) -> np.ndarray | None:
    """The pose (7,) from which the most of the ``points`` (n, 3) are at their ``pixels`` (n, 2), or None.

    A feature, by its number ``ids`` (n,), may be at several pixels; ``least`` different ones must agree.
    """
    if len(np.unique(ids)) < least:
        return None
    cv2 = opencv()
    rays = rays_of(camera, pixels)
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


LEAST = 4  # fiducials that tell of a pose
_KEPT = 0.9  # of the running mean, by an image
_CONTRADICTED = 0.5
"""Running mean of the NIS of matched corners, per degree of freedom, over which they contradict the belief. R is wide
enough for a lens that is known badly: while the belief is right, 0.05 to 0.2."""
_MOST = 2.0  # that one image counts in it: one alone contradicts nothing
_EXPLAINED = 0.2  # share of this image's that the corners' own pose leaves
_LEFT = 0.2  # NIS that this pose leaves of corners that were sought outside their gates: as while the belief is right
_DISTINCT = 22.5  # squared Mahalanobis distance of that pose from the belief's: 99.9 % of chi-square with 6 dof


class Restart:
    """Watches the ``fiducials`` (K, 3) of a target in a ``camera``; ``corner_std``: of their pixels [px].

    `is_contradicted`: they contradicted the belief once, be it that it was replaced or not.
    """

    def __init__(self, camera: Record, fiducials: np.ndarray, corner_std: float) -> None:
        self._camera, self._fiducials, self._std = camera, fiducials, corner_std
        self._nis, self._elsewhere, self.is_contradicted = 0.0, 0.0, False

    def look_elsewhere(self, found: np.ndarray, mean: np.ndarray, weight: float) -> None:
        """Take the corners ``found`` outside their gates, of a target that is missed where the ``mean`` (13,) has it.

        It is contradicted, if one pose explains them in most of the last images, each of which has this ``weight``.
        """
        points, pixels, R = self._fiducials[-1 - found["id"]], found["pixel"], found["R"]
        is_elsewhere = False
        if len(found) >= LEAST and (nis := _mean_nis(self._camera, mean, points, pixels, R)) > _CONTRADICTED:
            with suppress(ValueError):
                pose, _ = start_pose(self._camera, points, pixels, self._std)
                left = _mean_nis(self._camera, pose, points, pixels, R)
                is_elsewhere = left < min(_LEFT, _EXPLAINED * nis)
        self._elsewhere += weight * (is_elsewhere - self._elsewhere)
        self.is_contradicted |= self._elsewhere > 0.5

    def camera_instead(
        self, found: np.ndarray, mean: np.ndarray, covariance: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """The camera (13,) and its covariance (12, 12) by the corners of an image alone, where those of this and of the
        last images contradict the belief of the camera, ``mean`` (13,) and ``covariance`` (12, 12); else None.

        ``found``: (M,) DETECTION of the image, with the filter's answer.
        """
        own = found[(found["match"] < 0) & (found["match"] >= -len(self._fiducials))]
        points, pixels, R = self._fiducials[-1 - own["match"]], own["pixel"], own["R"]
        if len(own) < LEAST:
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
        if left > _EXPLAINED * nis:
            return None
        self.is_contradicted = True
        if distance < _DISTINCT:
            return None
        self._nis = 0.0
        return camera, around


def _mean_nis(camera: Record, pose: np.ndarray, points: np.ndarray, pixels: np.ndarray, R: np.ndarray) -> float:
    """Mean over n points of r^T R^-1 r / 2, r the ``pixels`` (n, 2) less those of the ``points`` (n, 3) from ``pose``
    (>= 7,); ``R`` (n, 2, 2). Infinite where one is behind the camera."""
    r = (pixels - pixels_of(camera, pose, points))[..., None]
    square = 0.5 * float((r * np.linalg.solve(R, r)).sum()) / len(points)
    return square if square == square else np.inf
