"""The batch update: all matches of a frame at once, one Cholesky factor of S."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from activeslam_gym.camera import CameraModel
from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.linalg import cholesky_in_place, solve_transposed, solve_transposed_vector, subtract_gram
from activeslam_gym.motion import QUATERNION
from activeslam_gym.slam.belief import DIM, KIND_DIM, Belief, recentre_rotation, shift_mean
from activeslam_gym.slam.measurement import POSE_DIM, Predictions, measure_row


@njit(cache=True)
def update(
    camera: CameraModel,
    belief: Belief,
    fiducials: np.ndarray,
    rows: np.ndarray,
    pixels: np.ndarray,
    predictions: Predictions,
    iterations: int,
) -> bool:
    """Correct the belief by matches (row, pixel): x ⊞ K (z - h), P - K S K^T. False, unchanged, if S has no factor.

    ``rows`` (M,), ``pixels`` (M, 2). With U^T U = S and W = U^-T H P: K S K^T = W^T W and K nu = W^T (U^-T nu).
    With ``iterations`` > 1 the measurement is relinearised at each new mean (Gauss-Newton; the iterated EKF):
    delta = K (z - h(x ⊞ delta) + H delta).
    """
    dim, m = belief.size[DIM], 2 * rows.shape[0]
    delta = np.zeros(dim)
    camera_0, feature_0 = belief.camera.copy(), belief.feature.copy()
    W = np.zeros((m, dim))
    done = False
    for iteration in range(iterations):
        if iteration > 0:
            _set_mean(belief, camera_0, feature_0, delta)
            if not _remeasure(camera, belief, fiducials, rows, predictions):
                break
        step = np.empty(m)
        W_new = np.zeros((m, dim))
        S = stack(belief, fiducials.shape[0], rows, predictions, camera.pixel_std**2, W_new)
        _innovation(belief, fiducials.shape[0], rows, pixels, predictions, delta, step)
        if not cholesky_in_place(S):
            break
        solve_transposed(S, W_new)
        solve_transposed_vector(S, step)
        W = W_new
        gain_times(W, step, delta)
        done = is_finite(delta)
        if not done:
            break
    if not done:
        _set_mean(belief, camera_0, feature_0, np.zeros(dim))
        return False
    _set_mean(belief, camera_0, feature_0, delta)
    subtract_gram(belief.covariance, W, dim)
    recentre_rotation(belief, delta)
    return True


@njit(cache=True)
def gain_times(W: np.ndarray, whitened: np.ndarray, out: np.ndarray) -> None:
    """out (dim,) = W^T ``whitened``: the gain times an innovation, in factored form."""
    out[:] = 0.0
    for r in range(W.shape[0]):
        factor = whitened[r]
        for j in range(W.shape[1]):
            out[j] += W[r, j] * factor


@njit(cache=True)
def is_finite(values: np.ndarray) -> bool:
    """Whether all of ``values`` (n,) are finite."""
    for value in values:
        if not math.isfinite(value):
            return False
    return True


@njit(cache=True)
def stack(
    belief: Belief, K: int, rows: np.ndarray, predictions: Predictions, pixel_var: float, HP: np.ndarray
) -> np.ndarray:
    """Write H P (m, dim) of the stacked ``rows`` into the zeros of ``HP``, and return S = H P H^T + R (m, m)."""
    P, dim, m = belief.covariance, belief.size[DIM], 2 * rows.shape[0]
    for r in range(m):
        row, axis = rows[r // 2], r % 2
        start, width = _columns(belief, row - K)
        for k in range(POSE_DIM + width):
            factor = predictions.H_camera[row, axis, k] if k < POSE_DIM else predictions.H_feature[row, axis, k - POSE_DIM]
            source = P[k] if k < POSE_DIM else P[start + k - POSE_DIM]
            target = HP[r]
            for j in range(dim):
                target[j] += factor * source[j]
    S = np.empty((m, m))
    for c in range(m):
        row, axis = rows[c // 2], c % 2
        start, width = _columns(belief, row - K)
        for r in range(c + 1):
            value = pixel_var if r == c else 0.0
            for k in range(POSE_DIM):
                value += HP[r, k] * predictions.H_camera[row, axis, k]
            for k in range(width):
                value += HP[r, start + k] * predictions.H_feature[row, axis, k]
            S[r, c] = value
            S[c, r] = value
    return S


@njit(cache=True)
def _columns(belief: Belief, slot: int) -> tuple[int, int]:
    """First covariance row and dimensions of a slot; (0, 0) for a fiducial (slot < 0)."""
    if slot < 0:
        return 0, 0
    return belief.start[slot], KIND_DIM[belief.kind[slot]]


@njit(cache=True)
def _innovation(
    belief: Belief,
    K: int,
    rows: np.ndarray,
    pixels: np.ndarray,
    predictions: Predictions,
    delta: np.ndarray,
    out: np.ndarray,
) -> None:
    """out (m,) = z - h + H delta."""
    for i in range(rows.shape[0]):
        start, width = _columns(belief, rows[i] - K)
        for axis in range(2):
            value = pixels[i, axis] - predictions.z_hat[rows[i], axis]
            for k in range(POSE_DIM):
                value += predictions.H_camera[rows[i], axis, k] * delta[k]
            for k in range(width):
                value += predictions.H_feature[rows[i], axis, k] * delta[start + k]
            out[2 * i + axis] = value


@njit(cache=True)
def _set_mean(belief: Belief, camera_0: np.ndarray, feature_0: np.ndarray, delta: np.ndarray) -> None:
    belief.camera[:] = camera_0
    belief.feature[:] = feature_0
    shift_mean(belief, delta)


@njit(cache=True)
def _remeasure(
    camera: CameraModel, belief: Belief, fiducials: np.ndarray, rows: np.ndarray, predictions: Predictions
) -> bool:
    R_WC = rotation_matrix(belief.camera[QUATERNION])
    for i in range(rows.shape[0]):
        if not measure_row(camera, belief, R_WC, fiducials, rows[i], predictions):
            return False
    return True
