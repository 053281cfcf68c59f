"""What is open between the things that should be in view and the candidates: one joint Gaussian of predicted pixels.

A match conditions it, which sharpens what is predicted of everything else.
"""

import math
from typing import NamedTuple

import numpy as np

from activeslam_gym.kernels import Record, borrowing, compiled
from activeslam_gym.linalg import cholesky_in_place, solve_transposed, squared_distance, subtract_gram


class Predicted(NamedTuple):
    """The joint Gaussian of the predicted pixels of v things."""

    z: np.ndarray
    """(2 v,) given the matches so far [px]."""
    S: np.ndarray
    """(2 v, 2 v) their joint innovation covariance, given the matches so far, with the camera's R [px^2]."""


class Hypotheses(NamedTuple):
    """What is still open between v predicted things and M candidates."""

    z: np.ndarray
    """(2 v,) predicted pixels, given the matches so far [px]."""
    S: np.ndarray
    """(2 v, 2 v) their joint innovation covariance, given the matches so far, with the camera's R [px^2]."""
    open: np.ndarray
    """(v,) bool: things without a match."""
    free: np.ndarray
    """(M,) bool: candidates without a match."""
    allowed: np.ndarray
    """(v, M) bool: whether the candidate may be the thing, by its id."""
    d2: np.ndarray
    """(v, M) squared Mahalanobis distances; inf where it may not."""
    cost: np.ndarray
    """(v, M) d^2 + ln |S| - 2 log_ratio: -2 ln of the likelihood, less a constant."""


@borrowing
def measure_distances(h: Hypotheses, candidates: np.ndarray, pixel_var: float) -> None:
    """Distances and costs of the open things."""
    for a in range(h.open.shape[0]):
        if not h.open[a]:
            continue
        r00, r01, r11, log_det = pixel_var, 0.0, pixel_var, math.nan  # of the last candidate: most share one R
        for i in range(candidates.shape[0]):
            if not h.allowed[a, i]:
                continue
            candidate, R = candidates[i], candidates[i].R
            s00, s01, s11 = innovation_with(h, a, candidate, pixel_var)
            x, y = candidate.pixel[0] - h.z[2 * a], candidate.pixel[1] - h.z[2 * a + 1]
            h.d2[a, i], det = squared_distance(s00, s01, s11, x, y)
            if math.isnan(log_det) or R[0, 0] != r00 or R[0, 1] != r01 or R[1, 1] != r11:
                r00, r01, r11, log_det = R[0, 0], R[0, 1], R[1, 1], math.log(det)
            h.cost[a, i] = h.d2[a, i] + log_det - 2.0 * candidate.log_ratio


@borrowing
def innovation_with(
    h: Predicted | Hypotheses, a: int, candidate: Record, pixel_var: float
) -> tuple[float, float, float]:
    """(s00, s01, s11) of thing ``a``'s innovation covariance with the candidate's own R."""
    R = candidate.R
    return (
        h.S[2 * a, 2 * a] + (R[0, 0] - pixel_var),
        h.S[2 * a, 2 * a + 1] + R[0, 1],
        h.S[2 * a + 1, 2 * a + 1] + (R[1, 1] - pixel_var),
    )


@borrowing
def close(h: Hypotheses, a: int, i: int) -> None:
    """Thing ``a`` and candidate ``i`` have found each other."""
    h.open[a] = False
    h.free[i] = False


@borrowing
def condition(h: Predicted | Hypotheses, others: np.ndarray, a: int, candidate: Record, pixel_var: float) -> None:
    """Condition the joint Gaussian of ``others`` (v,) bool, of which ``a`` is none, on thing ``a`` being ``candidate``.

    Of all other things the rows of ``h.S`` stay as they are.
    """
    z, S = h.z, h.S
    s00, s01, s11 = innovation_with(h, a, candidate, pixel_var)
    det = max(s00 * s11 - s01 * s01, 1e-300)
    x, y = candidate.pixel[0] - z[2 * a], candidate.pixel[1] - z[2 * a + 1]
    c0, c1 = S[2 * a], S[2 * a + 1]
    for i in range(z.shape[0]):
        if not others[i // 2]:
            continue
        g0, g1, row = (s11 * c0[i] - s01 * c1[i]) / det, (s00 * c1[i] - s01 * c0[i]) / det, S[i]
        z[i] += g0 * x + g1 * y
        for j in range(c0.shape[0]):
            row[j] -= g0 * c0[j] + g1 * c1[j]


@compiled
def condition_on_all(h: Hypotheses, partner: np.ndarray, candidates: np.ndarray, pixel_var: float) -> None:
    """Condition the open things, all at once, on thing ``a`` being candidate ``partner[a]`` (v,) wherever that is >= 0.

    By W = U^-T [S_mo, z - z_hat] with S_mm = U^T U: z_o += W_o^T w, S_oo -= W_o^T W_o. Nothing is done where S_mm has
    no factor.
    """
    known, unknown = _rows_of(partner >= 0), _rows_of(h.open)
    n, count = known.shape[0], unknown.shape[0]
    U, W, S_oo = np.empty((n, n)), np.empty((n, count + 1)), np.empty((count, count))
    for r in range(n):
        source, candidate = h.S[known[r]], candidates[partner[known[r] // 2]]
        for c in range(n):
            U[r, c] = source[known[c]]
        for axis in range(2):
            U[r, r - r % 2 + axis] += candidate.R[r % 2, axis]
        U[r, r] -= pixel_var
        for c in range(count):
            W[r, c] = source[unknown[c]]
        W[r, count] = candidate.pixel[r % 2] - h.z[known[r]]
    if not cholesky_in_place(U):
        return
    solve_transposed(U, W)
    for r in range(count):
        for c in range(count):
            S_oo[r, c] = h.S[unknown[r], unknown[c]]
        for k in range(n):
            h.z[unknown[r]] += W[k, r] * W[k, count]
    subtract_gram(S_oo, W, count)
    for r in range(count):
        for c in range(count):
            h.S[unknown[r], unknown[c]] = S_oo[r, c]


@compiled
def _rows_of(things: np.ndarray) -> np.ndarray:
    """The pixel rows of the chosen ``things`` (v,) bool."""
    rows, n = np.empty(2 * things.shape[0], np.int64), 0
    for a in range(things.shape[0]):
        if things[a]:
            rows[n], rows[n + 1] = 2 * a, 2 * a + 1
            n += 2
    return rows[:n]
