"""Layout of the belief: where the camera and each feature stand in the mean and in the covariance.

The covariance is one fixed-capacity array whose leading ``dim`` rows and columns are in use: the camera's 12 tangent
dimensions, then the features from the oldest to the youngest, each with the dimensions of its kind. A feature lives in
a *slot* for all its life, whatever is deleted around it.

| kind | dimensions | parameters |
|---|---|---|
| POINT | 3 | world position |
| RAY | 5 | anchor (3), azimuth, elevation; its depth is a particle distribution |
| INVERSE_DEPTH | 6 | anchor (3), azimuth, elevation, inverse depth |
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from activeslam_gym import config
from activeslam_gym.compilation import part
from activeslam_gym.config import Scenario
from activeslam_gym.geometry import rotate_left, so3_left_jacobian
from activeslam_gym.linalg import copy_block, copy_into
from activeslam_gym.motion import (
    CAMERA_DIM,
    CAMERA_SIZE,
    D_ANGULAR,
    D_POSITION,
    D_ROTATION,
    D_VELOCITY,
    QUATERNION,
)

FREE, RAY, INVERSE_DEPTH, POINT = 0, 1, 2, 3
"""Kinds of a feature slot."""
KIND_DIM = (0, 5, 6, 3)
"""Tangent dimensions of each kind."""
FEATURE_SIZE = 6
SPARE_FEATURES = 13
"""Features beyond the number of landmarks for which there is room: those being initialised, false and double ones."""
CANDIDATE_CAPACITY = 32
MINIMUM_INVERSE_DEPTH = 0.01
"""Updates keep inverse depths above this [1/m]."""

DIM, FEATURES, SERIAL, FRAME = 0, 1, 2, 3
"""Entries of ``size``: rows in use, features in use, births so far, frames so far."""


class Belief(NamedTuple):
    """Arrays of one filter. F feature slots, D covariance rows, M particles, C birth candidates."""

    camera: np.ndarray
    """(13,) mean: position, quaternion, velocity, angular velocity."""
    covariance: np.ndarray
    """(D, D) joint covariance of the camera's tangent and the features."""
    feature: np.ndarray
    """(F, 6) means of the features, by slot."""
    kind: np.ndarray
    """(F,) FREE, RAY, INVERSE_DEPTH or POINT."""
    start: np.ndarray
    """(F,) first covariance row."""
    serial: np.ndarray
    """(F,) number of the birth, counted from 1: tells a slot's present feature from its former ones."""
    born: np.ndarray
    """(F,) frame of birth."""
    seen: np.ndarray
    """(F,) frame of the last match, or of the birth."""
    misses: np.ndarray
    """(F,) consecutive frames in which it should have been matched and was not."""
    order: np.ndarray
    """(F,) slots in use, oldest first."""
    depth: np.ndarray
    """(F, 2) mean [m] and variance [m^2] of the depth of a RAY."""
    particles: np.ndarray
    """(F, M, 2) depth [m] and weight of a RAY's particles."""
    weighed_at: np.ndarray
    """(F, 3) camera position at the RAY's last re-weighting [m]."""
    candidate_bearing: np.ndarray
    """(C, 3) world direction of an unexplained detection that may become a feature."""
    candidate_hits: np.ndarray
    """(C,) consecutive detections of it; 0: the entry is free."""
    size: np.ndarray
    """(4,) see DIM, FEATURES, SERIAL, FRAME."""


def feature_capacity(scenario: Scenario) -> int:
    """Feature slots of a scenario."""
    return scenario.landmark_count + SPARE_FEATURES


def covariance_capacity(scenario: Scenario) -> int:
    """Covariance rows of a scenario, in which every slot may hold the longest kind."""
    return CAMERA_DIM + max(KIND_DIM) * feature_capacity(scenario)


def empty_belief(scenario: Scenario) -> Belief:
    """A belief of the scenario's capacity; `reset_belief` gives it its prior."""
    features, rows = feature_capacity(scenario), covariance_capacity(scenario)
    particles = scenario.particle_count if scenario.initialisation == config.DEPTH_PARTICLES else 0
    return Belief(
        camera=np.zeros(CAMERA_SIZE),
        covariance=np.zeros((rows, rows)),
        feature=np.zeros((features, FEATURE_SIZE)),
        kind=np.zeros(features, np.int64),
        start=np.zeros(features, np.int64),
        serial=np.zeros(features, np.int64),
        born=np.zeros(features, np.int64),
        seen=np.zeros(features, np.int64),
        misses=np.zeros(features, np.int64),
        order=np.zeros(features, np.int64),
        depth=np.zeros((features, 2)),
        particles=np.zeros((features, particles, 2)),
        weighed_at=np.zeros((features, 3)),
        candidate_bearing=np.zeros((CANDIDATE_CAPACITY, 3)),
        candidate_hits=np.zeros(CANDIDATE_CAPACITY, np.int64),
        size=np.zeros(4, np.int64),
    )


def prior_variances(scenario: Scenario) -> np.ndarray:
    """Variances (12,) of the first camera's tangent."""
    stds = np.empty(CAMERA_DIM)
    stds[D_POSITION] = scenario.position_std
    stds[D_ROTATION] = scenario.orientation_std
    stds[D_VELOCITY] = scenario.velocity_std
    stds[D_ANGULAR] = scenario.angular_velocity_std
    return stds**2


def reset_belief(belief: Belief, scenario: Scenario) -> None:
    """Give the belief the scenario's prior: at the room's centre, at rest, facing +Z, no feature."""
    for array in belief:
        array[...] = 0
    belief.camera[QUATERNION] = (1.0, 0.0, 0.0, 0.0)
    belief.covariance[np.arange(CAMERA_DIM), np.arange(CAMERA_DIM)] = prior_variances(scenario)
    belief.size[DIM] = CAMERA_DIM


# Features as points -------------------------------------------------------------------------------------------------


@part
def bearing(azimuth: float, elevation: float) -> np.ndarray:
    """Rows (3, 3): the unit world direction m, dm/d azimuth, dm/d elevation.

    Azimuth turns about Y (up) from +Z towards +X, elevation rises from the horizontal: m = (sin a cos e, sin e,
    cos a cos e).
    """
    sin_a, cos_a, sin_e, cos_e = math.sin(azimuth), math.cos(azimuth), math.sin(elevation), math.cos(elevation)
    out = np.empty((3, 3))
    out[0, 0], out[0, 1], out[0, 2] = sin_a * cos_e, sin_e, cos_a * cos_e
    out[1, 0], out[1, 1], out[1, 2] = cos_a * cos_e, 0.0, -sin_a * cos_e
    out[2, 0], out[2, 1], out[2, 2] = -sin_a * sin_e, cos_e, -cos_a * sin_e
    return out


@part
def angles_of(h: np.ndarray, J: np.ndarray) -> tuple[float, float]:
    """Azimuth and elevation [rad] of a world direction ``h`` (3,) of any length; d(azimuth, elevation)/dh into ``J``.

    The inverse of `bearing`; ``J`` is (2, 3).
    """
    level_square = max(h[0] * h[0] + h[2] * h[2], 1e-12)
    level = math.sqrt(level_square)
    square = level_square + h[1] * h[1]
    J[0, 0], J[0, 1], J[0, 2] = h[2] / level_square, 0.0, -h[0] / level_square
    J[1, 0], J[1, 1], J[1, 2] = -h[0] * h[1] / (level * square), level / square, -h[2] * h[1] / (level * square)
    return math.atan2(h[0], h[2]), math.atan2(h[1], level)


@part
def feature_depth(belief: Belief, slot: int) -> float:
    """Distance [m] of a RAY or INVERSE_DEPTH feature from its anchor."""
    return belief.depth[slot, 0] if belief.kind[slot] == RAY else 1.0 / belief.feature[slot, 5]


@part
def point_of(belief: Belief, slot: int, T: np.ndarray) -> np.ndarray:
    """The feature as a world point (3,) [m]; its Jacobian by the feature's parameters goes into ``T`` (3, 6).

    y = anchor + depth m(azimuth, elevation); by inverse depth rho, dy/d rho = -m / rho^2. Columns beyond the kind's
    dimensions are not written.
    """
    feature = belief.feature[slot]
    for i in range(3):
        for j in range(3):
            T[i, j] = 1.0 if i == j else 0.0
    if belief.kind[slot] == POINT:
        return np.array((feature[0], feature[1], feature[2]))
    m = bearing(feature[3], feature[4])
    depth = feature_depth(belief, slot)
    y = np.empty(3)
    for i in range(3):
        y[i] = feature[i] + depth * m[0, i]
        T[i, 3], T[i, 4], T[i, 5] = depth * m[1, i], depth * m[2, i], -depth * depth * m[0, i]
    return y


@part
def point_marginal(belief: Belief, slot: int, P_y: np.ndarray) -> np.ndarray:
    """The feature as a world point (3,) [m]; its own covariance T P T^T goes into ``P_y`` (3, 3)."""
    T = np.empty((3, FEATURE_SIZE))
    y = point_of(belief, slot, T)
    at, width = belief.start[slot], KIND_DIM[belief.kind[slot]]
    rows = np.empty((3, width))
    _rows_times(T, belief.covariance[at:, at:], width, rows, width)
    _columns_times(rows, 0, width, T, P_y, 0)
    if belief.kind[slot] == RAY:
        _add_depth_variance(belief, slot, P_y)
    return y


@part
def depth_ratio(belief: Belief, slot: int) -> float:
    """sigma_depth / depth of a feature along its line of sight: from its anchor, or for a POINT from the camera."""
    if belief.kind[slot] == RAY:
        return math.sqrt(belief.depth[slot, 1]) / belief.depth[slot, 0]
    at = belief.start[slot]
    if belief.kind[slot] == INVERSE_DEPTH:
        return math.sqrt(max(belief.covariance[at + 5, at + 5], 0.0)) / belief.feature[slot, 5]
    square, variance = 0.0, 0.0
    for i in range(3):
        sight_i = belief.feature[slot, i] - belief.camera[i]
        square += sight_i * sight_i
        for j in range(3):
            sight_j = belief.feature[slot, j] - belief.camera[j]
            variance += sight_i * belief.covariance[at + i, at + j] * sight_j
    return math.sqrt(max(variance, 0.0)) / max(square, 1e-12)


@part
def point_belief(belief: Belief, points: np.ndarray, covariance: np.ndarray) -> int:
    """Present every feature as a point: the public belief. Returns the number n of features, oldest first.

    Writes ``points`` (>= n, 3) [m] and the leading 12 + 3 n rows and columns of ``covariance``: T P T^T with T the
    identity for the camera and for points, plus, for a ray, the variance of its particles along it.
    """
    n, dim, P = belief.size[FEATURES], belief.size[DIM], belief.covariance
    size = CAMERA_DIM + 3 * n
    half, Ts = np.empty((size, dim)), np.empty((n, 3, FEATURE_SIZE))
    at, to = 0, 0
    for k in range(n):  # camera and points stay as they are: whatever of them stands together is copied at once
        slot = belief.order[k]
        if belief.kind[slot] == POINT:
            for i in range(3):
                points[k, i] = belief.feature[slot, i]
        else:
            copy_into(points[k], point_of(belief, slot, Ts[k]))
            start, width, own = belief.start[slot], KIND_DIM[belief.kind[slot]], CAMERA_DIM + 3 * k
            copy_block(P[at:start, :dim], half[to:own])
            _rows_times(Ts[k], P[start:], width, half[own:], dim)
            at, to = start + width, own + 3
    copy_block(P[at:dim, :dim], half[to:])
    at, to = 0, 0
    for k in range(n):
        slot = belief.order[k]
        if belief.kind[slot] != POINT:
            start, width, own = belief.start[slot], KIND_DIM[belief.kind[slot]], CAMERA_DIM + 3 * k
            copy_block(half[:, at:start], covariance[:, to:own])
            _columns_times(half, start, width, Ts[k], covariance, own)
            if belief.kind[slot] == RAY:
                _add_depth_variance(belief, slot, covariance[own:, own:])
            at, to = start + width, own + 3
    copy_block(half[:, at:dim], covariance[:, to:size])
    return n


@part
def _add_depth_variance(belief: Belief, slot: int, block: np.ndarray) -> None:
    """Add to ``block`` (>= 3, >= 3) the variance of a ray's particles along the ray."""
    m = bearing(belief.feature[slot, 3], belief.feature[slot, 4])
    for i in range(3):
        for j in range(3):
            block[i, j] += belief.depth[slot, 1] * m[0, i] * m[0, j]


@part
def _rows_times(T: np.ndarray, rows: np.ndarray, width: int, out: np.ndarray, n: int) -> None:
    """out[:3, :n] = T[:, :width] rows[:width, :n]; the leading three columns of T are the identity."""
    for i in range(3):
        to, source = out[i], rows[i]
        for j in range(n):
            to[j] = source[j]
        for k in range(3, width):
            factor, source = T[i, k], rows[k]
            for j in range(n):
                to[j] += factor * source[j]


@part
def _columns_times(half: np.ndarray, at: int, width: int, T: np.ndarray, out: np.ndarray, to: int) -> None:
    """out[:, to:to+3] = half[:, at:at+width] T[:, :width]^T; the leading three columns of T are the identity."""
    for i in range(half.shape[0]):
        source, target = half[i], out[i]
        for j in range(3):
            value = source[at + j]
            for k in range(3, width):
                value += source[at + k] * T[j, k]
            target[to + j] = value


# Change of the map --------------------------------------------------------------------------------------------------


@part
def room_for(belief: Belief, width: int) -> bool:
    """Whether one more feature of ``width`` dimensions fits."""
    return belief.size[FEATURES] < belief.kind.shape[0] and belief.size[DIM] + width <= belief.covariance.shape[0]


@part
def append_feature(belief: Belief, kind: int, mean: np.ndarray, J: np.ndarray, Q: np.ndarray) -> int:
    """Add a feature y = g(camera, rest) and return its slot; the caller has asked `room_for` it.

    ``mean`` (6,); ``J`` (width, 12) is dy/d camera tangent; ``Q`` (>= width, >= width) the covariance of what does not
    come from the camera: P_yx = J P_cx, P_yy = J P_cc J^T + Q.
    """
    slot = 0
    while belief.kind[slot] != FREE:
        slot += 1
    P, at, width = belief.covariance, belief.size[DIM], J.shape[0]
    for i in range(width):
        for j in range(at):
            value = 0.0
            for k in range(CAMERA_DIM):
                value += J[i, k] * P[k, j]
            P[at + i, j] = value
            P[j, at + i] = value
    for i in range(width):
        for j in range(i + 1):
            value = Q[i, j]
            for k in range(CAMERA_DIM):
                value += P[at + i, k] * J[j, k]
            P[at + i, at + j] = value
            P[at + j, at + i] = value
    for i in range(FEATURE_SIZE):
        belief.feature[slot, i] = mean[i]
    belief.kind[slot] = kind
    belief.start[slot] = at
    belief.misses[slot] = 0
    belief.born[slot] = belief.size[FRAME]
    belief.seen[slot] = belief.size[FRAME]
    belief.order[belief.size[FEATURES]] = slot
    belief.size[DIM] += width
    belief.size[FEATURES] += 1
    belief.size[SERIAL] += 1
    belief.serial[slot] = belief.size[SERIAL]
    return slot


@part
def remove_feature(belief: Belief, slot: int) -> None:
    """Forget a feature (marginalise it out) and free its slot."""
    _close_gap(belief, belief.start[slot], KIND_DIM[belief.kind[slot]])
    belief.kind[slot] = FREE
    n = belief.size[FEATURES]
    at = 0
    while belief.order[at] != slot:
        at += 1
    for i in range(at, n - 1):
        belief.order[i] = belief.order[i + 1]
    belief.size[FEATURES] = n - 1


@part
def convert_to_point(belief: Belief, slot: int) -> None:
    """Turn a RAY or INVERSE_DEPTH feature into a POINT through its Jacobian (with a ray's depth variance)."""
    P, dim = belief.covariance, belief.size[DIM]
    at, width = belief.start[slot], KIND_DIM[belief.kind[slot]]
    T, rows, block = np.empty((3, FEATURE_SIZE)), np.empty((3, dim)), np.empty((3, 3))
    point_of(belief, slot, T)
    _rows_times(T, P[at:], width, rows, dim)
    y = point_marginal(belief, slot, block)
    for i in range(3):
        for j in range(dim):
            P[at + i, j] = rows[i, j]
            P[j, at + i] = rows[i, j]
    for i in range(3):
        for j in range(3):
            P[at + i, at + j] = 0.5 * (block[i, j] + block[j, i])
    for i in range(FEATURE_SIZE):
        belief.feature[slot, i] = y[i] if i < 3 else 0.0
    belief.kind[slot] = POINT
    _close_gap(belief, at + 3, width - 3)


@part
def _close_gap(belief: Belief, at: int, width: int) -> None:
    """Drop ``width`` covariance rows and columns from ``at`` on."""
    P, dim = belief.covariance, belief.size[DIM] - width
    for i in range(at, dim):
        for j in range(dim + width):
            P[i, j] = P[i + width, j]
    for i in range(dim):
        for j in range(at, dim):
            P[i, j] = P[i, j + width]
    for k in range(belief.size[FEATURES]):
        slot = belief.order[k]
        if belief.start[slot] >= at + width:
            belief.start[slot] -= width
    belief.size[DIM] = dim


# The mean on its manifold -------------------------------------------------------------------------------------------


@part
def shift_mean(belief: Belief, delta: np.ndarray) -> None:
    """mean ⊞ ``delta`` (dim,): the camera's rotation is perturbed on the left, in the world frame."""
    x = belief.camera
    for i in range(3):
        x[i] += delta[i]
        x[7 + i] += delta[6 + i]
        x[10 + i] += delta[9 + i]
    q = rotate_left(delta[D_ROTATION], x[QUATERNION])
    for i in range(4):
        x[3 + i] = q[i]
    for k in range(belief.size[FEATURES]):
        slot = belief.order[k]
        at = belief.start[slot]
        for i in range(KIND_DIM[belief.kind[slot]]):
            belief.feature[slot, i] += delta[at + i]
        if belief.kind[slot] == INVERSE_DEPTH:
            belief.feature[slot, 5] = max(belief.feature[slot, 5], MINIMUM_INVERSE_DEPTH)


@part
def recentre(belief: Belief, delta: np.ndarray) -> None:
    """Express the covariance in the tangent of the mean just shifted by ``delta`` (dim,): P = M P M^T.

    M keeps what no bearing can tell, a turn of camera and map together, what it is. Such a turn a moves a point f by
    a x f; before the shift that is a x f, and after it has to be a x (f + df), so every world vector gets
    + dtheta x df. With the plain tangent (M = I) the direction would change with the estimate, and the filter would
    gain orientation that it never measured. It is the covariance of the right-invariant filter in these coordinates
    (Barrau and Bonnabel, *An EKF-SLAM algorithm with consistency properties*, 2015). The rotation's own rows follow
    from Exp(dtheta) = Exp(dtheta+) Exp(delta_theta), dtheta+ = J_l(delta_theta) (dtheta - delta_theta): the modern form
    of the paper's Jacobian of the quaternion's normalisation.
    """
    _turn_with_rotation(belief, _turning(belief, delta))
    _recentre_rotation(belief, delta)


@part
def _turning(belief: Belief, delta: np.ndarray) -> np.ndarray:
    """E (3, dim), M = I + E^T on the rotation's columns: how the shift changed what a turn does to each coordinate."""
    E = np.zeros((3, belief.size[DIM]))
    for start in (0, 6, 9):
        _cross(delta, start, E)
    for k in range(belief.size[FEATURES]):
        slot = belief.order[k]
        at = belief.start[slot]
        _cross(delta, at, E)
        if belief.kind[slot] != POINT:
            azimuth, elevation = belief.feature[slot, 3], belief.feature[slot, 4]
            _turn_angles(azimuth, elevation, 1.0, at + 3, E)
            _turn_angles(azimuth - delta[at + 3], elevation - delta[at + 4], -1.0, at + 3, E)
    return E


@part
def _cross(delta: np.ndarray, at: int, E: np.ndarray) -> None:
    """Columns of a world vector shifted by d: a x d = E^T a."""
    x, y, z = delta[at], delta[at + 1], delta[at + 2]
    E[1, at], E[2, at] = z, -y
    E[0, at + 1], E[2, at + 1] = -z, x
    E[0, at + 2], E[1, at + 2] = y, -x


@part
def _turn_angles(azimuth: float, elevation: float, sign: float, at: int, E: np.ndarray) -> None:
    """Add ``sign`` times d(azimuth, elevation) of a direction by a turn of the world, the derivative of a x m."""
    sin_a, cos_a, tan_e = math.sin(azimuth), math.cos(azimuth), math.tan(elevation)
    E[0, at] -= sign * tan_e * sin_a
    E[1, at] += sign
    E[2, at] -= sign * tan_e * cos_a
    E[0, at + 1] -= sign * cos_a
    E[2, at + 1] += sign * sin_a


@part
def _turn_with_rotation(belief: Belief, E: np.ndarray) -> None:
    """P + E^T B + B^T E with B = P_theta + P_theta,theta E / 2, which is (I + E^T) P (I + E^T)^T."""
    P, dim = belief.covariance, belief.size[DIM]
    B = np.empty((3, dim))
    for i in range(3):
        a, b, c = 0.5 * P[3 + i, 3], 0.5 * P[3 + i, 4], 0.5 * P[3 + i, 5]
        for j in range(dim):
            B[i, j] = P[3 + i, j] + a * E[0, j] + b * E[1, j] + c * E[2, j]
    for i in range(dim):
        row, e0, e1, e2, b0, b1, b2 = P[i], E[0, i], E[1, i], E[2, i], B[0, i], B[1, i], B[2, i]
        for j in range(dim):
            row[j] += (e0 * B[0, j] + b0 * E[0, j]) + (e1 * B[1, j] + b1 * E[1, j]) + (e2 * B[2, j] + b2 * E[2, j])


@part
def _recentre_rotation(belief: Belief, delta: np.ndarray) -> None:
    """P_theta = J_l P_theta, rows and columns."""
    P, dim = belief.covariance, belief.size[DIM]
    J = so3_left_jacobian(delta[D_ROTATION])
    theta = np.empty((3, dim))
    for i in range(3):
        for j in range(dim):
            theta[i, j] = J[i, 0] * P[3, j] + J[i, 1] * P[4, j] + J[i, 2] * P[5, j]
    for i in range(3):
        for j in range(dim):
            P[3 + i, j] = theta[i, j]
            P[j, 3 + i] = theta[i, j]
    for i in range(3):
        for j in range(i + 1):
            value = theta[i, 3] * J[j, 0] + theta[i, 4] * J[j, 1] + theta[i, 5] * J[j, 2]
            P[3 + i, 3 + j] = value
            P[3 + j, 3 + i] = value
