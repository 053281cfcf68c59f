"""Detections, and what each may be of: the joint Gaussian of the predicted pixels, and the distances from it."""

import math
from typing import NamedTuple

import numpy as np

from activeslam_gym.kernels import Record, borrowing, compiled, inlined, record
from activeslam_gym.linalg import squared_distance
from activeslam_gym.slam.sight import Sight

DETECTION = record(
    pixel=("f8", 2),  # [px]
    R=("f8", (2, 2)),  # covariance of its noise [px^2]
    id="i8",  # of the one prediction that it may be; UNASSOCIATED: any
    log_ratio="f8",  # log likelihood of its appearance, if it is that prediction, over an unmapped detection's
    match="i8",  # the filter's answer: the id of the prediction that it was matched to, or NEW or REJECTED
)
"""A measured pixel before its association. The ids are those of features (positive) and of fiducials (negative)."""
UNASSOCIATED = 0
NEW, REJECTED = 0, -(2**62)
"""A detection that nothing known explains; one that something may explain, too unclear to be used."""
MISSED, WAITS = -1, -2
"""A prediction without a detection; one that a detection may be of, too unclear to be used."""


def chi_square_2_quantile(probability: float) -> float:
    """Quantile of the chi-square distribution of 2 dof, -2 ln(1 - p): 9.21 at 99 %."""
    return -2.0 * math.log(1.0 - probability)


@compiled
def predicted_pixels(sight: Sight) -> tuple[np.ndarray, np.ndarray]:
    """Predicted pixels (2 v,) [px] and their joint covariance (2 v, 2 v) [px^2], without the R of a measurement."""
    z, S = np.empty(sight.S.shape[0]), sight.S.copy()
    for r in range(z.shape[0]):
        point, first = sight.point[r // 2], r - r % 2
        z[r] = point.z_hat[r % 2]
        S[r, first] -= point.R[r % 2, 0]
        S[r, first + 1] -= point.R[r % 2, 1]
    return z, S


@borrowing
def innovation_of(S: np.ndarray, a: int, detection: Record) -> tuple[float, float, float]:
    """(s00, s01, s11) of S_aa + R: prediction ``a``'s innovation covariance with the R of the ``detection``."""
    R = detection.R
    return S[2 * a, 2 * a] + R[0, 0], S[2 * a, 2 * a + 1] + R[0, 1], S[2 * a + 1, 2 * a + 1] + R[1, 1]


@borrowing
def distance_and_det(z: np.ndarray, S: np.ndarray, a: int, detection: Record) -> tuple[float, float]:
    """(d^2, |S_aa + R|): the squared Mahalanobis distance of a detection from prediction ``a``."""
    s00, s01, s11 = innovation_of(S, a, detection)
    return squared_distance(s00, s01, s11, detection.pixel[0] - z[2 * a], detection.pixel[1] - z[2 * a + 1])


@borrowing
def distance_by_own_noise(z_hat: np.ndarray, S: np.ndarray, R: np.ndarray, detection: Record) -> tuple[float, float]:
    """The same from the predicted pixel ``z_hat`` (2,) and its ``S``, with the detection's R in place of ``R`` in S."""
    own, z = detection.R, detection.pixel
    s00, s01, s11 = S[0, 0] + (own[0, 0] - R[0, 0]), S[0, 1] + (own[0, 1] - R[0, 1]), S[1, 1] + (own[1, 1] - R[1, 1])
    return squared_distance(s00, s01, s11, z[0] - z_hat[0], z[1] - z_hat[1])


@borrowing
def condition(
    z: np.ndarray, S: np.ndarray, a: int, detection: Record, new_z: np.ndarray, new_S: np.ndarray, matches: np.ndarray
) -> None:
    """Write the joint Gaussian, given that prediction ``a`` is ``detection``, of those whose ``matches`` are negative.

    z + S_:a (S_aa + R)^-1 nu, S - S_:a (S_aa + R)^-1 S_a:.
    """
    s00, s01, s11 = innovation_of(S, a, detection)
    det = max(s00 * s11 - s01 * s01, 1e-300)
    x, y = detection.pixel[0] - z[2 * a], detection.pixel[1] - z[2 * a + 1]
    c0, c1 = S[2 * a], S[2 * a + 1]
    for i in range(z.shape[0]):
        if matches[i // 2] < 0:
            g0, g1 = (s11 * c0[i] - s01 * c1[i]) / det, (s00 * c1[i] - s01 * c0[i]) / det
            new_z[i] = z[i] + (g0 * x + g1 * y)
            row, out = S[i], new_S[i]
            for j in range(c0.shape[0]):
                out[j] = row[j] - (g0 * c0[j] + g1 * c1[j])


@compiled
def condition_all(z: np.ndarray, S: np.ndarray, a: int, detection: Record) -> None:
    """Condition the joint Gaussian of ``z`` (2 v,) and ``S`` (2 v, 2 v) on prediction ``a`` being ``detection``."""
    condition(z.copy(), S.copy(), a, detection, z, S, np.full(z.shape[0] // 2, MISSED))


class Hypotheses(NamedTuple):
    """What M detections may be of: the Gaussian of v predicted pixels, given the matches so far, and the distances."""

    points: np.ndarray  # (v,) PREDICTED
    detections: np.ndarray  # (M,) DETECTION
    z: np.ndarray  # (2 v,) predicted pixels [px]
    S: np.ndarray  # (2 v, 2 v) their joint covariance; each detection adds its own R [px^2]
    d2: np.ndarray  # (v, M) squared Mahalanobis distances; inf where the ids differ, or one of the two is matched
    cost: np.ndarray  # (v, M) d^2 + ln |S + R| - 2 log_ratio: -2 ln of the likelihood, less a constant


@inlined
def at_level(levels: Hypotheses, k: int) -> Hypotheses:
    """Level ``k`` of several, which share the points and the detections: their other arrays have an axis in front."""
    return Hypotheses(levels.points, levels.detections, levels.z[k], levels.S[k], levels.d2[k], levels.cost[k])


@compiled
def hypotheses(points: np.ndarray, detections: np.ndarray, z: np.ndarray, S: np.ndarray) -> Hypotheses:
    """All that ``detections`` (M,) may be of the ``points`` (v,), which are predicted at ``z`` (2 v,) with ``S``."""
    shape = points.shape[0], detections.shape[0]
    h = Hypotheses(points, detections, z, S, np.zeros(shape), np.full(shape, np.inf))
    for a in range(points.shape[0]):
        for i in range(detections.shape[0]):
            if detections[i].id != UNASSOCIATED and detections[i].id != points[a].id:
                h.d2[a, i] = np.inf
    measure_distances(h)
    return h


@borrowing
def measure_distances(h: Hypotheses) -> None:
    """Write the distances and costs that are not infinite."""
    for a in range(h.d2.shape[0]):
        last, log_det = math.nan, math.nan  # of the detection before: most share one R
        for i in range(h.d2.shape[1]):
            if h.d2[a, i] < np.inf:
                h.d2[a, i], det = distance_and_det(h.z, h.S, a, h.detections[i])
                if det != last:
                    last, log_det = det, math.log(det)
                h.cost[a, i] = h.d2[a, i] + log_det - 2.0 * h.detections[i].log_ratio


@compiled
def accept(h: Hypotheses, a: int, i: int) -> None:
    """Match prediction ``a`` to detection ``i``, and condition all predictions on it."""
    h.d2[a, :] = np.inf
    h.d2[:, i] = np.inf
    condition_all(h.z, h.S, a, h.detections[i])


@borrowing
def condition_open(h: Hypotheses, below: Hypotheses, a: int, i: int, matches: np.ndarray) -> None:
    """Write to ``below`` what ``h`` leaves of the predictions without a match, given that ``a`` is detection ``i``.

    ``matches`` (v,) are negative for them. Costs are not written.
    """
    condition(h.z, h.S, a, h.detections[i], below.z, below.S, matches)
    for b in range(matches.shape[0]):
        if matches[b] < 0:
            for j in range(h.d2.shape[1]):
                gone = j == i or h.d2[b, j] == np.inf
                below.d2[b, j] = np.inf if gone else distance_and_det(below.z, below.S, b, h.detections[j])[0]


@borrowing
def log_missed(model: Record, h: Hypotheses, a: int) -> float:
    """ln(1 - P_D P(in the image)) of prediction ``a``, the axes of its measured pixel taken as independent."""
    seen = model.detection_probability
    for axis in range(2):
        z, var = h.z[2 * a + axis], h.S[2 * a + axis, 2 * a + axis]
        wide = math.sqrt(2.0 * (var + model.pixel_var))
        seen *= 0.5 * (math.erf((model.image_size[axis] - z) / wide) + math.erf(z / wide))
    return math.log(1.0 - seen)
