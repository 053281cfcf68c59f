"""Layout of the belief: where the camera and each feature stand in the mean and in the covariance.

The covariance is one fixed-capacity array whose leading ``dim`` rows and columns are in use: the camera's 12 tangent
dimensions, then, if there are any, the biases of the fiducials' pixels, two each, and then the features from the oldest
to the youngest, each with the dimensions of its kind.

| kind | dimensions | parameters |
|---|---|---|
| POINT | 3 | world position |
| RAY | 5 | anchor (3), azimuth, elevation; its depth is a particle distribution |
| INVERSE_DEPTH | 6 | anchor (3), azimuth, elevation, inverse depth |

A feature has an id, the number of its initialisation, which no other feature ever has; and a slot for life, by which
its particles know it. The ids of fiducials are negative, see `fiducial_id`.
"""

import math
from typing import NamedTuple

import numpy as np

from activeslam_gym import config
from activeslam_gym.config import Scenario
from activeslam_gym.kernels import Record, borrowed, borrowing, compiled, inlined, record
from activeslam_gym.linalg import add_product, copy_block, copy_into
from activeslam_gym.motion import (
    CAMERA_DIM,
    CAMERA_SIZE,
    D_ANGULAR,
    D_POSITION,
    D_ROTATION,
    D_VELOCITY,
    POSITION,
    QUATERNION,
)
from activeslam_gym.slam.estimate import COMPILED, EstimateArrays

INVARIANT, PLAIN = 0, 1
"""Variants of the compiled estimators, in their order: the default, and its plain tangent."""
RAY, INVERSE_DEPTH, POINT = 1, 2, 3  # kinds of features
KIND_DIM = (0, 5, 6, 3)  # tangent dimensions of each kind
FEATURE_SIZE = 6
ANCHOR, AZIMUTH, ELEVATION, RHO = slice(0, 3), 3, 4, 5  # parameters of a RAY or INVERSE_DEPTH feature
SPARE_FEATURES = 13
"""Features beyond the number of landmarks for which there is room: those being initialised, false and double ones."""
TRACK_CAPACITY = 32
MOST_BIASED = 4  # fiducials whose pixels may have biases

STATE = record(
    camera=("f8", CAMERA_SIZE),  # mean: position, quaternion, velocity, angular velocity
    bias=("f8", 2 * MOST_BIASED),  # mean: u and v of each fiducial's pixel [px]; see `appearance.draw_bias`
    bias_dim="i8",  # covariance rows of the biases: two for each fiducial, or 0
    dim="i8",  # covariance rows in use
    count="i8",  # features in use
    initialised="i8",  # features so far
    frame="i8",  # frames so far
    variant="i8",  # INVARIANT or PLAIN: the tangent of the estimator
    fiducial_nis="f8",  # running mean of the fiducials' normalised innovations squared; see `restart`
)
"""What a belief holds beside its features and its covariance."""

NEVER = 2**62  # frames ago

FEATURE = record(
    mean=("f8", FEATURE_SIZE),
    kind="i8",  # RAY, INVERSE_DEPTH or POINT
    start="i8",  # first covariance row
    id="i8",  # number of its initialisation, counted from 1
    slot="i8",
    born="i8",  # frame of initialisation
    seen="i8",  # frame of the last match, or of the initialisation
    crowded="i8",  # the last frame in which two unexplained detections were in its gate
    misses="i8",  # consecutive frames in which it should have been matched and was not
    missed_at=("f8", 3),  # where the camera was at the last of them that counted [m]
    depth="f8",  # of a RAY: mean of its particles [m]
    depth_var="f8",  # and their variance [m^2]
    weighed_at=("f8", 3),  # of a RAY: camera position at its last re-weighting [m]
)

TRACK = record(
    direction=("f8", 3),  # in the world, of any length
    hits="i8",  # consecutive detections; 0: free
)
"""An unexplained detection that is followed, and may become a feature."""


Direction = tuple[float, float, float]


class Belief(NamedTuple):
    """The state of the compiled filter; everything else reads its `Estimate`.

    F slots, D covariance rows, M particles, T tracks.
    """

    state: Record  # STATE
    feature: np.ndarray  # (F,) FEATURE, of which the leading ``state.count`` are in use, oldest first
    covariance: np.ndarray  # (D, D) joint covariance of the camera's tangent and the features
    particles: np.ndarray  # (F, M, 2) depth [m] and weight of a RAY's particles, by slot
    track: np.ndarray  # (T,) TRACK


@inlined
def belief_at(beliefs, i):  # type: ignore[no-untyped-def]
    """Belief ``i`` of a batch, whose arrays have a leading axis: views."""
    return Belief(
        beliefs.state[i],
        borrowed(beliefs.feature[i]),
        borrowed(beliefs.covariance[i]),
        borrowed(beliefs.particles[i]),
        borrowed(beliefs.track[i]),
    )


def feature_capacity(scenario: Scenario) -> int:
    """Features that a belief of the scenario can hold."""
    return scenario.landmark_count + SPARE_FEATURES


def empty_beliefs(scenario: Scenario, count: int) -> Belief:
    """``count`` beliefs of the scenario's capacity, with a leading axis; `reset_belief` gives one of them its prior."""
    features = feature_capacity(scenario)
    rows = CAMERA_DIM + 2 * MOST_BIASED + max(KIND_DIM) * features  # all may be of the longest kind
    particles = scenario.particle_count if scenario.initialisation == config.DEPTH_PARTICLES else 0
    state = np.zeros(count, STATE)
    state["variant"] = COMPILED.index(scenario.estimator) if scenario.estimator in COMPILED else INVARIANT
    return Belief(
        state=state,
        feature=np.zeros((count, features), FEATURE),
        covariance=np.zeros((count, rows, rows)),
        particles=np.zeros((count, features, particles, 2)),
        track=np.zeros((count, TRACK_CAPACITY), TRACK),
    )


def reset_belief(belief: Belief, camera: np.ndarray, covariance: np.ndarray) -> None:
    """Give the belief its prior: a ``camera`` (13,) with that ``covariance`` (12, 12), and no feature."""
    belief.state.camera[:] = camera
    belief.state.dim, belief.state.count, belief.state.initialised, belief.state.frame = CAMERA_DIM, 0, 0, 0
    belief.state.fiducial_nis, belief.state.bias_dim = 1.0, 0
    belief.covariance[...] = 0.0
    belief.covariance[:CAMERA_DIM, :CAMERA_DIM] = covariance
    belief.track["hits"] = 0


def start_of(scenario: Scenario) -> tuple[np.ndarray, np.ndarray]:
    """The scenario's prior: (13,) at the room's centre, at rest, facing +Z, and its covariance (12, 12)."""
    camera, stds = np.zeros(CAMERA_SIZE), np.empty(CAMERA_DIM)
    camera[QUATERNION] = (1.0, 0.0, 0.0, 0.0)
    stds[D_POSITION], stds[D_ROTATION] = scenario.position_std, scenario.orientation_std
    stds[D_VELOCITY], stds[D_ANGULAR] = scenario.velocity_std, scenario.angular_velocity_std
    return camera, np.diag(stds**2)


@compiled
def fiducial_id(k: int) -> int:
    """The id of the fiducial ``k``: -1, -2, …"""
    return -1 - k


@borrowing
def bearing(azimuth: float, elevation: float) -> tuple[Direction, Direction, Direction]:
    """The unit world direction m, dm/d azimuth and dm/d elevation.

    Azimuth turns about Y (up) from +Z towards +X, elevation rises from the horizontal: m = (sin a cos e, sin e,
    cos a cos e).
    """
    sin_a, cos_a, sin_e, cos_e = math.sin(azimuth), math.cos(azimuth), math.sin(elevation), math.cos(elevation)
    return (
        (sin_a * cos_e, sin_e, cos_a * cos_e),
        (cos_a * cos_e, 0.0, -sin_a * cos_e),
        (-sin_a * sin_e, cos_e, -cos_a * sin_e),
    )


@borrowing
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


@borrowing
def place_of(feature: Record) -> Direction:
    """The world point [m] at the mean of a POINT or an INVERSE_DEPTH feature."""
    mean = feature.mean
    if feature.kind == POINT:
        return mean[0], mean[1], mean[2]
    m, rho = bearing(mean[AZIMUTH], mean[ELEVATION])[0], mean[RHO]
    return mean[0] + m[0] / rho, mean[1] + m[1] / rho, mean[2] + m[2] / rho


@compiled
def point_of(belief: Belief, k: int, T: np.ndarray) -> np.ndarray:
    """Feature ``k`` as a world point (3,) [m]; its Jacobian by the feature's parameters goes into ``T`` (3, 6).

    y = anchor + depth m(azimuth, elevation); by inverse depth rho, dy/d rho = -m / rho^2. Columns beyond the kind's
    dimensions are not written.
    """
    feature, y = belief.feature[k], np.empty(3)
    for i in range(3):
        y[i] = feature.mean[i]
        for j in range(3):
            T[i, j] = 1.0 if i == j else 0.0
    if feature.kind != POINT:
        m = bearing(feature.mean[AZIMUTH], feature.mean[ELEVATION])
        depth = feature.depth if feature.kind == RAY else 1.0 / feature.mean[RHO]
        for i in range(3):
            y[i] += depth * m[0][i]
            T[i, AZIMUTH], T[i, ELEVATION], T[i, RHO] = depth * m[1][i], depth * m[2][i], -depth * depth * m[0][i]
    return y


@compiled
def point_marginal(belief: Belief, k: int, P_y: np.ndarray) -> np.ndarray:
    """Feature ``k`` as a world point (3,) [m]; its own covariance T P T^T goes into ``P_y`` (3, 3)."""
    T = np.empty((3, FEATURE_SIZE))
    y = point_of(belief, k, T)
    at, width = belief.feature[k].start, KIND_DIM[belief.feature[k].kind]
    rows = np.zeros((3, width))
    add_product(T, belief.covariance[at : at + width, at:], rows)
    _columns_times(rows, 0, width, T, P_y, 0)
    _add_depth_variance(belief, k, P_y, 0)
    return y


@borrowing
def depth_ratio(belief: Belief, k: int) -> float:
    """sigma_depth / depth of feature ``k`` along its line of sight: from its anchor, or for a POINT from the camera."""
    feature, P = belief.feature[k], belief.covariance
    if feature.kind == RAY:
        return math.sqrt(feature.depth_var) / feature.depth
    if feature.kind == INVERSE_DEPTH:
        rho_var = P[feature.start + RHO, feature.start + RHO]
        return math.sqrt(max(rho_var, 0.0)) / feature.mean[RHO]
    square, variance = 0.0, 0.0
    camera = belief.state.camera[POSITION]
    for i in range(3):
        sight_i = feature.mean[i] - camera[i]
        square += sight_i * sight_i
        for j in range(3):
            variance += sight_i * P[feature.start + i, feature.start + j] * (feature.mean[j] - camera[j])
    return math.sqrt(max(variance, 0.0)) / max(square, 1e-12)


@compiled
def positions_of(belief: Belief) -> np.ndarray:
    """Every feature as a point (n, 3) [m], oldest first, without a covariance."""
    n, T = belief.state.count, np.empty((3, FEATURE_SIZE))
    points = np.empty((n, 3))
    for k in range(n):
        copy_into(points[k], point_of(belief, k, T))
    return points


@compiled
def mapped_of(belief: Belief, mapped_depth_ratio: float) -> np.ndarray:
    """(n,) whether the deviation of each feature's depth over its depth is under ``mapped_depth_ratio``."""
    out = np.empty(belief.state.count, np.bool_)
    for k in range(out.shape[0]):
        out[k] = depth_ratio(belief, k) < mapped_depth_ratio
    return out


@compiled
def write_estimate(belief: Belief, mapped_depth_ratio: float, estimate: EstimateArrays) -> None:
    """Present every feature as a point: the public belief, with the joint covariance T P T^T of camera and points.

    T is the identity for the camera and for points; a ray has the variance of its particles along it, too. A landmark
    is mapped where the deviation of its depth over its depth is under ``mapped_depth_ratio``.
    """
    write_outline(belief, estimate)
    n, dim, P, covariance = belief.state.count, belief.state.dim, belief.covariance, estimate.covariance
    T, TP = np.empty((n, 3, FEATURE_SIZE)), np.zeros((3, dim))
    for k in range(n):
        landmark = estimate.landmark[k]
        copy_into(landmark.point, point_of(belief, k, T[k]))
        landmark.converted = belief.feature[k].kind == POINT
        landmark.mapped = depth_ratio(belief, k) < mapped_depth_ratio
    _copy_identity_part(belief, covariance)
    for k in range(n):
        feature, own = belief.feature[k], CAMERA_DIM + 3 * k
        if feature.kind == POINT:
            continue
        TP[:] = 0.0
        width = KIND_DIM[feature.kind]
        add_product(T[k], P[feature.start : feature.start + width], TP)
        copy_block(TP[:, :CAMERA_DIM], covariance[own : own + 3])
        for m in range(n):  # T_k P T_m^T
            other, to = belief.feature[m], CAMERA_DIM + 3 * m
            _columns_times(TP, other.start, KIND_DIM[other.kind], T[m], covariance[own : own + 3], to)
        for i in range(own, own + 3):
            for j in range(CAMERA_DIM + 3 * n):
                covariance[j, i] = covariance[i, j]
        _add_depth_variance(belief, k, covariance, own)
    estimate.state.whole = True


@borrowing
def write_outline(belief: Belief, estimate: EstimateArrays) -> None:
    """Write the camera, and which landmarks there are."""
    copy_into(estimate.state.camera, belief.state.camera)
    estimate.state.count, estimate.state.whole = belief.state.count, False
    for k in range(belief.state.count):
        feature, landmark = belief.feature[k], estimate.landmark[k]
        landmark.id, landmark.located = feature.id, feature.kind != RAY


@compiled
def write_points(belief: Belief, known: np.ndarray, estimate: EstimateArrays) -> None:
    """Write the point and the covariance by itself of each landmark that is not ``known`` (n,)."""
    P_y = np.empty((3, 3))
    for k in range(belief.state.count):
        if not known[k]:
            at = CAMERA_DIM + 3 * k
            copy_into(estimate.landmark[k].point, point_marginal(belief, k, P_y))
            copy_block(P_y, estimate.covariance[at : at + 3, at : at + 3])


@borrowing
def _copy_identity_part(belief: Belief, covariance: np.ndarray) -> None:
    """Copy the rows and columns of camera and points, whatever of them stands together at once."""
    P, n = belief.covariance, belief.state.count
    for a in range(-1, n):
        if a >= 0 and belief.feature[a].kind != POINT:
            continue
        start, own, rows = (0, 0, CAMERA_DIM) if a < 0 else (belief.feature[a].start, CAMERA_DIM + 3 * a, 3)
        copy_block(P[start : start + rows, :CAMERA_DIM], covariance[own : own + rows])
        at, to = CAMERA_DIM + belief.state.bias_dim, CAMERA_DIM
        for k in range(n + 1):
            if k == n or belief.feature[k].kind != POINT:
                stop = belief.feature[k].start if k < n else belief.state.dim
                copy_block(P[start : start + rows, at:stop], covariance[own : own + rows, to:])
                if k < n:
                    at, to = stop + KIND_DIM[belief.feature[k].kind], CAMERA_DIM + 3 * (k + 1)


@compiled
def _add_depth_variance(belief: Belief, k: int, covariance: np.ndarray, own: int) -> None:
    """Add to the block of ``covariance`` from ``own`` on the variance of the particles along ``k``, if it is a ray."""
    feature = belief.feature[k]
    if feature.kind == RAY:
        m = bearing(feature.mean[AZIMUTH], feature.mean[ELEVATION])
        for i in range(3):
            for j in range(3):
                covariance[own + i, own + j] += feature.depth_var * m[0][i] * m[0][j]


@borrowing
def _columns_times(rows: np.ndarray, at: int, width: int, T: np.ndarray, out: np.ndarray, to: int) -> None:
    """out[:, to:to+3] = rows[:, at:at+width] T[:, :width]^T; the leading three columns of T are the identity."""
    for i in range(rows.shape[0]):
        source, target = rows[i], out[i]
        for j in range(3):
            value = source[at + j]
            for k in range(3, width):
                value += source[at + k] * T[j, k]
            target[to + j] = value
