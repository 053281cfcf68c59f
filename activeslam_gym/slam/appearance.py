"""Association of identified detections: a searcher looked for each prediction around its pixel, and found likenesses.

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
from activeslam_gym.slam.detection import REJECTED, chi_square_2_quantile, condition, distance_and_det, predicted_pixels
from activeslam_gym.slam.sight import Sight

APPEARANCE, appearance_of = constants(
    Scenario(),
    search_gate=11.8,  # chi-square bound of the first detection: what is searched is an ellipse of 3 sigma
    gate=lambda s: chi_square_2_quantile(s.gate_probability),  # and of each further one, given those accepted
    chance_area=500.0,  # searched area for one detection by chance, which looks enough like the prediction [px^2]
)
"""Constants of the association of identified detections."""


@compiled
def associate_identified(model: Record, sight: Sight, detections: np.ndarray, least: int) -> np.ndarray:
    """Match ``detections`` (M,) that bear ids to the predictions in ``sight`` (v,); none, if fewer than ``least``
    agree.

    Returns (v,) the detection of each prediction, or -1, and sets ``detections.match``: the id, or REJECTED.
    """
    v, M = sight.point.shape[0], detections.shape[0]
    z, S = predicted_pixels(sight)
    of_detection, of_point, count = np.full(M, -1), np.full(v, -1), 0
    for a in range(v):
        for i in range(M):
            if detections[i].id == sight.point[a].id:
                of_detection[i] = a
    best = _best(model, z, S, detections, of_detection, of_point, True)
    while best >= 0:
        a = of_detection[best]
        of_point[a], count = best, count + 1
        condition(z, S, a, detections[best])
        best = _best(model, z, S, detections, of_detection, of_point, False)
    if count < least:
        of_point[:] = -1
    for i in range(M):
        a = of_detection[i]
        detections[i].match = detections[i].id if a >= 0 and of_point[a] == i else REJECTED
    return of_point


@compiled
def _best(
    model: Record,
    z: np.ndarray,
    S: np.ndarray,
    detections: np.ndarray,
    of_detection: np.ndarray,
    of_point: np.ndarray,
    votes: bool,
) -> int:
    """The worthiest detection of the predictions without one, or -1 where none inside the gate is worth more than
    nothing.

    ``votes``: the worth that each other prediction's best then has counts too, and what was searched is the gate.
    """
    best, most = -1, 0.0
    for i in range(detections.shape[0]):
        a = of_detection[i]
        if a < 0 or of_point[a] >= 0:
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
    a, best = of_detection[seed], np.zeros(z.shape[0] // 2)
    z, S = z.copy(), S.copy()
    condition(z, S, a, detections[seed])
    for i in range(detections.shape[0]):
        b = of_detection[i]
        if b >= 0 and b != a:
            d2, det = distance_and_det(z, S, b, detections[i])
            best[b] = max(best[b], _worth(model, detections[i], d2, det))
    return best.sum()


@borrowing
def _worth(model: Record, detection: Record, d2: float, det: float) -> float:
    """The log likelihood ratio against an unmapped detection; see the module."""
    return detection.log_ratio + math.log(model.chance_area / (2.0 * math.pi)) - 0.5 * (math.log(det) + d2)
