"""Unknown correspondence: mutual best matches inside a chi-square gate.

The paper takes the nearest predicted feature inside the ellipse of S. Plain Mahalanobis distance favours whatever is
uncertain, since a large ellipse is near everything; so "nearest" is by likelihood, d^2 + ln |S|, and a match must be the
best for its detection and for its feature. The gate itself stays on d^2.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from activeslam_gym.slam.belief import Belief
from activeslam_gym.slam.depth_particles import Rays, ray_distance
from activeslam_gym.slam.measurement import UNSEEN, Predictions, determinant, squared_distance

NEW, REJECTED = -1, -2
"""A detection outside every birth gate; one that is near a prediction but no match."""


@njit(cache=True)
def associate(
    belief: Belief,
    predictions: Predictions,
    rays: Rays,
    fiducial_count: int,
    pixels: np.ndarray,
    gate: float,
    birth_gate: float,
) -> np.ndarray:
    """Match ``pixels`` (M, 2) to rows; returns (M,) the row of each, or NEW or REJECTED.

    ``gate`` and ``birth_gate`` are chi-square quantiles of 2 dof.
    """
    rows, M = predictions.visibility.shape[0], pixels.shape[0]
    d2, cost = _distances(belief, predictions, rays, fiducial_count, pixels)
    best_row, best_pixel, near = np.full(M, -1), np.full(rows, -1), np.zeros(M, np.bool_)
    for r in range(rows):
        for i in range(M):
            near[i] |= d2[r, i] < birth_gate
            if d2[r, i] < gate:
                if best_row[i] < 0 or cost[r, i] < cost[best_row[i], i]:
                    best_row[i] = r
                if best_pixel[r] < 0 or cost[r, i] < cost[r, best_pixel[r]]:
                    best_pixel[r] = i
    out = np.empty(M, np.int64)
    for i in range(M):
        if best_row[i] >= 0 and best_pixel[best_row[i]] == i:
            out[i] = best_row[i]
        else:
            out[i] = REJECTED if near[i] else NEW
    return out


@njit(cache=True)
def _distances(
    belief: Belief, predictions: Predictions, rays: Rays, fiducial_count: int, pixels: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Squared Mahalanobis distance and -2 ln likelihood (less ln 4 pi^2), (rows, M); inf where nothing is predicted."""
    rows, M = predictions.visibility.shape[0], pixels.shape[0]
    d2, cost = np.full((rows, M), np.inf), np.full((rows, M), np.inf)
    for row in range(rows):
        if predictions.visibility[row] != UNSEEN:
            log_det = math.log(determinant(predictions.S[row]))
            for i in range(M):
                d2[row, i] = squared_distance(pixels[i], predictions.z_hat[row], predictions.S[row])
                cost[row, i] = d2[row, i] + log_det
    for r in range(rays.slot.shape[0]):
        row = fiducial_count + rays.slot[r]
        for i in range(M):
            d2[row, i], cost[row, i] = ray_distance(belief, rays, r, pixels[i])
    return d2, cost
