"""The paper's delayed initialisation: a Gaussian ray whose depth is a particle distribution (Davison 2003).

It is kept consistent in two ways. A ray is re-weighted only after the camera has moved a baseline, since successive
frames share the errors of the ray and the camera; and the spacing of the particles has a variance of its own.
"""

import math
from typing import NamedTuple

import numpy as np

from activeslam_gym.camera import View, view_of, visible
from activeslam_gym.config import Scenario
from activeslam_gym.kernels import Record, borrowing, compiled, constants, record
from activeslam_gym.linalg import copy_into, diagonal, sum_of_squares
from activeslam_gym.motion import POSITION
from activeslam_gym.slam.belief import ANCHOR, AZIMUTH, ELEVATION, KIND_DIM, RAY, Belief, bearing
from activeslam_gym.slam.detection import NEW, REJECTED, UNASSOCIATED, distance_by_own_noise
from activeslam_gym.slam.sight import INSIDE, own_innovation, point_measurement, visibility_of

PARTICLES, particles_of = constants(
    Scenario(),
    particle_depth=lambda s: np.array(s.particle_depth),  # nearest and farthest [m]
    particle_prune="f8",  # a particle with less than this share of the mean weight is dropped
    particle_baseline="f8",  # motion between two re-weightings of a ray [m]
)
"""Constants of the depth particles; see the fields of `Scenario`."""


PARTICLE = record(
    visibility="i8",  # 0 (out of reach), NEAR or INSIDE
    z_hat=("f8", 2),  # predicted pixel [px]
    S=("f8", (2, 2)),  # H P H^T + R, with the lens's own R [px^2]
)
"""The predicted measurement of one particle."""


class Rays(NamedTuple):
    """Predicted measurements of each particle of each ray. R rays, M particles."""

    feature: np.ndarray  # (R,) where the ray stands in ``belief.feature``
    particle: np.ndarray  # (R, M) PARTICLE
    R: np.ndarray  # (2, 2) of the lens [px^2]


@compiled
def scatter_particles(model: Record, belief: Belief, k: int) -> None:
    """Spread the new ray ``k``'s particles evenly in depth, with equal weights."""
    particles = belief.particles[belief.feature[k].slot]
    count, near, far = particles.shape[0], model.particle_depth[0], model.particle_depth[1]
    for j in range(count):
        particles[j, 0] = near + (far - near) * (j + 0.5) / count
        particles[j, 1] = 1.0 / count
    _summarise(belief, k)


@compiled
def _summarise(belief: Belief, k: int) -> None:
    """Mean and variance of the depth: of the particles, plus spacing^2 / 12 for what lies between them."""
    feature = belief.feature[k]
    particles, mean, mean_square = belief.particles[feature.slot], 0.0, 0.0
    for j in range(particles.shape[0]):
        depth, weight = particles[j, 0], particles[j, 1]
        mean += weight * depth
        mean_square += weight * depth**2
    spacing = particles[1, 0] - particles[0, 0]
    feature.depth = mean
    feature.depth_var = max(mean_square - mean * mean, 0.0) + spacing * spacing / 12.0
    copy_into(feature.weighed_at, belief.state.camera[POSITION])


@compiled
def follow_rays(
    lens: Record, model: Record, belief: Belief, boxes: np.ndarray, detections: np.ndarray, labelled: bool
) -> None:
    """One frame of all rays: match them to those of ``detections`` (M,) that are NEW, and weigh them.

    Sets their ``match``, and REJECTED where a detection is near a ray without being its match; ``labelled``: the
    matches of rays are set already. A miss counts when every particle with weight is predicted well inside the image; a
    ray whose particles explain nothing has missed enough. ``model``: FILTER.
    """
    rays = predict_rays(lens, belief, boxes)
    if not labelled:
        _match_rays(model.association, belief, rays, detections)
    for r in range(rays.feature.shape[0]):
        feature = belief.feature[rays.feature[r]]
        matched, in_view = -1, True
        for i in range(detections.shape[0]):
            if detections[i].match == feature.id:
                matched = i
        for j in range(rays.particle.shape[1]):
            in_view &= belief.particles[feature.slot, j, 1] == 0.0 or rays.particle[r, j].visibility == INSIDE
        if matched >= 0:
            explained = reweight(model.particles, belief, rays, r, detections[matched])
            feature.misses = 0 if explained else model.initialisation.maximum_misses
            feature.seen = belief.state.frame
        elif in_view:
            feature.misses += 1


@compiled
def predict_rays(lens: Record, belief: Belief, boxes: np.ndarray) -> Rays:
    """Project every particle with weight, and its uncertainty ellipse, into the image."""
    feature = np.flatnonzero(belief.feature["kind"][: belief.state.count] == RAY)
    R, M, noise = feature.shape[0], belief.particles.shape[1], diagonal(np.full(2, lens.pixel_std**2))
    rays, view = Rays(feature, np.empty((R, M), PARTICLE), noise), view_of(lens, belief.state.camera, boxes)
    for r in range(R):
        _predict_ray(view, belief, rays, r)
    return rays


@compiled
def _predict_ray(view: View, belief: Belief, rays: Rays, r: int) -> None:
    feature, lens = belief.feature[rays.feature[r]], view.lens
    particles, m = belief.particles[feature.slot], bearing(feature.mean[AZIMUTH], feature.mean[ELEVATION])
    H_x, H_point, H_ray = np.empty((2, 6)), np.empty((2, 3)), np.empty((2, 6))
    for j in range(particles.shape[0]):
        depth, predicted = particles[j, 0], rays.particle[r, j]
        predicted.visibility = 0
        if particles[j, 1] == 0.0:
            continue
        y = feature.mean[ANCHOR] + depth * np.array(m[0])
        if not visible(view, y, lens.width, predicted.z_hat):
            continue
        point_measurement(view, y, predicted.z_hat, H_x, H_point)
        for axis in range(2):  # by the chain rule: dy/d anchor = I, dy/d angles = depth dm/d angles
            H_ray[axis, AZIMUTH], H_ray[axis, ELEVATION] = 0.0, 0.0
            for i in range(3):
                H_ray[axis, i] = H_point[axis, i]
                H_ray[axis, AZIMUTH] += depth * H_point[axis, i] * m[1][i]
                H_ray[axis, ELEVATION] += depth * H_point[axis, i] * m[2][i]
        own_innovation(lens, belief.covariance, feature.start, KIND_DIM[RAY], H_x, H_ray, predicted.S)
        predicted.visibility = visibility_of(lens, predicted.z_hat, predicted.S)


@compiled
def _match_rays(model: Record, belief: Belief, rays: Rays, detections: np.ndarray) -> None:
    """Match rays to detections that are NEW so far: mutual best by the mixture's likelihood, inside a particle's gate.

    A detection near a ray without being its match is REJECTED.
    """
    R, M = rays.feature.shape[0], detections.shape[0]
    near, of_ray, ray_of = np.zeros(M, np.bool_), np.full(R, -1), np.full(M, -1)
    ray_cost, cost = np.full(R, np.inf), np.full(M, np.inf)  # the least of each ray, and of each detection
    for r in range(R):
        id = belief.feature[rays.feature[r]].id
        for i in range(M):
            if detections[i].match == NEW and (detections[i].id == UNASSOCIATED or detections[i].id == id):
                d2, value = ray_distance(belief, rays, r, detections[i])
                near[i] |= d2 < model.new_feature_gate
                if d2 < model.gate and value < ray_cost[r]:
                    ray_cost[r], of_ray[r] = value, i
                if d2 < model.gate and value < cost[i]:
                    cost[i], ray_of[i] = value, r
    for i in range(M):
        if near[i]:
            r = ray_of[i]
            mutual = r >= 0 and of_ray[r] == i
            detections[i].match = belief.feature[rays.feature[r]].id if mutual else REJECTED


@borrowing
def ray_distance(belief: Belief, rays: Rays, r: int, detection: Record) -> tuple[float, float]:
    """(smallest squared Mahalanobis distance of a detection to a particle, -2 ln of its likelihood less 2 pi)."""
    nearest, likelihood = np.inf, 0.0
    for k in range(rays.particle.shape[1]):
        predicted = rays.particle[r, k]
        if predicted.visibility > 0:
            d2, det = distance_by_own_noise(predicted.z_hat, predicted.S, rays.R, detection)
            nearest = min(nearest, d2)
            weight = belief.particles[belief.feature[rays.feature[r]].slot, k, 1]
            likelihood += weight * math.exp(-0.5 * d2) / math.sqrt(det)
    return nearest, -2.0 * (math.log(max(likelihood, 1e-300)) + detection.log_ratio)


@compiled
def reweight(model: Record, belief: Belief, rays: Rays, r: int, detection: Record) -> bool:
    """Bayes on the particles by the matched detection, if the camera has moved a baseline since the last time.

    Particles under ``model.particle_prune`` of the mean weight are dropped. False if no particle explains it.
    """
    k = rays.feature[r]
    feature, position = belief.feature[k], belief.state.camera[POSITION]
    particles = belief.particles[feature.slot]
    if sum_of_squares(position - feature.weighed_at) < model.particle_baseline**2:
        return True
    total = 0.0
    for j in range(particles.shape[0]):
        predicted = rays.particle[r, j]
        if predicted.visibility == 0:
            particles[j, 1] = 0.0
            continue
        d2, det = distance_by_own_noise(predicted.z_hat, predicted.S, rays.R, detection)
        particles[j, 1] *= math.exp(-0.5 * d2) / math.sqrt(det)
        total += particles[j, 1]
    if not total > 1e-300:
        return False
    floor, kept = total * model.particle_prune / particles.shape[0], 0.0
    for j in range(particles.shape[0]):
        if particles[j, 1] < floor:
            particles[j, 1] = 0.0
        kept += particles[j, 1]
    for j in range(particles.shape[0]):
        particles[j, 1] /= kept
    _summarise(belief, k)
    return True
