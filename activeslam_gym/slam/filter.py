"""One frame of the filter: predict, associate, update, initialise. The only order in which `slam` is used.

A kernel of its own, which its callers enter by address (see `linking`), and so does it `follow_rays`: it is compiled
beside its callers, not into them, and what only a scenario with depth particles needs is compiled for such.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from activeslam_gym.camera import CameraModel
from activeslam_gym.compilation import kernel, part
from activeslam_gym.linalg import copy_into
from activeslam_gym.linking import enter
from activeslam_gym.motion import MotionModel
from activeslam_gym.slam.association import REJECTED, associate
from activeslam_gym.slam.belief import FEATURES, FRAME, RAY, Belief
from activeslam_gym.slam.initialisation import delete_failed, follow_candidates, give_birth, mature
from activeslam_gym.slam.measurement import INSIDE, UNSEEN, Predictions, predict_measurements
from activeslam_gym.slam.prediction import predict
from activeslam_gym.slam.settings import FilterModel
from activeslam_gym.slam.update import innovation_covariance, stack, update

BIRTHS, CONVERSIONS, DELETIONS, REJECTIONS = 0, 1, 2, 3
"""Entries of the counters that a frame adds to."""


@kernel(nogil=True)
def filter_frame(
    camera: CameraModel,
    motion: MotionModel,
    model: FilterModel,
    belief: Belief,
    fiducials: np.ndarray,
    u: np.ndarray,
    pixels: np.ndarray,
    given: np.ndarray,
    match: np.ndarray,
    counters: np.ndarray,
    rays_entry: Any,
) -> None:
    """Advance the belief by one frame; writes the ``match`` (M,) of each of ``pixels`` (M, 2).

    A match is a row (a birth's included), NEW or REJECTED.

    ``u`` (6,) is what the filter knows of the accelerations. ``given`` is empty, or the (M,) known matches of a first
    sight of the fiducials. ``rays_entry`` is `linking.entry_of` `depth_particles.follow_rays`; without particles it is
    not used.
    """
    predict(motion, belief, u)
    predictions = predict_measurements(camera, belief, fiducials)
    K = fiducials.shape[0]
    rows = _rows_in_reach(predictions)
    HP = stack(belief, K, rows, predictions)
    S = innovation_covariance(belief, K, rows, predictions, HP, camera.pixel_std**2)
    waits = np.zeros(predictions.visibility.shape[0], np.bool_)
    if given.shape[0] == 0:
        given = associate(model, rows, predictions, S, pixels, waits)
    copy_into(match, given)
    if belief.particles.shape[1] > 0:
        enter(rays_entry, (camera, model, belief, K, pixels, match))
    _count_misses(belief, predictions, K, match, waits, counters)
    _update_by(belief, rows, predictions, HP, S, pixels, match)
    counters[CONVERSIONS] += mature(model, belief, K, match)
    counters[DELETIONS] += delete_failed(model, belief)
    for i in follow_candidates(camera, model, belief, pixels, match):
        slot = give_birth(camera, model, belief, pixels[i])
        if slot >= 0:
            match[i] = K + slot
            counters[BIRTHS] += 1


@part
def _rows_in_reach(predictions: Predictions) -> np.ndarray:
    """(m,) rows that may have been detected."""
    rows = np.empty(predictions.visibility.shape[0], np.int64)
    count = 0
    for row in range(rows.shape[0]):
        if predictions.visibility[row] != UNSEEN:
            rows[count] = row
            count += 1
    return rows[:count]


@part(inline="always")
def _update_by(
    belief: Belief,
    rows: np.ndarray,
    predictions: Predictions,
    HP: np.ndarray,
    S: np.ndarray,
    pixels: np.ndarray,
    match: np.ndarray,
) -> None:
    """Update by the matched among ``rows``: their part of H P and of S. (A match with a ray only has particles.)"""
    kept, innovation = np.empty(2 * rows.shape[0], np.int64), np.empty(2 * rows.shape[0])
    m = 0
    for a in range(rows.shape[0]):
        for i in range(match.shape[0]):
            if match[i] == rows[a]:
                for axis in range(2):
                    kept[m] = 2 * a + axis
                    innovation[m] = pixels[i, axis] - predictions.z_hat[rows[a], axis]
                    m += 1
    if m == 0:
        return
    HP_m, S_m = np.empty((m, HP.shape[1])), np.empty((m, m))
    for r in range(m):
        for j in range(HP.shape[1]):
            HP_m[r, j] = HP[kept[r], j]
        for j in range(m):
            S_m[r, j] = S[kept[r], kept[j]]
    update(belief, HP_m, S_m, innovation[:m])


@part(inline="always")
def _count_misses(
    belief: Belief,
    predictions: Predictions,
    K: int,
    match: np.ndarray,
    waits: np.ndarray,
    counters: np.ndarray,
) -> None:
    """A match clears a feature's misses; being predicted well inside the image without a detection near adds one."""
    matched = np.zeros(predictions.visibility.shape[0], np.bool_)
    for i in range(match.shape[0]):
        if match[i] >= 0:
            matched[match[i]] = True
        counters[REJECTIONS] += match[i] == REJECTED
    for k in range(belief.size[FEATURES]):
        slot = belief.order[k]
        if belief.kind[slot] == RAY:
            continue  # `follow_rays` has counted
        if matched[K + slot]:
            belief.misses[slot] = 0
            belief.seen[slot] = belief.size[FRAME]
        elif predictions.visibility[K + slot] == INSIDE and not waits[K + slot]:
            belief.misses[slot] += 1
