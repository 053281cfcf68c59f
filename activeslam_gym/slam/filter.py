"""One frame of the filter: predict, associate, update, initialise. The only order in which `slam` is used."""

from __future__ import annotations

import numpy as np
from numba import njit

from activeslam_gym.camera import CameraModel
from activeslam_gym.motion import MotionModel
from activeslam_gym.slam.association import REJECTED, associate
from activeslam_gym.slam.belief import FEATURES, RAY, Belief
from activeslam_gym.slam.depth_particles import Rays, predict_rays, reweight, surely_in_view
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

    ``u`` (6,) is what the filter knows of the accelerations. ``given`` is empty, or the (M,) known matches of a first
    sight of the fiducials.
    """
    predict(motion, belief, u)
    predictions = predict_measurements(camera, belief, fiducials)
    rays = predict_rays(camera, belief)
    K = fiducials.shape[0]
    match = given
    if given.shape[0] == 0:
        match = associate(belief, predictions, rays, K, pixels, model.gate, model.birth_gate)
    _count_misses(belief, predictions, rays, K, match, counters)
    _reweight_rays(model, belief, rays, K, pixels, match)
    rows, measured = _measurements(belief, K, pixels, match)
    if rows.shape[0] > 0:
        update(camera, belief, fiducials, rows, measured, predictions, model.iterations)
    counters[CONVERSIONS] += mature(model, belief, K, match)
    counters[DELETIONS] += delete_failed(model, belief)
    for i in follow_candidates(camera, model, belief, pixels, match):
        if give_birth(camera, model, belief, pixels[i]):
            counters[BIRTHS] += 1
    return match


@njit(cache=True)
def _measurements(
    belief: Belief, K: int, pixels: np.ndarray, match: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Rows (m,) and pixels (m, 2) of the matches that update: of fiducials, points and inverse-depth features.

    A match with a ray only re-weights its particles.
    """
    rows, measured = np.empty(match.shape[0], np.int64), np.empty((match.shape[0], 2))
    count = 0
    for i in range(match.shape[0]):
        slot = match[i] - K
        if match[i] >= 0 and (slot < 0 or belief.kind[slot] != RAY):
            rows[count] = match[i]
            measured[count, 0], measured[count, 1] = pixels[i, 0], pixels[i, 1]
            count += 1
    return rows[:count], measured[:count]


@njit(cache=True)
def _reweight_rays(
    model: FilterModel, belief: Belief, rays: Rays, K: int, pixels: np.ndarray, match: np.ndarray
) -> None:
    """Carry the matches of rays to their particles; a ray whose particles explain nothing is due for deletion."""
    for r in range(rays.slot.shape[0]):
        for i in range(match.shape[0]):
            if match[i] == K + rays.slot[r]:
                if not reweight(belief, rays, r, pixels[i], model.particle_baseline, model.particle_prune):
                    belief.misses[rays.slot[r]] = model.maximum_misses


@njit(cache=True)
def _count_misses(
    belief: Belief, predictions: Predictions, rays: Rays, K: int, match: np.ndarray, counters: np.ndarray
) -> None:
    """A match clears a feature's misses; being predicted well inside the image without one adds to them."""
    matched = np.zeros(predictions.visibility.shape[0], np.bool_)
    for i in range(match.shape[0]):
        if match[i] >= 0:
            matched[match[i]] = True
        counters[REJECTIONS] += match[i] == REJECTED
    for k in range(belief.size[FEATURES]):
        slot = belief.order[k]
        if matched[K + slot]:
            belief.misses[slot] = 0
        elif predictions.visibility[K + slot] == INSIDE:
            belief.misses[slot] += 1
    for r in range(rays.slot.shape[0]):
        if not matched[K + rays.slot[r]] and surely_in_view(belief, rays, r):
            belief.misses[rays.slot[r]] += 1
