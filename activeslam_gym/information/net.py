"""Net information of plans: how much less entropy the state has at a plan's end, with measurements on its way.

The joint state of camera and points is held by its information matrix Y = P^-1. There a measurement adds
H^T R^-1 H, which touches only the camera and one point, and a motion costs one downdate of rank 12. By the chain rule
the information of all measurements, less the entropy that the process noise adds, is 1/2 log2(|Y_end| / |Y_begin|): the
motion's own F has determinant 1.
"""

import math
from typing import NamedTuple

import numpy as np

from activeslam_gym.camera import view_of, visible
from activeslam_gym.information.candidates import Prospect, pose_after, stop_short
from activeslam_gym.information.foresight import foresee
from activeslam_gym.kernels import Record, borrowing, compiled
from activeslam_gym.linalg import (
    add_product,
    cholesky_in_place,
    copy_block,
    copy_into,
    log2_det_of_factor,
    product,
    solve_transposed,
    subtract_from_upper,
)
from activeslam_gym.motion import CAMERA_DIM, CAMERA_SIZE, open_loop, turn_of
from activeslam_gym.slam.sight import POSE_DIM, THING, point_measurement

ABSENT = -1
"""In place of a point's first row in Y: it is not in the state yet."""


class Noise(NamedTuple):
    """Open-loop motions that plans share: k of them, of different turn rate or length."""

    turn: np.ndarray
    """(k,) turn rate about the vertical [rad/s]."""
    frames: np.ndarray
    """(k,) length; 0: not filled yet."""
    back: np.ndarray
    """(k, 12, 12) F^-1."""
    factor: np.ndarray
    """(k, 12, 12) G, of G G^T = F^-1 Q F^-T."""


@compiled
def net_of_plans(
    camera: Record, motion: Record, prospect: Prospect, time: float, frames: int, plans: np.ndarray, out: np.ndarray
) -> None:
    """Write into ``out`` (A,) the net information [bit] of each of ``plans`` (A, L) of ACTION, from ``time`` [s] on.

    A plan ends after ``frames`` frames at the latest, those to the end of the episode. After each action the
    measurements that the sensor foresees there are taken. NaN where the covariance is not positive definite.
    """
    M, most = prospect.points.shape[0], 3 * plans.shape[1] + 3
    size = CAMERA_DIM + 3 * (M - prospect.waiting)
    U, Y_begin = prospect.covariance[:size, :size].copy(), np.zeros((size, size))
    if not cholesky_in_place(U):
        out[:] = np.nan
        return
    begin = -log2_det_of_factor(U, 0, size)
    _invert(U, Y_begin)
    shape = (most, CAMERA_DIM, CAMERA_DIM)
    noise = Noise(np.empty(most), np.zeros(most, np.int64), np.empty(shape), np.empty(shape))
    Y, points = np.zeros((CAMERA_DIM + 3 * M, CAMERA_DIM + 3 * M)), _unfound(camera, prospect)
    start = CAMERA_DIM + 3 * np.arange(M)
    pose, things = np.empty(CAMERA_SIZE), np.empty(1, THING)
    for a in range(plans.shape[0]):
        copy_block(Y_begin, Y)
        start[M - prospect.waiting :] = ABSENT
        copy_into(pose, prospect.camera)
        n, elapsed, prior = size, 0, 0.0
        for step in range(plans.shape[1]):
            action, taken = plans[a, step], min(plans[a, step].frames, frames - elapsed)
            if elapsed >= frames:
                break
            turn = turn_of(motion, action.gaze, time + elapsed * motion.dt)
            if taken > 0:
                k = _find_noise(motion, turn, taken, noise)
                _propagate(Y[:n, :n], noise.back[k], noise.factor[k])
            after = pose_after(motion, pose, action.motion, turn, taken)
            if motion.bodies:
                stop_short(motion, prospect, pose, after)
            copy_into(pose, after)
            n, added = _measure(camera, prospect, points, pose, start, n, Y, things[0])
            prior, elapsed = prior + added, elapsed + taken
        U = Y[:n, :n]
        out[a] = 0.5 * (log2_det_of_factor(U, 0, n) - begin - prior) if cholesky_in_place(U) else np.nan


@compiled
def _unfound(camera: Record, prospect: Prospect) -> np.ndarray:
    """(M, 3) the points; NaN for expected landmarks that the present image would show: nothing was found there."""
    M, z, present = prospect.points.shape[0], np.empty(2), view_of(camera, prospect.camera, prospect.boxes)
    points = prospect.points.copy()
    for k in range(M - prospect.waiting, M):
        if visible(present, points[k], 0.0, z):
            points[k] = np.nan
    return points


@compiled
def _find_noise(motion: Record, turn: float, frames: int, noise: Noise) -> int:
    """Which of ``noise`` is that of ``frames`` frames of turning at ``turn`` [rad/s]; filled where it was not."""
    k, last = 0, noise.frames.shape[0] - 1
    while k < last and noise.frames[k] != 0 and not (noise.frames[k] == frames and noise.turn[k] == turn):
        k += 1
    if noise.frames[k] != frames or noise.turn[k] != turn:
        noise.turn[k], noise.frames[k] = turn, frames
        _noise_of(motion, turn, frames, noise.back[k], noise.factor[k])
    return k


@compiled
def _invert(U: np.ndarray, out: np.ndarray) -> None:
    """``out`` (n, n) = (U^T U)^-1 of a factor ``U``, of which the lower triangle is not read."""
    n = U.shape[0]
    V = np.zeros((n, n))
    for i in range(n):
        V[i, i] = 1.0
    solve_transposed(U, V)
    out[:] = 0.0
    add_product(V.T, V, out)


@compiled
def _noise_of(motion: Record, turn: float, frames: int, back: np.ndarray, factor: np.ndarray) -> None:
    """Write F^-1, and G with G G^T = F^-1 Q F^-T, of ``frames`` frames of turning at ``turn`` [rad/s]."""
    F, Q = open_loop(motion, turn, frames)
    inverse = np.linalg.inv(F)
    copy_block(inverse, back)
    copy_block(product(product(inverse, Q), inverse.T), factor)
    for i in range(CAMERA_DIM):  # Cholesky; a pivot of 0, of a state without noise, gives a column of 0
        for j in range(i):
            value = factor[i, j]
            for k in range(j):
                value -= factor[i, k] * factor[j, k]
            factor[i, j] = value / factor[j, j] if factor[j, j] > 0.0 else 0.0
        pivot = factor[i, i]
        least = 1e-12 * pivot
        for k in range(i):
            pivot -= factor[i, k] ** 2
        factor[i, i] = math.sqrt(pivot) if pivot > least else 0.0
        factor[i, i + 1 :] = 0.0


@compiled
def _propagate(Y: np.ndarray, back: np.ndarray, G: np.ndarray) -> None:
    """Y = F^-T (Y - Y G (1 + G^T Y G)^-1 G^T Y) F^-1 in the camera's rows: process noise, then motion.

    The upper triangle of ``Y`` is kept, and the camera's block whole.
    """
    n = Y.shape[0]
    W, T = np.zeros((CAMERA_DIM, n)), np.zeros((CAMERA_DIM, CAMERA_DIM))
    add_product(G.T, Y[:CAMERA_DIM], W)
    add_product(W[:, :CAMERA_DIM], G, T)
    for i in range(CAMERA_DIM):
        T[i, i] += 1.0
    cholesky_in_place(T)
    solve_transposed(T, W)
    subtract_from_upper(Y, W, W, n)
    camera = Y[:CAMERA_DIM]
    for i in range(CAMERA_DIM):
        for j in range(i):
            camera[i, j] = camera[j, i]
    before = camera.copy()
    camera[:] = 0.0
    add_product(back.T, before, camera)
    block = camera[:, :CAMERA_DIM].copy()
    camera[:, :CAMERA_DIM] = 0.0
    add_product(block, back, camera[:, :CAMERA_DIM])


@compiled
def _measure(
    camera: Record,
    prospect: Prospect,
    points: np.ndarray,
    pose: np.ndarray,
    start: np.ndarray,
    n: int,
    Y: np.ndarray,
    thing: Record,
) -> tuple[int, float]:
    """Y += H^T R^-1 H of each fiducial and of ``points`` (M, 3) that are measured from ``pose`` (13,).

    ``start`` (M,) are their first rows in Y. Expected landmarks take room among what the sensor initialises all along.

    An expected landmark enters the state when it is first measured. Returns the new size of the state, and log2 |Y| of
    the priors of those that entered.
    """
    fiducials, P = prospect.fiducials, prospect.covariance
    seen = foresee(camera, prospect.limits, prospect.boxes, pose, fiducials, points, prospect.first_seen)
    view, weight, prior = view_of(camera, pose, prospect.boxes), 1.0 / camera.pixel_std**2, 0.0
    z, H_x, H_y = thing.z_hat, thing.H_camera, thing.H_feature
    for fiducial in fiducials:
        if visible(view, fiducial, 0.0, z) and point_measurement(view, fiducial, z, H_x, H_y):
            _add_gram(weight, H_x, POSE_DIM, H_x, POSE_DIM, Y)
    for k in range(points.shape[0]):
        if not seen[k] or not visible(view, points[k], 0.0, z):
            continue
        if not point_measurement(view, points[k], z, H_x, H_y):
            continue
        if start[k] == ABSENT:
            Y[:n, n : n + 3], Y[n : n + 3, n : n + 3] = 0.0, 0.0
            for i in range(n, n + 3):
                row = CAMERA_DIM + 3 * k + i - n
                Y[i, i] = 1.0 / P[row, row]
                prior += math.log2(Y[i, i])
            start[k], n = n, n + 3
        column = start[k]
        _add_gram(weight, H_x, POSE_DIM, H_x, POSE_DIM, Y)
        _add_gram(weight, H_x, POSE_DIM, H_y, 3, Y[:, column:])
        _add_gram(weight, H_y, 3, H_y, 3, Y[column:, column:])
    return n, prior


@borrowing
def _add_gram(weight: float, A: np.ndarray, rows: int, B: np.ndarray, columns: int, out: np.ndarray) -> None:
    """out[:rows, :columns] += weight A^T B, of A (2, >= rows) and B (2, >= columns)."""
    for i in range(rows):
        for j in range(columns):
            out[i, j] += weight * (A[0, i] * B[0, j] + A[1, i] * B[1, j])
