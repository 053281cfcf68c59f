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
def write_gain(S: np.ndarray, a: int, detection: Record, g0: np.ndarray, g1: np.ndarray) -> None:
    """The gain S_:a (S_aa + R)^-1 of prediction ``a`` being ``detection``, by columns (2 v,)."""
    s00, s01, s11 = innovation_of(S, a, detection)
    det = max(s00 * s11 - s01 * s01, 1e-300)
    c0, c1 = S[2 * a], S[2 * a + 1]
    for i in range(c0.shape[0]):
        g0[i], g1[i] = (s11 * c0[i] - s01 * c1[i]) / det, (s00 * c1[i] - s01 * c0[i]) / det


@compiled
def condition(z: np.ndarray, S: np.ndarray, a: int, detection: Record, matches: np.ndarray) -> None:
    """Make ``z`` (2 v,) and ``S`` (2 v, 2 v) the joint Gaussian given that prediction ``a`` is ``detection``.

    z + S_:a (S_aa + R)^-1 nu, S - S_:a (S_aa + R)^-1 S_a:. Of predictions with ``matches`` (v,), as of ``a``, the own
    blocks alone: no other will be conditioned on them.
    """
    first, gain = 2 * a, np.empty((2, z.shape[0]))
    g0, g1, c0, c1 = gain[0], gain[1], S[first], S[first + 1]
    write_gain(S, a, detection, g0, g1)
    x, y = detection.pixel[0] - z[first], detection.pixel[1] - z[first + 1]
    for i in range(z.shape[0]):
        z[i] += g0[i] * x + g1[i] * y
        row = S[i]
        if i // 2 != a and matches[i // 2] < 0:
            u, w = g0[i], g1[i]
            for j in range(c0.shape[0]):
                row[j] -= u * c0[j] + w * c1[j]
        elif i // 2 != a:
            for j in range(i - i % 2, i - i % 2 + 2):
                row[j] -= g0[i] * c0[j] + g1[i] * c1[j]
    for j in range(first, first + 2):  # last, as all others are by these rows
        u, w = c0[j], c1[j]
        c0[j] -= g0[first] * u + g1[first] * w
        c1[j] -= g0[first + 1] * u + g1[first + 1] * w


@borrowing
def conditioned(
    z: np.ndarray, S: np.ndarray, a: int, detection: Record, gain: np.ndarray, b: int, other: Record
) -> tuple[float, float]:
    """`distance_and_det` of ``other`` from prediction ``b``, given by the ``gain`` (2, 2 v) that ``a`` is
    ``detection``."""
    i, k, R = 2 * b, 2 * a, other.R
    x, y = detection.pixel[0] - z[k], detection.pixel[1] - z[k + 1]
    g0, g1, h0, h1 = gain[0, i], gain[1, i], gain[0, i + 1], gain[1, i + 1]
    s00 = S[i, i] - (g0 * S[k, i] + g1 * S[k + 1, i])
    s01 = S[i, i + 1] - (g0 * S[k, i + 1] + g1 * S[k + 1, i + 1])
    s11 = S[i + 1, i + 1] - (h0 * S[k, i + 1] + h1 * S[k + 1, i + 1])
    u, v = other.pixel[0] - (z[i] + (g0 * x + g1 * y)), other.pixel[1] - (z[i + 1] + (h0 * x + h1 * y))
    return squared_distance(s00 + R[0, 0], s01 + R[0, 1], s11 + R[1, 1], u, v)


class Hypotheses(NamedTuple):
    """What M detections may be of: the Gaussian of v predicted pixels, given the matches so far, and the distances."""

    points: np.ndarray  # (v,) PREDICTED
    detections: np.ndarray  # (M,) DETECTION
    z: np.ndarray  # (2 v,) predicted pixels [px]
    S: np.ndarray  # (2 v, 2 v) their joint covariance; each detection adds its own R [px^2]
    d2: np.ndarray  # (v, M) squared Mahalanobis distances; inf where the ids differ, or one of the two is matched


@inlined
def at_level(levels: Hypotheses, k: int) -> Hypotheses:
    """Level ``k`` of several, which share the points and the detections: their other arrays have an axis in front."""
    return Hypotheses(levels.points, levels.detections, levels.z[k], levels.S[k], levels.d2[k])


@compiled
def hypotheses(points: np.ndarray, detections: np.ndarray, z: np.ndarray, S: np.ndarray) -> Hypotheses:
    """All that ``detections`` (M,) may be of the ``points`` (v,), which are predicted at ``z`` (2 v,) with ``S``."""
    h = Hypotheses(points, detections, z, S, np.empty((points.shape[0], detections.shape[0])))
    measure_from_start(h)
    return h


@borrowing
def measure_from_start(h: Hypotheses) -> None:
    """Write all distances, as if nothing were matched."""
    for a in range(h.d2.shape[0]):
        for i in range(h.d2.shape[1]):
            apart = h.detections[i].id != UNASSOCIATED and h.detections[i].id != h.points[a].id
            h.d2[a, i] = np.inf if apart else 0.0
    measure_distances(h)


@borrowing
def measure_distances(h: Hypotheses) -> None:
    """Write the distances that are not infinite."""
    for a in range(h.d2.shape[0]):
        for i in range(h.d2.shape[1]):
            if h.d2[a, i] < np.inf:
                h.d2[a, i] = distance_and_det(h.z, h.S, a, h.detections[i])[0]


@borrowing
def cost_of(h: Hypotheses, a: int, i: int) -> float:
    """d^2 + ln |S + R| - 2 log_ratio: -2 ln of the likelihood that detection ``i`` is prediction ``a``, less a
    constant."""
    d2, det = distance_and_det(h.z, h.S, a, h.detections[i])
    return d2 + math.log(det) - 2.0 * h.detections[i].log_ratio


@compiled
def accept(h: Hypotheses, a: int, i: int, matches: np.ndarray) -> None:
    """Match prediction ``a`` to detection ``i``, and `condition` all predictions on it."""
    h.d2[a], h.d2[:, i] = np.inf, np.inf
    condition(h.z, h.S, a, h.detections[i], matches)


@borrowing
def condition_open(h: Hypotheses, below: Hypotheses, a: int, i: int, matches: np.ndarray) -> None:
    """Write to ``below`` what ``h`` leaves of the predictions without a match, given that ``a`` is detection ``i``.

    ``matches`` (v,) are negative for them.
    """
    one, c0, c1 = h.detections[i], h.S[2 * a], h.S[2 * a + 1]
    x, y = one.pixel[0] - h.z[2 * a], one.pixel[1] - h.z[2 * a + 1]
    g0, g1 = below.S[2 * a], below.S[2 * a + 1]  # no rows of an open prediction
    write_gain(h.S, a, one, g0, g1)
    for b in range(matches.shape[0]):
        if matches[b] < 0:
            for r in range(2 * b, 2 * b + 2):
                row, out, u, w = h.S[r], below.S[r], g0[r], g1[r]
                below.z[r] = h.z[r] + (u * x + w * y)
                for j in range(c0.shape[0]):
                    out[j] = row[j] - (u * c0[j] + w * c1[j])
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
