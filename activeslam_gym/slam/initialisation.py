"""From unexplained detections to features: candidates, births, growing up, deletion.

The seam of the two initialisers: `give_birth` and `mature` are the only places that know which of them is at work.
"""

from __future__ import annotations

import math

import numpy as np

from activeslam_gym.camera import (
    CameraModel,
    camera_from_world,
    pixel_from_camera_point,
    ray_from_pixel,
    ray_jacobian,
)
from activeslam_gym.compilation import part
from activeslam_gym.geometry import rotation_matrix, skew
from activeslam_gym.linalg import product
from activeslam_gym.motion import CAMERA_DIM, QUATERNION
from activeslam_gym.slam.association import NEW
from activeslam_gym.slam.belief import (
    FEATURE_SIZE,
    FEATURES,
    FRAME,
    INVERSE_DEPTH,
    KIND_DIM,
    RAY,
    Belief,
    angles_of,
    append_feature,
    bearing,
    convert_to_point,
    depth_ratio,
    remove_feature,
    room_for,
)
from activeslam_gym.slam.depth_particles import scatter_particles
from activeslam_gym.slam.settings import FilterModel

CANDIDATE_RADIUS_PX = 15.0
"""A candidate is followed to the nearest new detection within this distance of where its direction projects [px]."""


# Candidates ---------------------------------------------------------------------------------------------------------


@part
def follow_candidates(
    camera: CameraModel, model: FilterModel, belief: Belief, pixels: np.ndarray, match: np.ndarray
) -> np.ndarray:
    """Follow detections that no feature explains; returns the indices of those that now deserve a feature.

    A candidate is a world direction (its parallax in a frame is small), dropped at the first frame without a NEW
    detection near it.
    """
    R_WC = rotation_matrix(belief.camera[QUATERNION])
    taken = np.empty(match.shape[0], np.bool_)
    for i in range(match.shape[0]):
        taken[i] = match[i] != NEW
    ripe = np.empty(pixels.shape[0], np.int64)
    count = 0
    for c in range(belief.candidate_hits.shape[0]):
        if belief.candidate_hits[c] == 0:
            continue
        i = _nearest_pixel(camera, R_WC, belief.candidate_bearing[c], pixels, taken)
        if i < 0:
            belief.candidate_hits[c] = 0
            continue
        taken[i] = True
        belief.candidate_hits[c] += 1
        _aim(camera, belief, R_WC, c, pixels[i])
        if belief.candidate_hits[c] >= model.birth_detections:
            ripe[count] = i
            count += 1
            belief.candidate_hits[c] = 0
    _new_candidates(camera, belief, R_WC, pixels, taken)
    return ripe[:count]


@part
def _new_candidates(
    camera: CameraModel, belief: Belief, R_WC: np.ndarray, pixels: np.ndarray, taken: np.ndarray
) -> None:
    c = 0
    for i in range(pixels.shape[0]):
        while c < belief.candidate_hits.shape[0] and belief.candidate_hits[c] > 0:
            c += 1
        if c == belief.candidate_hits.shape[0]:
            return
        if not taken[i]:
            belief.candidate_hits[c] = 1
            _aim(camera, belief, R_WC, c, pixels[i])


@part
def _aim(camera: CameraModel, belief: Belief, R_WC: np.ndarray, c: int, pixel: np.ndarray) -> None:
    """Point candidate ``c`` at a pixel."""
    h = _direction(camera, R_WC, pixel)
    for i in range(3):
        belief.candidate_bearing[c, i] = h[i]


@part
def _direction(camera: CameraModel, R_WC: np.ndarray, pixel: np.ndarray) -> np.ndarray:
    """World direction (3,) of a pixel, of any length."""
    r = ray_from_pixel(camera, pixel)
    h = np.empty(3)
    for i in range(3):
        h[i] = R_WC[i, 0] * r[0] + R_WC[i, 1] * r[1] + R_WC[i, 2] * r[2]
    return h


@part
def _nearest_pixel(
    camera: CameraModel, R_WC: np.ndarray, direction: np.ndarray, pixels: np.ndarray, taken: np.ndarray
) -> int:
    """Index of the free pixel nearest to where ``direction`` projects, within the radius, or -1."""
    z = np.empty(2)
    if not pixel_from_camera_point(camera, camera_from_world(R_WC, direction), z):
        return -1
    best, nearest = -1, CANDIDATE_RADIUS_PX**2
    for i in range(pixels.shape[0]):
        square = (pixels[i, 0] - z[0]) ** 2 + (pixels[i, 1] - z[1]) ** 2
        if not taken[i] and square < nearest:
            best, nearest = i, square
    return best


# Birth --------------------------------------------------------------------------------------------------------------


@part
def give_birth(camera: CameraModel, model: FilterModel, belief: Belief, pixel: np.ndarray) -> int:
    """Add the feature seen at ``pixel`` (2,) and return its slot, of the scenario's first kind.

    Both kinds begin with the anchor and the direction of the line of sight; inverse depth adds a Gaussian rho,
    independent of the rest. -1 if there is no room.
    """
    kind = INVERSE_DEPTH if model.inverse_depth else RAY
    if not room_for(belief, KIND_DIM[kind]) or (kind == RAY and _ray_count(belief) >= model.ray_capacity):
        return -1
    mean, J_x, Q = _line_of_sight(camera, belief, pixel)
    mean[5] = model.inverse_depth_mean
    Q[5, 5] = model.inverse_depth_std**2
    width = KIND_DIM[kind]
    slot = append_feature(belief, kind, mean, J_x[:width], Q)
    if kind == RAY:
        scatter_particles(belief, slot, model.particle_near, model.particle_far)
    return slot


@part
def _line_of_sight(camera: CameraModel, belief: Belief, pixel: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean (6,), Jacobian by the camera's tangent (6, 12) and covariance by the pixel (6, 6) of a new line of sight.

    h = R r(z): dh/d dtheta = -[h]x, dh/dz = R dr/dz; the angles follow by d(azimuth, elevation)/dh. Row 5 (inverse
    depth) is zero.
    """
    R_WC = rotation_matrix(belief.camera[QUATERNION])
    h = _direction(camera, R_WC, pixel)
    J_h = np.empty((2, 3))
    mean = np.zeros(FEATURE_SIZE)
    mean[3], mean[4] = angles_of(h, J_h)
    J_turn = product(J_h, skew(h))
    J_z = product(J_h, product(R_WC, ray_jacobian(camera, pixel)))
    J_x = np.zeros((FEATURE_SIZE, CAMERA_DIM))
    Q = np.zeros((FEATURE_SIZE, FEATURE_SIZE))
    for i in range(3):
        mean[i] = belief.camera[i]
        J_x[i, i] = 1.0
    for i in range(2):
        for j in range(3):
            J_x[3 + i, 3 + j] = -J_turn[i, j]
        for j in range(2):
            Q[3 + i, 3 + j] = camera.pixel_std**2 * (J_z[i, 0] * J_z[j, 0] + J_z[i, 1] * J_z[j, 1])
    return mean, J_x, Q


@part
def _ray_count(belief: Belief) -> int:
    count = 0
    for k in range(belief.size[FEATURES]):
        if belief.kind[belief.order[k]] == RAY:
            count += 1
    return count


# Growing up and deletion --------------------------------------------------------------------------------------------


@part
def mature(model: FilterModel, belief: Belief, K: int, match: np.ndarray) -> int:
    """Turn into points those of the features just matched that are ready; returns how many.

    ``match`` (M,) is the match of each detection, in which row ``K`` is slot 0.

    A ray is ready at the paper's ratio of depth deviation to depth; inverse depth when its linearity index is small.
    """
    count = 0
    for row in match:
        slot = row - K
        if slot < 0:
            continue
        if belief.kind[slot] == RAY:
            ready = depth_ratio(belief, slot) < model.mapped_depth_ratio
        else:
            ready = belief.kind[slot] == INVERSE_DEPTH and linearity_index(belief, slot) < model.linearity_threshold
        if ready:
            convert_to_point(belief, slot)
            count += 1
    return count


@part
def linearity_index(belief: Belief, slot: int) -> float:
    """4 sigma_d |cos alpha| / d of an INVERSE_DEPTH feature (Civera, Davison and Montiel 2008, equation 27).

    sigma_d = sigma_rho / rho^2 is the deviation of its depth from the anchor, d its distance from the present camera,
    alpha the parallax between the two sights.
    """
    feature, at = belief.feature[slot], belief.start[slot] + 5
    rho = feature[5]
    m = bearing(feature[3], feature[4])
    square, along = 0.0, 0.0
    for i in range(3):
        sight = feature[i] + m[0, i] / rho - belief.camera[i]
        square += sight * sight
        along += m[0, i] * sight
    sigma_d = math.sqrt(max(belief.covariance[at, at], 0.0)) / (rho * rho)
    return 4.0 * sigma_d * abs(along) / max(square, 1e-12)


@part
def delete_failed(model: FilterModel, belief: Belief) -> int:
    """Delete features that were missed too often or are `_outdated`; returns how many."""
    count = 0
    for k in range(belief.size[FEATURES] - 1, -1, -1):
        slot = belief.order[k]
        if belief.misses[slot] >= model.maximum_misses or _outdated(model, belief, slot):
            remove_feature(belief, slot)
            count += 1
    return count


@part
def _outdated(model: FilterModel, belief: Belief, slot: int) -> bool:
    """Whether a feature that is no point yet is too old (RAY) or was out of sight for too long (INVERSE_DEPTH).

    The long ellipse of a vague depth, met again after seconds, takes what another landmark's detection lies on it, and
    that makes it a point, confidently wrong.
    """
    frame, kind = belief.size[FRAME], belief.kind[slot]
    if kind == RAY:
        return frame - belief.born[slot] > model.ray_age_frames
    return kind == INVERSE_DEPTH and frame - belief.seen[slot] > model.inverse_depth_memory_frames
