"""Changes of the map: a feature joins it, leaves it, or turns into a point."""

import numpy as np

from activeslam_gym.kernels import borrowing, compiled
from activeslam_gym.linalg import add_product, add_symmetric_product, copy_block, copy_into
from activeslam_gym.motion import CAMERA_DIM
from activeslam_gym.slam.belief import (
    FEATURE_SIZE,
    KIND_DIM,
    NEVER,
    POINT,
    Belief,
    point_marginal,
    point_of,
)


@borrowing
def room_for(belief: Belief, width: int) -> bool:
    """Whether one more feature of ``width`` dimensions fits."""
    return belief.state.count < belief.feature.shape[0] and belief.state.dim + width <= belief.covariance.shape[0]


@borrowing
def append_feature(belief: Belief, kind: int, mean: np.ndarray, J: np.ndarray, Q: np.ndarray) -> int:
    """Add a feature y = g(camera, rest) and return its position, the last; the caller has asked `room_for` it.

    ``mean`` (6,); ``J`` (width, 12) is dy/d camera tangent; ``Q`` (>= width, >= width) the covariance of what does not
    come from the camera: P_yx = J P_cx, P_yy = J P_cc J^T + Q.
    """
    state, P, width = belief.state, belief.covariance, J.shape[0]
    at, k = state.dim, state.count
    P_yx, P_yy = P[at : at + width, :at], P[at : at + width, at : at + width]
    P_yx[:, :] = 0.0
    add_product(J, P[:CAMERA_DIM], P_yx)
    for i in range(width):
        for j in range(at):
            P[j, at + i] = P_yx[i, j]
        copy_into(P_yy[i], Q[i, :width])
    add_symmetric_product(P_yx, J, P_yy)
    feature = belief.feature[k]
    feature.slot = free_slot(belief.feature, k)
    copy_into(feature.mean, mean)
    feature.kind, feature.start, feature.misses = kind, at, 0
    feature.born, feature.seen, feature.crowded = state.frame, state.frame, -NEVER
    state.dim, state.count, state.serial = at + width, k + 1, state.serial + 1
    feature.serial = state.serial
    return k


@borrowing
def free_slot(entries: np.ndarray, count: int) -> int:
    """The lowest ``slot`` that none of the first ``count`` of the ``entries`` has."""
    slot, k = 0, 0
    while k < count:
        slot, k = (slot + 1, 0) if entries[k].slot == slot else (slot, k + 1)
    return slot


@compiled
def draw_bias(belief: Belief, K: int, k: int, var: float) -> None:
    """The pixel of fiducial ``k`` of ``K`` is off by a new bias, of variance ``var`` [px^2] an axis, as long as its
    template is the same: z = h + b + noise, b independent of all that is known.
    """
    state, P, dim = belief.state, belief.covariance, belief.state.dim
    if state.bias_dim == 0:
        rows = 2 * K
        rest, at = P[CAMERA_DIM:dim, :dim].copy(), CAMERA_DIM + rows
        P[at : dim + rows, :CAMERA_DIM] = rest[:, :CAMERA_DIM]
        P[:CAMERA_DIM, at : dim + rows] = rest[:, :CAMERA_DIM].T
        P[at : dim + rows, at : dim + rows] = rest[:, CAMERA_DIM:]
        P[CAMERA_DIM:at, : dim + rows] = 0.0
        P[: dim + rows, CAMERA_DIM:at] = 0.0
        state.bias[:] = 0.0
        state.bias_dim, state.dim = rows, dim + rows
        for j in range(state.count):
            belief.feature[j].start += rows
    for i in range(CAMERA_DIM + 2 * k, CAMERA_DIM + 2 * k + 2):
        P[i, : state.dim] = 0.0
        P[: state.dim, i] = 0.0
        P[i, i] = var
        state.bias[i - CAMERA_DIM] = 0.0


@borrowing
def remove_feature(belief: Belief, k: int) -> None:
    """Delete feature ``k``: marginalise it out, and close its gap."""
    start, width = belief.feature[k].start, KIND_DIM[belief.feature[k].kind]
    _close_gap(belief, start, width)
    belief.state.count -= 1
    for i in range(k, belief.state.count):
        belief.feature[i] = belief.feature[i + 1]


@borrowing
def remove_id(belief: Belief, id: int) -> None:
    """Delete the feature of that ``id``, if there is one."""
    for k in range(belief.state.count):
        if belief.feature[k].serial == id:
            remove_feature(belief, k)
            break


@compiled
def convert_to_point(belief: Belief, k: int) -> None:
    """Turn a RAY or INVERSE_DEPTH feature into a POINT through its Jacobian T (with a ray's depth variance)."""
    P, dim, feature = belief.covariance, belief.state.dim, belief.feature[k]
    at, width = feature.start, KIND_DIM[feature.kind]
    T, P_y, TP = np.empty((3, FEATURE_SIZE)), np.empty((3, 3)), np.zeros((3, dim))
    y = point_of(belief, k, T)
    add_product(T, P[at : at + width], TP)
    point_marginal(belief, k, P_y)
    for i in range(3):
        for j in range(dim):
            P[at + i, j] = TP[i, j]
            P[j, at + i] = TP[i, j]
    copy_block(0.5 * (P_y + P_y.T), P[at : at + 3, at : at + 3])
    feature.mean[:] = 0.0
    copy_into(feature.mean, y)
    feature.kind = POINT
    _close_gap(belief, at + 3, width - 3)


@borrowing
def _close_gap(belief: Belief, at: int, width: int) -> None:
    """Drop ``width`` covariance rows and columns from ``at`` on."""
    P, dim = belief.covariance, belief.state.dim - width
    for i in range(at, dim):
        copy_into(P[i], P[i + width, : dim + width])
    for i in range(dim):
        row = P[i]
        for j in range(at, dim):
            row[j] = row[j + width]
    for k in range(belief.state.count):
        if belief.feature[k].start >= at + width:
            belief.feature[k].start -= width
    belief.state.dim = dim
