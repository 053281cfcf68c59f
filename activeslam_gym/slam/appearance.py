"""Features that are found by their looks, in images: association of identified detections, and their errors.

A searcher looks for each prediction around its predicted pixel, and finds likenesses.

A detection bears the id of the one prediction that it may be, and a log likelihood ratio of its looks. What is left to
ask is which detections belong together. Its worth is the log likelihood ratio against an unmapped detection of the same
looks, of which there is one in every A pixels that are searched,

    log_ratio + ln N(z; z_hat, S_c) - ln(1 / A) = log_ratio + ln(A / (2 pi sqrt|S_c|)) - d^2 / 2,

with S_c the innovation covariance of the prediction given what has been accepted so far. The density of unmapped
detections is by the pixel: one in every ellipse, whatever its size, would be too kind to large ellipses.

1. Every detection votes as if it were the only one known: its own worth and, given it, each other prediction's best.
   One point determines most of the camera's motion (Civera, Grasa, Davison and Montiel, "1-point RANSAC for EKF
   filtering", 2010; here nothing is left to chance, since all are tried). The first vote is accepted.
2. Then the worthiest detection given all that are accepted, until none inside the gate is worth more than nothing.
"""

import math

import numpy as np

from activeslam_gym.config import Scenario
from activeslam_gym.kernels import Record, borrowing, compiled, constants
from activeslam_gym.motion import CAMERA_DIM, POSITION, VELOCITY
from activeslam_gym.slam.belief import AZIMUTH, ELEVATION, FEATURE_SIZE, POINT, Belief, point_of
from activeslam_gym.slam.detection import (
    REJECTED,
    WAITS,
    chi_square_2_quantile,
    condition,
    conditioned,
    distance_and_det,
    predicted_pixels,
    write_gain,
)
from activeslam_gym.slam.kalman import update_by
from activeslam_gym.slam.map import count_misses, promote
from activeslam_gym.slam.sight import IMAGE_PRODUCT_FRAMES, Sight

_NEAREST = 0.1  # nearer than that, a view changes no faster [m]
_LEAST_LEVEL = 0.2
"""Straight above or below, an azimuth says nothing: the cosine of the elevation counts as at least so much."""

APPEARANCE, appearance_of = constants(
    Scenario(),
    search_gate=11.8,  # chi-square bound of the first detection: an ellipse of 3.4 sigma, as probable as 3 on a line
    gate=lambda s: chi_square_2_quantile(s.gate_probability),  # and of each further one, given those accepted
    chance_area=500.0,  # searched area for one detection by chance, which looks enough like the prediction [px^2]
)
"""Constants of the association of identified detections."""


@compiled
def use_identified(
    models: Record,
    belief: Belief,
    fiducials: np.ndarray,
    sight: Sight,
    detections: np.ndarray,
    least: int,
    counts: Record,
) -> None:
    """Associate detections (M,) that bear ids, update, and convert features to points.

    No misses are counted and nothing is deleted: the searcher knows which predictions it searched, and may come again
    in the same frame.
    """
    matches, model = associate_identified(models.filter.appearance, sight, detections, least), models.filter
    for one in detections:
        counts.rejected_matches += one.match == REJECTED
    count_misses(model.initialisation, belief, fiducials.shape[0], sight, matches)
    frames = IMAGE_PRODUCT_FRAMES if models.lens.command_known else 1.0
    update_by(models.lens, belief, fiducials, sight, matches, detections, frames)
    counts.conversions += promote(model.initialisation, belief)


@compiled
def associate_identified(model: Record, sight: Sight, detections: np.ndarray, least: int) -> np.ndarray:
    """Match ``detections`` (M,) that bear ids to the predictions in ``sight`` (v,); none, if fewer than ``least``
    agree.

    Returns (v,) the detection of each prediction, or WAITS, and sets ``detections.match``: the id, or REJECTED.
    """
    v, M = sight.point.shape[0], detections.shape[0]
    z, S = predicted_pixels(sight)
    of_detection, matches, count = np.full(M, -1), np.full(v, WAITS), 0
    for a in range(v):
        for i in range(M):
            if detections[i].id == sight.point[a].id:
                of_detection[i] = a
    best = _best(model, z, S, detections, of_detection, matches, True)
    while best >= 0:
        a = of_detection[best]
        matches[a], count = best, count + 1
        condition(z, S, a, detections[best], matches)
        best = _best(model, z, S, detections, of_detection, matches, False)
    if count < least:
        matches[:] = WAITS
    for i in range(M):
        a = of_detection[i]
        detections[i].match = detections[i].id if a >= 0 and matches[a] == i else REJECTED
    return matches


@compiled
def _best(
    model: Record,
    z: np.ndarray,
    S: np.ndarray,
    detections: np.ndarray,
    of_detection: np.ndarray,
    matches: np.ndarray,
    votes: bool,
) -> int:
    """The worthiest detection of the predictions without one, or -1 where none inside the gate is worth more than
    nothing.

    ``votes``: the worth that each other prediction's best then has counts too, and what was searched is the gate.
    """
    best, most = -1, 0.0
    for i in range(detections.shape[0]):
        a = of_detection[i]
        if a < 0 or matches[a] >= 0:
            continue
        d2, det = distance_and_det(z, S, a, detections[i])
        if d2 < (model.search_gate if votes else model.gate):
            worth = _worth(model, detections[i], d2, det)
            if votes:
                worth += _agreement(model, z, S, detections, of_detection, i)
            if worth > most:
                best, most = i, worth
    return best


@compiled
def _agreement(
    model: Record, z: np.ndarray, S: np.ndarray, detections: np.ndarray, of_detection: np.ndarray, seed: int
) -> float:
    """Sum over the other predictions of the worth of their best detection, given that the ``seed`` is of its own."""
    a, best, gain = of_detection[seed], np.zeros(z.shape[0] // 2), np.empty((2, z.shape[0]))
    write_gain(S, a, detections[seed], gain[0], gain[1])
    for i in range(detections.shape[0]):
        b = of_detection[i]
        if b >= 0 and b != a:
            d2, det = conditioned(z, S, a, detections[seed], gain, b, detections[i])
            best[b] = max(best[b], _worth(model, detections[i], d2, det))
    return best.sum()


@borrowing
def _worth(model: Record, detection: Record, d2: float, det: float) -> float:
    """The log likelihood ratio against an unmapped detection; see the module."""
    return detection.log_ratio + math.log(model.chance_area / (2.0 * math.pi)) - 0.5 * (math.log(det) + d2)


# The errors of what is found by its looks -----------------------------------------------------------------------------


@compiled
def wander(belief: Belief, drift: float, dt: float) -> None:
    """Each feature's direction, as the camera sees it, walks at random while the camera's view of it changes.

    Its variance grows by ``drift``^2 [rad^2] for each radian, which is the way of ``dt`` seconds over the distance:
    what a patch shows from another side, or from nearer, is not quite the same point. A POINT walks in depth too.
    """
    x, P, T = belief.state.camera, belief.covariance, np.empty((3, FEATURE_SIZE))
    speed = math.sqrt(x[VELOCITY.start] ** 2 + x[VELOCITY.start + 1] ** 2 + x[VELOCITY.start + 2] ** 2)
    for k in range(belief.state.count):
        feature, point, square, depth_square = belief.feature[k], point_of(belief, k, T), 0.0, 0.0
        for i in range(3):
            square += (point[i] - x[POSITION.start + i]) ** 2
            depth_square += (point[i] - feature.mean[i]) ** 2
        if not square < np.inf:
            continue
        var = drift * drift * min(speed * dt / max(math.sqrt(square), _NEAREST), 1.0)
        if feature.kind == POINT:
            for row in range(feature.start, feature.start + 3):
                P[row, row] += var * square
        else:  # as its angles at the anchor
            var *= square / max(depth_square, _NEAREST * _NEAREST)
            level = max(math.cos(feature.mean[ELEVATION]), _LEAST_LEVEL)
            P[feature.start + AZIMUTH, feature.start + AZIMUTH] += var / (level * level)
            P[feature.start + ELEVATION, feature.start + ELEVATION] += var


@compiled
def draw_bias(belief: Belief, K: int, k: int, var: float) -> None:
    """The pixel of fiducial ``k`` of ``K`` is off by a new bias, of variance ``var`` [px^2] an axis, as long as its
    template is the same: z = h + b + noise, b independent of all that is known.
    """
    state, P, dim = belief.state, belief.covariance, belief.state.dim
    if state.bias_dim == 0:
        rows = 2 * K
        rest, at = P[CAMERA_DIM:dim, :dim].copy(), CAMERA_DIM + rows
        P[at : dim + rows, :CAMERA_DIM] = rest[:, :CAMERA_DIM]
        P[:CAMERA_DIM, at : dim + rows] = rest[:, :CAMERA_DIM].T
        P[at : dim + rows, at : dim + rows] = rest[:, CAMERA_DIM:]
        P[CAMERA_DIM:at, : dim + rows] = 0.0
        P[: dim + rows, CAMERA_DIM:at] = 0.0
        state.bias[:] = 0.0
        state.bias_dim, state.dim = rows, dim + rows
        for j in range(state.count):
            belief.feature[j].start += rows
    for i in range(CAMERA_DIM + 2 * k, CAMERA_DIM + 2 * k + 2):
        P[i, : state.dim] = 0.0
        P[: state.dim, i] = 0.0
        P[i, i] = var
        state.bias[i - CAMERA_DIM] = 0.0
