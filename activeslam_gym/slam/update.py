"""The batch update: all matches of a frame at once, one Cholesky factor of S."""

from __future__ import annotations

import math

import numpy as np

from activeslam_gym.compilation import part
from activeslam_gym.linalg import cholesky_in_place, solve_transposed, solve_transposed_vector, subtract_gram
from activeslam_gym.slam.belief import DIM, KIND_DIM, Belief, recentre, shift_mean
from activeslam_gym.slam.measurement import POSE_DIM, Predictions


@part
def update(belief: Belief, HP: np.ndarray, S: np.ndarray, innovation: np.ndarray) -> bool:
    """x ⊞ K nu, P - K S K^T by ``innovation`` nu (m,). False, with nothing changed, if S has no factor.

    ``HP`` (m, dim) and ``S`` = H P H^T + R (m, m) are overwritten. With U^T U = S and W = U^-T H P: K S K^T = W^T W
    and K nu = W^T (U^-T nu): one factor, no inverse.
    """
    dim = belief.size[DIM]
    if not cholesky_in_place(S):
        return False
    solve_transposed(S, HP)
    solve_transposed_vector(S, innovation)
    delta = np.zeros(dim)
    for r in range(HP.shape[0]):
        factor = innovation[r]
        for j in range(dim):
            delta[j] += HP[r, j] * factor
    for value in delta:
        if not math.isfinite(value):
            return False
    shift_mean(belief, delta)
    subtract_gram(belief.covariance, HP, dim)
    recentre(belief, delta)
    return True


@part
def stack(belief: Belief, K: int, rows: np.ndarray, predictions: Predictions) -> np.ndarray:
    """H P (2 m, dim) of the stacked ``rows`` (m,)."""
    P, dim, m = belief.covariance, belief.size[DIM], 2 * rows.shape[0]
    starts, kinds = belief.start, belief.kind
    HP = np.zeros((m, dim))
    for r in range(m):
        row, axis, target = rows[r // 2], r % 2, HP[r]
        start, width = columns_of(starts, kinds, row - K)
        for k in range(POSE_DIM + width):
            factor = (
                predictions.H_camera[row, axis, k] if k < POSE_DIM else predictions.H_feature[row, axis, k - POSE_DIM]
            )
            source = P[k] if k < POSE_DIM else P[start + k - POSE_DIM]
            for j in range(dim):
                target[j] += factor * source[j]
    return HP


@part
def innovation_covariance(
    belief: Belief, K: int, rows: np.ndarray, predictions: Predictions, HP: np.ndarray, pixel_var: float
) -> np.ndarray:
    """S (2 m, 2 m) = H P H^T + R of the stacked ``rows`` (m,), from their ``HP``."""
    m, starts, kinds = 2 * rows.shape[0], belief.start, belief.kind
    S = np.empty((m, m))
    for c in range(m):
        row, axis = rows[c // 2], c % 2
        start, width = columns_of(starts, kinds, row - K)
        for r in range(c + 1):
            value = pixel_var if r == c else 0.0
            for k in range(POSE_DIM):
                value += HP[r, k] * predictions.H_camera[row, axis, k]
            for k in range(width):
                value += HP[r, start + k] * predictions.H_feature[row, axis, k]
            S[r, c] = value
            S[c, r] = value
    return S


@part
def columns_of(starts: np.ndarray, kinds: np.ndarray, slot: int) -> tuple[int, int]:
    """First covariance row and dimensions of a slot; (0, 0) for a fiducial (slot < 0)."""
    if slot < 0:
        return 0, 0
    return starts[slot], KIND_DIM[kinds[slot]]
