"""The camera's pose from the looks of the map alone, after the map was lost.

Templates are searched at the corners of the image, as they looked when the map was seen last. Most of what is found are
outliers; a pose that explains many at once (Fischler and Bolles 1981) is the camera's. It becomes a vague prior
of the camera, independent of the map, and the ordinary search and update do the rest.
"""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.spatial.transform import Rotation

from activeslam_gym.camera import View, ray_from_pixel
from activeslam_gym.kernels import Record, compiled
from activeslam_gym.vision.opencv import opencv
from activeslam_gym.vision.templates import TEMPLATE_HALF, TEMPLATE_SIDE, Templates, predict_appearance
from activeslam_gym.vision.views import pose_of

_TOLERANCE = 4.0  # a pixel that is farther from its prediction does not support a pose [px]
_TRIALS = 200  # poses that are tried
_CORNERS, _EDGE = 400, TEMPLATE_HALF + 4  # corners at which templates are tried, so far inside the image [px]
_PLACES, _LEAST_SCORE = 2, 0.5  # corners that a template is searched around, and its correlation there
PRIOR = np.diag(np.repeat((0.15, 0.1, 0.5, 1.0), 3) ** 2)
"""(12, 12) covariance of position [m], rotation [rad], velocity [m/s] and angular velocity [rad/s]. Far more than a
pose of seven features errs by, since its error is the map's too, which the prior does not know."""


@compiled
def drawn_templates(view: View, templates: Templates, places: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(v, 15, 15) float32 the templates at ``places`` (v,) as the ``points`` (v, 3) look in ``view``, NaN where they
    cannot be drawn."""
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
