"""One frame of the filter: predict, associate, update, initialise. The only order in which `slam` is used."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from activeslam_gym.camera import CameraModel, ray_from_pixel
from activeslam_gym.geometry import quaternion_from_matrix
from activeslam_gym.motion import POSITION, QUATERNION, MotionModel
from activeslam_gym.slam.association import REJECTED, associate
from activeslam_gym.slam.belief import FEATURES, RAY, Belief
from activeslam_gym.slam.depth_particles import Rays, predict_rays, reweight
from activeslam_gym.slam.initialisation import delete_failed, follow_candidates, give_birth, mature
from activeslam_gym.slam.measurement import INSIDE, Predictions, predict_measurements
from activeslam_gym.slam.prediction import predict
from activeslam_gym.slam.settings import FilterModel
from activeslam_gym.slam.update import update

BIRTHS, CONVERSIONS, DELETIONS, REJECTIONS = 0, 1, 2, 3
"""Entries of the counters that a frame adds to."""


@njit(cache=True)
def filter_frame(
    camera: CameraModel,
    motion: MotionModel,
    model: FilterModel,
    belief: Belief,
    fiducials: np.ndarray,
    u: np.ndarray,
    pixels: np.ndarray,
    given: np.ndarray,
    counters: np.ndarray,
) -> np.ndarray:
    """Advance the belief by one frame; returns the match (M,) of each of ``pixels`` (M, 2): a row, NEW or REJECTED.

    ``u`` (6,) is what the filter knows of the accelerations. ``given`` is empty, or (M,) rows that are known (-1: not)
    of a first sight of the fiducials.
    """
    predict(motion, belief, u)
    if given.shape[0] > 0:
        _face_fiducials(camera, belief, fiducials, pixels, given)
    predictions = predict_measurements(camera, belief, fiducials)
    rays = predict_rays(camera, belief)
    K = fiducials.shape[0]
    if given.shape[0] > 0:
        match = given
    else:
        match = associate(belief, predictions, rays, K, pixels, model.gate, model.birth_gate)
    counters[REJECTIONS] += np.sum(match == REJECTED)
    _reweight_rays(model, belief, rays, K, pixels, match)
    _count_misses(belief, predictions, rays, K, match)
    _update_by(camera, model, belief, fiducials, predictions, pixels, match)
    counters[CONVERSIONS] += mature(model, belief, match[match >= K] - K)
    counters[DELETIONS] += delete_failed(model, belief)
    for i in follow_candidates(camera, model, belief, pixels, match):
        if give_birth(camera, model, belief, pixels[i]):
            counters[BIRTHS] += 1
    return match


@njit(cache=True)
def _update_by(
    camera: CameraModel,
    model: FilterModel,
    belief: Belief,
    fiducials: np.ndarray,
    predictions: Predictions,
    pixels: np.ndarray,
    match: np.ndarray,
) -> None:
    """Update by every match with a fiducial, a point or an inverse-depth feature; rays only carry particles."""
    chosen = np.empty(match.shape[0], np.int64)
    count = 0
    for i in range(match.shape[0]):
        slot = match[i] - fiducials.shape[0]
        if match[i] >= 0 and (slot < 0 or belief.kind[slot] != RAY):
            chosen[count] = i
            count += 1
    if count > 0:
        which = chosen[:count]
        update(camera, belief, fiducials, match[which], pixels[which], predictions, model.iterations)


@njit(cache=True)
def _reweight_rays(
    model: FilterModel, belief: Belief, rays: Rays, K: int, pixels: np.ndarray, match: np.ndarray
) -> None:
    for r in range(rays.slot.shape[0]):
        for i in range(match.shape[0]):
            if match[i] == K + rays.slot[r]:
                if not reweight(belief, rays, r, pixels[i], model.particle_baseline, model.particle_prune):
                    belief.misses[rays.slot[r]] = model.maximum_misses


@njit(cache=True)
def _count_misses(belief: Belief, predictions: Predictions, rays: Rays, K: int, match: np.ndarray) -> None:
    """A match clears a feature's misses; being predicted well inside the image without one adds to them."""
    for k in range(belief.size[FEATURES]):
        slot = belief.order[k]
        if np.any(match == K + slot):
            if belief.kind[slot] != RAY:
                belief.misses[slot] = 0
        elif predictions.visibility[K + slot] == INSIDE:
            belief.misses[slot] += 1
    for r in range(rays.slot.shape[0]):
        slot = rays.slot[r]
        alive = belief.particles[slot, :, 1] > 0.0
        if not np.any(match == K + slot) and np.all(rays.visibility[r][alive] == INSIDE):
            belief.misses[slot] += 1


@njit(cache=True)
def _face_fiducials(
    camera: CameraModel, belief: Belief, fiducials: np.ndarray, pixels: np.ndarray, given: np.ndarray
) -> None:
    """Turn the mean so that labelled sights of fiducials point at them (Wahba's problem by SVD; Markley 1988).

    A prior of 45 degrees is too wide to linearise at its mean; this gives the update a place to start. Nothing is
    claimed of the covariance, and the prior's isotropic rotation is the same from there.
    """
    B = np.zeros((3, 3))
    for i in range(given.shape[0]):
        if given[i] >= 0:
            r = ray_from_pixel(camera, pixels[i])
            d = fiducials[given[i]] - belief.camera[POSITION]
            B += np.outer(d / math.sqrt(np.sum(d * d)), r / math.sqrt(np.sum(r * r)))
    U, _, Vt = np.linalg.svd(B)
    D = np.eye(3)
    D[2, 2] = np.sign(np.linalg.det(U) * np.linalg.det(Vt))
    belief.camera[QUATERNION] = quaternion_from_matrix(U @ D @ Vt)

