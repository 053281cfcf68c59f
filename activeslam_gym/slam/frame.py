"""One frame of the filter, in kernels: predict, see, associate, update, initialise.

``models`` is any record with the fields ``camera`` (CAMERA), ``motion`` (MOTION) and ``filter`` (FILTER).
"""

import numpy as np

from activeslam_gym.camera import distance_between
from activeslam_gym.config import Scenario
from activeslam_gym.kernels import Record, borrowing, compiled, constants, record
from activeslam_gym.linalg import copy_into, submatrix
from activeslam_gym.motion import POSITION
from activeslam_gym.slam.appearance import appearance_of, associate_identified
from activeslam_gym.slam.association import associate, association_of
from activeslam_gym.slam.belief import Belief
from activeslam_gym.slam.depth_particles import follow_rays, particles_of
from activeslam_gym.slam.detection import NEW, REJECTED, UNASSOCIATED
from activeslam_gym.slam.kalman import correct, predict
from activeslam_gym.slam.map import add_landmark, delete_failed, follow_tracks, initialisation_of, promote
from activeslam_gym.slam.restart import contradicted, restart, restart_of
from activeslam_gym.slam.sight import (
    IMAGE_PRODUCT_FRAMES,
    INSIDE,
    PRODUCT_FRAMES,
    Sight,
    pixel_rows,
    sight_of_belief,
)

FILTER, filter_of = constants(
    Scenario(),
    association=association_of,
    appearance=appearance_of,
    initialisation=initialisation_of,
    particles=particles_of,
    restart=restart_of,
)
"""Constants of the filter."""
COUNTS = record(
    initialised="i8",
    conversions="i8",
    deletions="i8",
    rejected_matches="i8",
    restarts="i8",  # times that the belief was reset
)
"""Counters that a frame adds to; any record with these fields will do."""


@compiled
def filter_frame(
    models: Record,
    belief: Belief,
    fiducials: np.ndarray,
    boxes: np.ndarray,
    u: np.ndarray,
    detections: np.ndarray,
    labelled: bool,
    counts: Record,
) -> None:
    """Advance the belief by one frame; sets ``detections.match`` (M,), of new features too.

    ``u`` (6,) are the accelerations that the filter knows, ``boxes`` those that it knows to occlude. ``labelled``:
    the detections' ids are certain; one without an id is of nothing known.
    """
    predict(models.motion, belief, u, models.motion.dt)
    sight = sight_of_belief(models.camera, belief, fiducials, boxes)
    use_detections(models, belief, fiducials, boxes, sight, detections, labelled, counts)
    initialise(models, belief, detections, counts)


@compiled
def initialise(models: Record, belief: Belief, detections: np.ndarray, counts: Record) -> None:
    """Initialise features at detections (M,) that nothing explained for several frames; sets their ``match``."""
    model = models.filter
    for i in follow_tracks(models.camera, model.initialisation, belief, detections):
        one = detections[i]
        one.match = add_landmark(models.camera, model.initialisation, model.particles, belief, one.pixel, one.R)
        counts.initialised += one.match != NEW


@compiled
def use_detections(
    models: Record,
    belief: Belief,
    fiducials: np.ndarray,
    boxes: np.ndarray,
    sight: Sight,
    detections: np.ndarray,
    labelled: bool,
    counts: Record,
) -> None:
    """Associate, update, count misses, turn features into points and delete those that failed.

    Where the fiducials contradict the belief, it is reset instead.
    """
    model, v = models.filter, sight.point.shape[0]
    waits = np.zeros(v, np.bool_)
    if labelled:
        of_point = match_by_id(sight, detections)
    else:
        of_point = associate(model.association, sight, detections, belief.state.count, waits)
    if belief.particles.shape[1] > 0:
        follow_rays(models.camera, model.particles, belief, boxes, detections, labelled)
    for one in detections:
        counts.rejected_matches += one.match == REJECTED
    if contradicted(model.restart, belief, sight, detections, of_point, waits):
        counts.deletions += belief.state.count
        counts.restarts += 1
        restart(model.restart, belief)
        detections["match"][:] = REJECTED
        return
    count_misses(model.initialisation, belief, fiducials.shape[0], sight, of_point, waits)
    lasts = models.camera.command_known or fiducials.shape[0] > 0
    update_by(models.camera, belief, fiducials, sight, of_point, detections, PRODUCT_FRAMES if lasts else 1.0)
    counts.conversions += promote(model.initialisation, belief)
    counts.deletions += delete_failed(model.initialisation, belief)


@compiled
def use_identified(
    models: Record,
    belief: Belief,
    fiducials: np.ndarray,
    sight: Sight,
    detections: np.ndarray,
    least: int,
    counts: Record,
) -> None:
    """Associate detections that bear ids, update, and turn features into points; see `appearance`.

    No misses are counted and nothing is deleted: the searcher knows which predictions it searched, and may come again
    in the same frame.
    """
    of_point = associate_identified(models.filter.appearance, sight, detections, least)
    for one in detections:
        counts.rejected_matches += one.match == REJECTED
    everything = np.ones(of_point.shape[0], np.bool_)
    count_misses(models.filter.initialisation, belief, fiducials.shape[0], sight, of_point, everything)
    frames = IMAGE_PRODUCT_FRAMES if models.camera.command_known else 1.0
    update_by(models.camera, belief, fiducials, sight, of_point, detections, frames)
    counts.conversions += promote(models.filter.initialisation, belief)


@compiled
def match_by_id(sight: Sight, detections: np.ndarray) -> np.ndarray:
    """(v,) the likeliest detection that bears each prediction's id, or -1; sets ``detections.match`` to their ids."""
    of_point = np.full(sight.point.shape[0], -1)
    for i in range(detections.shape[0]):
        detections[i].match = detections[i].id if detections[i].id != UNASSOCIATED else NEW
        for a in range(of_point.shape[0]):
            rival = of_point[a]
            if detections[i].id == sight.point[a].id and (
                rival < 0 or detections[i].log_ratio > detections[rival].log_ratio
            ):
                of_point[a] = i
    return of_point


@borrowing
def count_misses(model: Record, belief: Belief, K: int, sight: Sight, of_point: np.ndarray, waits: np.ndarray) -> None:
    """A match clears a feature's misses; being predicted well inside the image without a detection near adds one.
    Remembers which were crowded.

    Misses from places less than ``miss_spacing`` [m] apart count once: what hides a feature hides it from all of them.
    """
    camera, spacing = belief.state.camera, model.miss_spacing
    for a in range(of_point.shape[0]):
        point = sight.point[a]
        if point.row < K:
            continue
        feature = belief.feature[point.row - K]
        if point.crowded == 0:
            feature.crowded = belief.state.frame
        if of_point[a] >= 0:
            feature.misses, feature.seen = 0, belief.state.frame
        elif point.visibility == INSIDE and not waits[a]:
            if feature.misses == 0 or spacing == 0.0 or distance_between(feature.missed_at, camera) > spacing:
                feature.misses += 1
                copy_into(feature.missed_at, camera[POSITION])


@compiled
def update_by(
    lens: Record,
    belief: Belief,
    fiducials: np.ndarray,
    sight: Sight,
    of_point: np.ndarray,
    detections: np.ndarray,
    frames: float,
) -> None:
    """Correct by the matched predictions, each with the R of its own detection.

    So many ``frames`` tell of the curvature of a feature what one does (see `PRODUCT_FRAMES`), so each is given as many
    times that noise.
    """
    matched = np.flatnonzero(of_point >= 0)
    if matched.shape[0] == 0:
        return
    rows = pixel_rows(matched)
    points, HP, S = sight.point[matched], np.empty((rows.shape[0], sight.HP.shape[1])), submatrix(sight.S, rows)
    more_frames, pixels = frames - 1.0, np.empty(rows.shape[0])
    for r in range(rows.shape[0]):
        point, detection, i = points[r // 2], detections[of_point[matched[r // 2]]], r % 2
        copy_into(HP[r], sight.HP[rows[r]])
        pixels[r] = detection.pixel[i]
        for axis in range(2):
            more = more_frames * point.curvature[i, axis]
            S[r, r - i + axis] += detection.R[i, axis] - point.R[i, axis] + more
            point.R[i, axis] = detection.R[i, axis]
            point.curvature[i, axis] += more
    correct(lens, belief, fiducials, Sight(points, HP, S), pixels)
