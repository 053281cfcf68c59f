"""Net information of plans: how much less entropy the state has at a plan's end, with measurements on its way.

The joint state of camera and points is held by its information matrix Y = P^-1. There a measurement adds
H^T R^-1 H, which touches only the camera and one point, and a motion costs one downdate of rank 12. By the chain rule
the information of all measurements, less the entropy that the process noise adds, is 1/2 log2(|Y_end| / |Y_begin|): the
motion's own F has determinant 1.

Beside it stands how uncertain the position becomes on the way: the camera's own covariance is propagated, and updated
by fiducials and features, whose errors count as noise of their own in each measurement.
"""

import math
from typing import NamedTuple

import numpy as np

from activeslam_gym.camera import view_of, visible
from activeslam_gym.information.candidates import PredictedBelief, goal_pose, measurable_points, unshown
from activeslam_gym.kernels import Record, borrowing, compiled
from activeslam_gym.linalg import (
    add_product,
    cholesky_in_place,
    copy_block,
    diagonal,
    log2_det,
    log2_det_of_factor,
    product,
    solve_transposed,
    subtract_from_upper,
    subtract_symmetric,
)
from activeslam_gym.motion import CAMERA_DIM, open_loop, turn_of
from activeslam_gym.slam.sight import POSE_DIM, PREDICTED, point_measurement

ABSENT = -1  # in place of a point's first row in Y: it is not in the state yet


class OpenLoops(NamedTuple):
    """Open-loop motions that plans share: k of them, of different turn rate or length."""

    turn: np.ndarray  # (k,) turn rate about the vertical [rad/s]
    frames: np.ndarray  # (k,) length; 0: not filled yet
    forth: np.ndarray  # (k, 12, 12) F
    back: np.ndarray  # (k, 12, 12) F^-1
    factor: np.ndarray  # (k, 12, 12) G, of G G^T = F^-1 Q F^-T


class Forecast(NamedTuple):
    """Of plans (..., A): the net information of each, and how uncertain the position becomes on the way."""

    net_information: np.ndarray
    """How much less entropy the state has at its end [bit]."""
    position_std: np.ndarray
    """Greatest standard deviation of the position before a set of measurements, sqrt(tr P_position) [m]."""


class Course(NamedTuple):
    """Where the camera is on a plan."""

    pose: np.ndarray  # (13,)
    start: np.ndarray  # (M,) the first row of each point in Y, or ABSENT
    J: np.ndarray  # (6, 6) information on the pose of the measurements that are taken here
    images: int  # how many images measure the same


@compiled
def net_of_plans(
    lens: Record,
    motion: Record,
    belief: PredictedBelief,
    time: float,
    frames: int,
    plans: np.ndarray,
    net: np.ndarray,
    position_std: np.ndarray,
) -> None:
    """Write the `Forecast` of each of ``plans`` (A, L) of ACTION, from ``time`` [s] on: ``net``, ``position_std`` (A,).

    A plan ends after ``frames`` frames at the latest, those to the end of the episode. After each action the
    measurements that the sensor foresees there are taken, once for each frame of the action: R over their number.
    ``net`` is NaN where the covariance is not positive definite.
    """
    rest, most = unshown(lens, belief), 3 * plans.shape[1] + 3
    M = rest.points.shape[0]
    size = CAMERA_DIM + 3 * (M - rest.waiting)
    U, inverse = rest.covariance[:size, :size].copy(), diagonal(np.ones(size))
    if not cholesky_in_place(U):
        net[:], position_std[:] = np.nan, np.nan
        return
    begin = -log2_det_of_factor(U, 0, size)
    solve_transposed(U, inverse)
    Y_begin, shape = product(inverse.T, inverse), (most, CAMERA_DIM, CAMERA_DIM)
    noise = OpenLoops(np.empty(most), np.zeros(most, np.int64), np.empty(shape), np.empty(shape), np.empty(shape))
    C, J, pose = np.empty((CAMERA_DIM, CAMERA_DIM)), np.empty((POSE_DIM, POSE_DIM)), rest.camera
    Y, start = np.zeros((CAMERA_DIM + 3 * M, CAMERA_DIM + 3 * M)), CAMERA_DIM + 3 * np.arange(M)
    points = np.empty(1, PREDICTED)
    for a in range(plans.shape[0]):
        copy_block(Y_begin, Y)
        start[M - rest.waiting :] = ABSENT
        pose = rest.camera
        copy_block(rest.covariance[:CAMERA_DIM, :CAMERA_DIM], C)
        n, elapsed, prior, position_std[a] = size, 0, 0.0, 0.0
        for step in range(plans.shape[1]):
            action, taken = plans[a, step], min(plans[a, step].frames, frames - elapsed)
            if elapsed >= frames:
                break
            turn = turn_of(motion, action.gaze, time + elapsed * motion.dt)
            if taken > 0:
                k = _find_noise(motion, turn, taken, noise)
                _propagate(Y, n, noise.back[k], noise.factor[k])
                add_product(noise.factor[k], noise.factor[k].T, C)
                copy_block(product(noise.forth[k], product(noise.forth[k], C).T), C)
                position_std[a] = max(position_std[a], math.sqrt(C[0, 0] + C[1, 1] + C[2, 2]))
            pose = goal_pose(motion, rest, pose, action.motion, turn, taken)
            n, added = _measure(lens, rest, Course(pose, start, J, max(taken, 1)), n, Y, points[0])
            _update(C, J)
            prior, elapsed = prior + added, elapsed + taken
        net[a] = 0.5 * (log2_det(Y[:n, :n]) - begin - prior)


@compiled
def _find_noise(motion: Record, turn: float, frames: int, noise: OpenLoops) -> int:
    """Which of ``noise`` is that of ``frames`` frames of turning at ``turn`` [rad/s]; filled where it was not."""
    k, last = 0, noise.frames.shape[0] - 1
    while k < last and noise.frames[k] != 0 and not (noise.frames[k] == frames and noise.turn[k] == turn):
        k += 1
    if noise.frames[k] != frames or noise.turn[k] != turn:
        noise.turn[k], noise.frames[k] = turn, frames
        F, Q = open_loop(motion, turn, frames)
        back = np.linalg.inv(F)
        copy_block(F, noise.forth[k])
        copy_block(back, noise.back[k])
        copy_block(product(product(back, Q), back.T), noise.factor[k])
        _root(noise.factor[k])
    return k


@compiled
def _root(L: np.ndarray) -> None:
    """Replace a symmetric, positive semidefinite ``L`` by its lower Cholesky factor."""
    for i in range(L.shape[0]):  # a pivot of 0 gives a column of 0
        for j in range(i):
            value = L[i, j]
            for k in range(j):
                value -= L[i, k] * L[j, k]
            L[i, j] = value / L[j, j] if L[j, j] > 0.0 else 0.0
        pivot = L[i, i]
        least = 1e-12 * pivot
        for k in range(i):
            pivot -= L[i, k] ** 2
        L[i, i] = math.sqrt(pivot) if pivot > least else 0.0
        L[i, i + 1 :] = 0.0


@compiled
def _propagate(Y: np.ndarray, n: int, back: np.ndarray, G: np.ndarray) -> None:
    """Y = F^-T (Y - Y G (1 + G^T Y G)^-1 G^T Y) F^-1 in the camera's rows: process noise, then motion.

    The upper triangle of the leading ``n`` rows of ``Y`` is kept, and the camera's block whole.
    """
    W, camera = _downdate(G, CAMERA_DIM, Y, n), np.zeros((CAMERA_DIM, n))
    subtract_from_upper(Y, W, W, n)
    for i in range(CAMERA_DIM):
        for j in range(i):
            Y[i, j] = Y[j, i]
    add_product(back.T, Y[:CAMERA_DIM], camera)
    copy_block(camera, Y)
    copy_block(product(camera[:, :CAMERA_DIM], back), Y)


@compiled
def _update(C: np.ndarray, J: np.ndarray) -> None:
    """Update the camera's covariance: C = (C^-1 + J)^-1, where J (6, 6) is information on the pose.

    With J = L L^T it is C - W^T (1 + L^T C L)^-1 W of W = L^T C.
    """
    L = J.copy()
    _root(L)
    W = _downdate(L, POSE_DIM, C, CAMERA_DIM)
    subtract_symmetric(C, W, W, CAMERA_DIM)


@compiled
def _downdate(G: np.ndarray, k: int, Y: np.ndarray, n: int) -> np.ndarray:
    """W (k, n) with W^T W = Y G (1 + G^T Y G)^-1 G^T Y on ``n`` columns; ``G`` (k, k) is on the leading k of them."""
    W, T = np.zeros((k, n)), np.zeros((k, k))
    add_product(G.T, Y[:k], W)
    add_product(W[:, :k], G, T)
    for i in range(k):
        T[i, i] += 1.0
    cholesky_in_place(T)
    solve_transposed(T, W)
    return W


@compiled
def _measure(
    lens: Record, belief: PredictedBelief, course: Course, n: int, Y: np.ndarray, point: Record
) -> tuple[int, float]:
    """Y += H^T R^-1 H of each fiducial and point that is measured; fiducials and features add to J too.

    An expected landmark enters the state when it is first measured, and takes room among what the sensor initialises
    all along. Returns the new size of the state, and log2 |Y| of the priors of those that entered.
    """
    (pose, start, J, images), fiducials, points = course, belief.fiducials, belief.points
    seen, P = measurable_points(lens, belief, pose), belief.covariance
    view, weight, prior = view_of(lens, pose, belief.boxes), images / lens.pixel_std**2, 0.0
    z, H_x, H_y = point.z_hat, point.H_camera, point.H_feature
    J[:] = 0.0
    for fiducial in fiducials:
        if visible(view, fiducial, 0.0, z) and point_measurement(view, fiducial, z, H_x, H_y):
            _add_gram(weight, H_x, POSE_DIM, H_x, POSE_DIM, Y)
            _add_gram(weight, H_x, POSE_DIM, H_x, POSE_DIM, J)
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
        if k < points.shape[0] - belief.waiting:
            row = CAMERA_DIM + 3 * k
            _add_information(H_x, H_y, P[row : row + 3, row : row + 3], 1.0 / weight, J)
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


@borrowing
def _add_information(H_x: np.ndarray, H_y: np.ndarray, P: np.ndarray, var: float, J: np.ndarray) -> None:
    """J += H_x^T (H_y P H_y^T + var)^-1 H_x, of a point with the covariance ``P`` (3, 3) of its own."""
    uu, uv, vv = var, 0.0, var
    for i in range(3):
        for j in range(3):
            uu += H_y[0, i] * P[i, j] * H_y[0, j]
            uv += H_y[0, i] * P[i, j] * H_y[1, j]
            vv += H_y[1, i] * P[i, j] * H_y[1, j]
    determinant = uu * vv - uv * uv
    for j in range(POSE_DIM):
        u = (vv * H_x[0, j] - uv * H_x[1, j]) / determinant
        v = (uu * H_x[1, j] - uv * H_x[0, j]) / determinant
        for i in range(POSE_DIM):
            J[i, j] += H_x[0, i] * u + H_x[1, i] * v
