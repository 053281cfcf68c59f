"""Open questions between predicted measurements and detections: one joint Gaussian of the predicted pixels.

A match conditions it, which sharpens every other prediction.
"""

import math
from typing import NamedTuple

import numpy as np

from activeslam_gym.kernels import Record, borrowing, compiled
from activeslam_gym.linalg import squared_distance
from activeslam_gym.slam.sight import Sight


class Hypotheses(NamedTuple):
    """The open questions between v predictions and M detections."""

    z: np.ndarray  # (2 v,) predicted pixels, given the matches so far [px]
    S: np.ndarray  # (2 v, 2 v) their joint covariance, given the matches so far; each detection adds its own R [px^2]
    open: np.ndarray  # (v,) bool: predictions without a match
    free: np.ndarray  # (M,) bool: detections without a match
    allowed: np.ndarray  # (v, M) bool: whether the detection may be the prediction, by its id
    d2: np.ndarray  # (v, M) squared Mahalanobis distances; inf where it may not
    cost: np.ndarray  # (v, M) d^2 + ln |S + R| - 2 log_ratio: -2 ln of the likelihood, less a constant


@compiled
def predicted_pixels(sight: Sight) -> tuple[np.ndarray, np.ndarray]:
    """Predicted pixels (2 v,) [px] and their joint covariance (2 v, 2 v) [px^2], without the R of a measurement."""
    z, S = np.empty(sight.S.shape[0]), sight.S.copy()
    for r in range(z.shape[0]):
        thing, first = sight.thing[r // 2], r - r % 2
        z[r] = thing.z_hat[r % 2]
        S[r, first] -= thing.R[r % 2, 0]
        S[r, first + 1] -= thing.R[r % 2, 1]
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
def measure_distances(h: Hypotheses, detections: np.ndarray) -> None:
    """Write distances and costs of the open predictions."""
    for a in range(h.open.shape[0]):
        if not h.open[a]:
            continue
        last, log_det = math.nan, math.nan  # of the detection before: most share one R
        for i in range(detections.shape[0]):
            if h.allowed[a, i]:
                h.d2[a, i], det = distance_and_det(h.z, h.S, a, detections[i])
                if det != last:
                    last, log_det = det, math.log(det)
                h.cost[a, i] = h.d2[a, i] + log_det - 2.0 * detections[i].log_ratio


@borrowing
def accept(h: Hypotheses, a: int, i: int, detections: np.ndarray) -> None:
    """Match prediction ``a`` to detection ``i``, and condition the predictions that stay open on it."""
    h.open[a] = False
    h.free[i] = False
    condition(h.z, h.S, h.open, a, detections[i])


@borrowing
def condition(z: np.ndarray, S: np.ndarray, others: np.ndarray, a: int, detection: Record) -> None:
    """Condition the joint Gaussian of ``others`` (v,) bool, without ``a``, on prediction ``a`` being ``detection``.

    z_o += S_oa (S_aa + R)^-1 nu, S_o -= S_oa (S_aa + R)^-1 S_a. Rows of all other predictions stay as they are.
    """
    s00, s01, s11 = innovation_of(S, a, detection)
    det = max(s00 * s11 - s01 * s01, 1e-300)
    x, y = detection.pixel[0] - z[2 * a], detection.pixel[1] - z[2 * a + 1]
    c0, c1 = S[2 * a], S[2 * a + 1]
    for i in range(z.shape[0]):
        if not others[i // 2]:
            continue
        g0, g1, row = (s11 * c0[i] - s01 * c1[i]) / det, (s00 * c1[i] - s01 * c0[i]) / det, S[i]
        z[i] += g0 * x + g1 * y
        for j in range(c0.shape[0]):
            row[j] -= g0 * c0[j] + g1 * c1[j]
