"""The paper's delayed initialisation: a Gaussian ray whose depth is a particle distribution (Davison 2003).

Made honest in two ways: a ray is re-weighted only after the camera has moved a baseline, since successive frames share
the errors of the ray and the camera; and the spacing of the particles has a variance of its own.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from activeslam_gym.camera import CameraModel, inside_image
from activeslam_gym.compilation import kernel, part
from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.motion import QUATERNION
from activeslam_gym.slam.association import NEW, REJECTED
from activeslam_gym.slam.belief import FEATURES, FRAME, KIND_DIM, RAY, Belief, bearing
from activeslam_gym.slam.measurement import (
    INSIDE,
    UNSEEN,
    determinant,
    own_innovation,
    point_measurement,
    squared_distance,
    visibility_of,
)
from activeslam_gym.slam.settings import FilterModel


class Rays(NamedTuple):
    """Predicted measurements of each particle of each ray. R rays, M particles."""

    slot: np.ndarray
    """(R,) slot of the ray."""
    visibility: np.ndarray
    """(R, M) UNSEEN, NEAR or INSIDE."""
    z_hat: np.ndarray
    """(R, M, 2) [px]."""
    S: np.ndarray
    """(R, M, 2, 2) [px^2]."""


@part
def scatter_particles(belief: Belief, slot: int, nearest: float, farthest: float) -> None:
    """Spread a new ray's particles evenly in depth between ``nearest`` and ``farthest`` [m], with equal weights."""
    count = belief.particles.shape[1]
    for k in range(count):
        belief.particles[slot, k, 0] = nearest + (farthest - nearest) * (k + 0.5) / count
        belief.particles[slot, k, 1] = 1.0 / count
    _mark_weighed(belief, slot)
    _summarise(belief, slot)


@part
def _mark_weighed(belief: Belief, slot: int) -> None:
    for i in range(3):
        belief.weighed_at[slot, i] = belief.camera[i]


@part
def _summarise(belief: Belief, slot: int) -> None:
    """Mean and variance of the depth: of the particles, plus spacing^2 / 12 for what lies between them."""
    particles = belief.particles[slot]
    mean, square = 0.0, 0.0
    for k in range(particles.shape[0]):
        mean += particles[k, 1] * particles[k, 0]
        square += particles[k, 1] * particles[k, 0] ** 2
    spacing = particles[1, 0] - particles[0, 0]
    belief.depth[slot, 0] = mean
    belief.depth[slot, 1] = max(square - mean * mean, 0.0) + spacing * spacing / 12.0


@kernel(nogil=True)
def follow_rays(
    camera: CameraModel, model: FilterModel, belief: Belief, K: int, pixels: np.ndarray, match: np.ndarray
) -> None:
    """One frame of all rays: match them to those of ``pixels`` (M, 2) that are NEW in ``match`` (M,), and weigh them.

    Writes their rows (``K`` + slot) into ``match``, and REJECTED where a detection is near a ray without being its
    match. A miss counts when every particle was well in view; a ray whose particles explain nothing has missed enough.
    """
    rays = predict_rays(camera, belief)
    _match_rays(model, belief, rays, K, pixels, match)
    for r in range(rays.slot.shape[0]):
        slot, matched = rays.slot[r], -1
        for i in range(match.shape[0]):
            if match[i] == K + slot:
                matched = i
        if matched >= 0:
            explained = reweight(belief, rays, r, pixels[matched], model.particle_baseline, model.particle_prune)
            belief.misses[slot] = 0 if explained else model.maximum_misses
            belief.seen[slot] = belief.size[FRAME]
        elif surely_in_view(belief, rays, r):
            belief.misses[slot] += 1


@part
def predict_rays(camera: CameraModel, belief: Belief) -> Rays:
    """Project every particle with weight, and its uncertainty ellipse, into the image."""
    count = 0
    for k in range(belief.size[FEATURES]):
        if belief.kind[belief.order[k]] == RAY:
            count += 1
    M = belief.particles.shape[1]
    rays = Rays(
        np.empty(count, np.int64), np.zeros((count, M), np.int64), np.empty((count, M, 2)), np.empty((count, M, 2, 2))
    )
    if count == 0:
        return rays
    R_WC = rotation_matrix(belief.camera[QUATERNION])
    r = 0
    for k in range(belief.size[FEATURES]):
        slot = belief.order[k]
        if belief.kind[slot] == RAY:
            rays.slot[r] = slot
            _predict_ray(camera, belief, R_WC, slot, rays, r)
            r += 1
    return rays


@part
def _predict_ray(camera: CameraModel, belief: Belief, R_WC: np.ndarray, slot: int, rays: Rays, r: int) -> None:
    feature, start, width = belief.feature[slot], belief.start[slot], KIND_DIM[RAY]
    m = bearing(feature[3], feature[4])
    H_x, H_point, H_ray = np.empty((2, 6)), np.empty((2, 3)), np.empty((2, 6))
    for k in range(belief.particles.shape[1]):
        if belief.particles[slot, k, 1] == 0.0:
            continue
        depth, z_hat, S = belief.particles[slot, k, 0], rays.z_hat[r, k], rays.S[r, k]
        y = np.array((feature[0] + depth * m[0, 0], feature[1] + depth * m[0, 1], feature[2] + depth * m[0, 2]))
        if not point_measurement(camera, belief.camera, R_WC, y, z_hat, H_x, H_point):
            continue
        if not inside_image(camera, z_hat, camera.width):
            continue
        for i in range(2):
            for j in range(2):
                H_ray[i, 3 + j] = 0.0
            for k_axis in range(3):
                H_ray[i, k_axis] = H_point[i, k_axis]
                for j in range(2):
                    H_ray[i, 3 + j] += depth * H_point[i, k_axis] * m[1 + j, k_axis]
        own_innovation(belief.covariance, start, width, H_x, H_ray, camera.pixel_std**2, S)
        rays.visibility[r, k] = visibility_of(camera, z_hat, S)


@part
def _match_rays(model: FilterModel, belief: Belief, rays: Rays, K: int, pixels: np.ndarray, out: np.ndarray) -> None:
    """Match rays to detections that are NEW so far: mutual best by the mixture's likelihood, inside a particle's gate.

    What is near a ray without being its match is REJECTED.
    """
    R, M = rays.slot.shape[0], pixels.shape[0]
    cost = np.full((R, M), np.inf)
    near = np.zeros(M, np.bool_)
    for r in range(R):
        for i in range(M):
            if out[i] == NEW:
                d2, value = ray_distance(belief, rays, r, pixels[i])
                near[i] |= d2 < model.birth_gate
                if d2 < model.gate:
                    cost[r, i] = value
    for i in range(M):
        if not near[i]:
            continue
        out[i] = REJECTED
        r = int(np.argmin(cost[:, i]))
        if cost[r, i] < np.inf and np.argmin(cost[r]) == i:
            out[i] = K + rays.slot[r]


@part
def ray_distance(belief: Belief, rays: Rays, r: int, z: np.ndarray) -> tuple[float, float]:
    """(smallest squared Mahalanobis distance of the pixel to a particle, -2 ln of the ray's likelihood less 2 pi)."""
    nearest, likelihood = np.inf, 0.0
    for k in range(rays.visibility.shape[1]):
        if rays.visibility[r, k] != UNSEEN:
            d2 = squared_distance(z, rays.z_hat[r, k], rays.S[r, k])
            nearest = min(nearest, d2)
            weight = belief.particles[rays.slot[r], k, 1]
            likelihood += weight * math.exp(-0.5 * d2) / math.sqrt(determinant(rays.S[r, k]))
    return nearest, -2.0 * math.log(max(likelihood, 1e-300))


@part
def surely_in_view(belief: Belief, rays: Rays, r: int) -> bool:
    """Whether every particle with weight is predicted well inside the image, so that a miss is telling."""
    for k in range(rays.visibility.shape[1]):
        if belief.particles[rays.slot[r], k, 1] > 0.0 and rays.visibility[r, k] != INSIDE:
            return False
    return True


@part
def reweight(belief: Belief, rays: Rays, r: int, z: np.ndarray, baseline: float, prune: float) -> bool:
    """Bayes on the particles by the matched pixel, if the camera has moved ``baseline`` [m] since the last time.

    Particles under ``prune`` of the mean weight are dropped. False if no particle explains the pixel.
    """
    slot = rays.slot[r]
    moved = 0.0
    for i in range(3):
        moved += (belief.camera[i] - belief.weighed_at[slot, i]) ** 2
    if moved < baseline * baseline:
        return True
    particles = belief.particles[slot]
    total = 0.0
    for k in range(particles.shape[0]):
        if rays.visibility[r, k] == UNSEEN:
            particles[k, 1] = 0.0
            continue
        d2 = squared_distance(z, rays.z_hat[r, k], rays.S[r, k])
        particles[k, 1] *= math.exp(-0.5 * d2) / math.sqrt(determinant(rays.S[r, k]))
        total += particles[k, 1]
    if not total > 1e-300:
        return False
    floor = prune / particles.shape[0]
    kept = 0.0
    for k in range(particles.shape[0]):
        particles[k, 1] /= total
        if particles[k, 1] < floor:
            particles[k, 1] = 0.0
        kept += particles[k, 1]
    for k in range(particles.shape[0]):
        particles[k, 1] /= kept
    _mark_weighed(belief, slot)
    _summarise(belief, slot)
    return True
