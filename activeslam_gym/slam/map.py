"""The map: from unexplained detections to features; a feature joins it, turns into a point, or leaves it.

Only `add_landmark` and `promote` know which of the two initialisers is at work.
"""

import math

import numpy as np

from activeslam_gym import config
from activeslam_gym.camera import (
    camera_from_world,
    distance_between,
    pixel_from_camera_point,
    ray_from_pixel,
    ray_jacobian,
    world_from_camera,
)
from activeslam_gym.config import Scenario
from activeslam_gym.geometry import rotation_matrix, skew
from activeslam_gym.kernels import Record, borrowing, compiled, constants
from activeslam_gym.linalg import add_product, add_symmetric_product, copy_block, copy_into, product
from activeslam_gym.motion import CAMERA_DIM, D_ROTATION, POSITION, QUATERNION
from activeslam_gym.slam.belief import (
    AZIMUTH,
    ELEVATION,
    FEATURE_SIZE,
    INVERSE_DEPTH,
    KIND_DIM,
    NEVER,
    POINT,
    RAY,
    RHO,
    Belief,
    angles_of,
    bearing,
    depth_ratio,
    place_of,
    point_marginal,
    point_of,
)
from activeslam_gym.slam.depth_particles import scatter_particles
from activeslam_gym.slam.detection import NEW, WAITS
from activeslam_gym.slam.sight import INSIDE, Sight

TRACK_RADIUS_PX = 15.0
"""A track is followed to the nearest new detection within this distance of where its direction projects [px]."""

INITIALISATION, initialisation_of = constants(
    Scenario(),
    new_feature_detections="i8",
    inverse_depth=lambda s: s.initialisation == config.INVERSE_DEPTH,  # features begin as INVERSE_DEPTH, or as RAY
    rho_mean=lambda s: s.inverse_depth_mean,  # first inverse depth [1/m]
    rho_std=lambda s: s.inverse_depth_std,
    # an INVERSE_DEPTH feature out of sight for longer is deleted:
    memory_frames=lambda s: round(s.inverse_depth_memory / s.frame_time),
    linearity_threshold="f8",  # linearity index under which it becomes a point
    mapped_depth_ratio="f8",
    ray_capacity="i8",
    ray_age_frames=lambda s: round(s.ray_age / s.frame_time),  # a RAY that is older is deleted
    maximum_misses="i8",
    miss_spacing="f8",  # misses from places nearer to each other count once [m]
)
"""Constants of initialisations, conversions and deletions; see the fields of `Scenario`."""


# Tracks -------------------------------------------------------------------------------------------------------------


@compiled
def initialise(models: Record, belief: Belief, detections: np.ndarray, counts: Record) -> None:
    """Initialise features at detections (M,) that nothing explained for several frames; sets their ``match``."""
    model = models.filter
    for i in follow_tracks(models.lens, model.initialisation, belief, detections):
        one = detections[i]
        one.match = add_landmark(models.lens, model.initialisation, model.particles, belief, one.pixel, one.R)
        counts.initialised += one.match != NEW


@compiled
def follow_tracks(lens: Record, model: Record, belief: Belief, detections: np.ndarray) -> np.ndarray:
    """Follow detections (M,) that nothing explains; returns the indices of those that now deserve a feature.

    A track is a world direction (its parallax in a frame is small), dropped at the first frame without a NEW detection
    near it.
    """
    R_WC, tracks = rotation_matrix(belief.state.camera[QUATERNION]), belief.track
    taken, ripe, count = detections["match"] != NEW, np.empty(detections.shape[0], np.int64), 0
    for t in range(tracks.shape[0]):
        if tracks[t].hits == 0:
            continue
        i = _nearest_detection(lens, R_WC, tracks[t].direction, detections, taken)
        if i < 0:
            tracks[t].hits = 0
            continue
        taken[i] = True
        tracks[t].hits += 1
        copy_into(tracks[t].direction, direction_of(lens, R_WC, detections[i].pixel))
        if tracks[t].hits >= model.new_feature_detections:
            ripe[count] = i
            count += 1
            tracks[t].hits = 0
    t = 0
    for i in range(detections.shape[0]):
        if model.new_feature_detections == 1 and not taken[i]:
            ripe[count] = i
            count += 1
            continue
        while t < tracks.shape[0] and tracks[t].hits > 0:
            t += 1
        if t < tracks.shape[0] and not taken[i]:
            tracks[t].hits = 1
            copy_into(tracks[t].direction, direction_of(lens, R_WC, detections[i].pixel))
    return ripe[:count]


@compiled
def direction_of(lens: Record, R_WC: np.ndarray, pixel: np.ndarray) -> np.ndarray:
    """World direction (3,) of a pixel, of any length: R r(z)."""
    return np.array(world_from_camera(R_WC, ray_from_pixel(lens, pixel)))


@compiled
def _nearest_detection(
    lens: Record, R_WC: np.ndarray, direction: np.ndarray, detections: np.ndarray, taken: np.ndarray
) -> int:
    """Index of the free detection nearest to where ``direction`` projects, within the radius, or -1."""
    z, h = np.empty(2), (direction[0], direction[1], direction[2])
    if not pixel_from_camera_point(lens, camera_from_world(R_WC, h), z):
        return -1
    best, nearest = -1, TRACK_RADIUS_PX**2
    for i in range(detections.shape[0]):
        pixel = detections[i].pixel
        square = (pixel[0] - z[0]) ** 2 + (pixel[1] - z[1]) ** 2
        if not taken[i] and square < nearest:
            best, nearest = i, square
    return best


# Initialisation -----------------------------------------------------------------------------------------------------


@compiled
def add_landmark(lens: Record, model: Record, rays: Record, belief: Belief, pixel: np.ndarray, R: np.ndarray) -> int:
    """Add the feature seen at ``pixel`` (2,) with noise ``R`` (2, 2); returns its id, or NEW if there is no room.

    Both kinds begin with the anchor and the direction of the line of sight; inverse depth adds a Gaussian rho,
    independent of the rest. ``rays``: PARTICLES.
    """
    kind, rays_in_use = INVERSE_DEPTH if model.inverse_depth else RAY, 0
    width = KIND_DIM[kind]
    for k in range(belief.state.count):
        rays_in_use += belief.feature[k].kind == RAY
    if not room_for(belief, width) or (kind == RAY and rays_in_use >= model.ray_capacity):
        return NEW
    mean, J_x, Q = line_of_sight(lens, belief.state.camera, pixel, R)
    mean[RHO] = model.rho_mean
    Q[RHO, RHO] = model.rho_std**2
    k = append_feature(belief, kind, mean, J_x[:width], Q)
    if kind == RAY:
        scatter_particles(rays, belief, k)
    return belief.feature[k].id


@compiled
def line_of_sight(
    lens: Record, camera: np.ndarray, pixel: np.ndarray, R: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean (6,), Jacobian by the camera's tangent (6, 12) and covariance by the pixel (6, 6) of a new line of sight.

    From ``camera`` (13,), through the ``pixel`` (2,) with noise ``R`` (2, 2).

    h = R_WC r(z): dh/d dtheta = -[h]x, dh/dz = R_WC dr/dz; the angles follow by d(azimuth, elevation)/dh. The row of
    the inverse depth is zero.
    """
    R_WC = rotation_matrix(camera[QUATERNION])
    h, J_h, mean = direction_of(lens, R_WC, pixel), np.empty((2, 3)), np.zeros(FEATURE_SIZE)
    copy_into(mean, camera[POSITION])
    mean[AZIMUTH], mean[ELEVATION] = angles_of(h, J_h)
    J_turn = product(J_h, skew(h))
    J_z = product(J_h, product(R_WC, ray_jacobian(lens, pixel)))
    J_x, Q = np.zeros((FEATURE_SIZE, CAMERA_DIM)), np.zeros((FEATURE_SIZE, FEATURE_SIZE))
    by_turn = J_x[AZIMUTH : AZIMUTH + 2, D_ROTATION]
    for i in range(3):
        J_x[i, i] = 1.0
        for a in range(2):
            by_turn[a, i] = -J_turn[a, i]
    for a in range(2):
        for b in range(2):
            for i in range(2):
                for j in range(2):
                    Q[AZIMUTH + a, AZIMUTH + b] += J_z[a, i] * R[i, j] * J_z[b, j]
    return mean, J_x, Q


# Conversion and deletion --------------------------------------------------------------------------------------------


@compiled
def convert_and_delete(model: Record, belief: Belief, counts: Record) -> None:
    """After an update: convert the features that are ready to points, and delete those missed too often or outdated.

    Outdated is a RAY that is too old, and an INVERSE_DEPTH that was out of sight for too long: the long ellipse of a
    vague depth, met again after seconds, takes another landmark's detection that lies on it, and that makes it a point,
    overconfidently wrong.
    """
    counts.conversions += promote(model, belief)
    for k in range(belief.state.count - 1, -1, -1):
        feature = belief.feature[k]
        if feature.kind == RAY:
            outdated = belief.state.frame - feature.born > model.ray_age_frames
        else:
            unseen = belief.state.frame - feature.seen
            outdated = feature.kind == INVERSE_DEPTH and unseen > model.memory_frames
        if feature.misses >= model.maximum_misses or outdated:
            remove_feature(belief, k)
            counts.deletions += 1


@compiled
def promote(model: Record, belief: Belief) -> int:
    """Turn into points those of the features matched in this frame that are ready; returns how many.

    A ray is ready at the paper's ratio of depth deviation to depth; inverse depth when its linearity index is small.
    """
    count = 0
    for k in range(belief.state.count):
        feature = belief.feature[k]
        if feature.seen != belief.state.frame:
            continue
        if feature.kind == RAY:
            ready = depth_ratio(belief, k) < model.mapped_depth_ratio
        else:
            ready = feature.kind == INVERSE_DEPTH and linearity_index(belief, k) < model.linearity_threshold
        if ready:
            convert_to_point(belief, k)
            count += 1
    return count


@compiled
def linearity_index(belief: Belief, k: int) -> float:
    """4 sigma_d |cos alpha| / d of an INVERSE_DEPTH feature (Civera, Davison and Montiel 2008, equation 27).

    sigma_d = sigma_rho / rho^2 is the deviation of its depth from the anchor, d its distance from the present camera,
    alpha the parallax between the two sights.
    """
    feature, camera = belief.feature[k], belief.state.camera[POSITION]
    rho, rho_row = feature.mean[RHO], feature.start + RHO
    m, y, square, along = bearing(feature.mean[AZIMUTH], feature.mean[ELEVATION])[0], place_of(feature), 0.0, 0.0
    for i in range(3):
        sight = y[i] - camera[i]
        square += sight * sight
        along += m[i] * sight
    sigma_d = math.sqrt(max(belief.covariance[rho_row, rho_row], 0.0)) / (rho * rho)
    return 4.0 * sigma_d * abs(along) / max(square, 1e-12)


@borrowing
def count_misses(model: Record, belief: Belief, K: int, sight: Sight, matches: np.ndarray) -> None:
    """A match clears a feature's misses; being predicted well inside the image without a detection near adds one.
    Remembers which were crowded.

    Misses from places less than ``miss_spacing`` [m] apart count once: what hides a feature hides it from all of them.
    ``matches`` (v,) are those of the predictions in ``sight``, of which fiducials are the first ``K`` rows.
    """
    camera, spacing = belief.state.camera, model.miss_spacing
    for a in range(matches.shape[0]):
        point = sight.point[a]
        if point.row < K:
            continue
        feature = belief.feature[point.row - K]
        if point.crowded == 0:
            feature.crowded = belief.state.frame
        if matches[a] >= 0:
            feature.misses, feature.seen = 0, belief.state.frame
        elif point.visibility == INSIDE and matches[a] != WAITS:
            if feature.misses == 0 or spacing == 0.0 or distance_between(feature.missed_at, camera) > spacing:
                feature.misses += 1
                copy_into(feature.missed_at, camera[POSITION])


# The covariance of camera and features --------------------------------------------------------------------------------


@borrowing
def room_for(belief: Belief, width: int) -> bool:
    """Whether one more feature of ``width`` dimensions fits."""
    return belief.state.count < belief.feature.shape[0] and belief.state.dim + width <= belief.covariance.shape[0]


@compiled
def append_feature(belief: Belief, kind: int, mean: np.ndarray, J: np.ndarray, Q: np.ndarray) -> int:
    """Add a feature y = g(camera, rest) and return its position, the last; the caller has asked `room_for` it.

    ``mean`` (6,); ``J`` (width, 12) is dy/d camera tangent; ``Q`` (>= width, >= width) the covariance of what does not
    come from the camera: P_yx = J P_cx, P_yy = J P_cc J^T + Q.
    """
    state, P, width = belief.state, belief.covariance, J.shape[0]
    at, k = state.dim, state.count
    P_yx = np.zeros((width, at))
    add_product(J, P[:CAMERA_DIM], P_yx)
    for i in range(at, at + width):
        for j in range(at):
            P[i, j] = P_yx[i - at, j]
            P[j, i] = P_yx[i - at, j]
        for j in range(at, at + width):
            P[i, j] = Q[i - at, j - at]
    add_symmetric_product(P_yx, J, P[at : at + width, at : at + width])
    feature = belief.feature[k]
    feature.slot = free_slot(belief.feature["slot"], k)
    copy_into(feature.mean, mean)
    feature.kind, feature.start, feature.misses = kind, at, 0
    feature.born, feature.seen, feature.crowded = state.frame, state.frame, -NEVER
    state.dim, state.count, state.initialised = at + width, k + 1, state.initialised + 1
    feature.id = state.initialised
    return k


@borrowing
def free_slot(slots: np.ndarray, count: int) -> int:
    """The lowest number that is none of the first ``count`` of the ``slots``."""
    slot, k = 0, 0
    while k < count:
        slot, k = (slot + 1, 0) if slots[k] == slot else (slot, k + 1)
    return slot


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
        if belief.feature[k].id == id:
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
