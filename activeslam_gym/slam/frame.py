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
from activeslam_gym.slam.association import ANYTHING, NEW, REJECTED, associate, association_of
from activeslam_gym.slam.belief import Belief
from activeslam_gym.slam.correction import correct
from activeslam_gym.slam.curvature import IMAGE_PRODUCT_FRAMES, PRODUCT_FRAMES
from activeslam_gym.slam.depth_particles import follow_rays, particles_of
from activeslam_gym.slam.initialisation import delete_failed, follow_tracks, give_birth, initialisation_of, mature
from activeslam_gym.slam.kalman import predict
from activeslam_gym.slam.restart import contradicted, restart, restart_of
from activeslam_gym.slam.sight import INSIDE, Sight, pixel_rows, sight_of_belief

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
    births="i8",
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
        one.match = give_birth(models.camera, model.initialisation, model.particles, belief, one.pixel, one.R)
        counts.births += one.match != NEW


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
    model, v = models.filter, sight.thing.shape[0]
    waits = np.zeros(v, np.bool_)
    if labelled:
        of_thing = match_by_id(sight, detections)
    else:
        of_thing = associate(model.association, sight, detections, belief.state.count, waits)
    if belief.particles.shape[1] > 0:
        follow_rays(models.camera, model.particles, belief, boxes, detections, labelled)
    counts.rejected_matches += np.sum(detections["match"] == REJECTED)
    if contradicted(model.restart, belief, sight, detections, of_thing, waits):
        counts.deletions += belief.state.count
        counts.restarts += 1
        restart(model.restart, belief)
        detections["match"][:] = REJECTED
        return
    _count_misses(model.initialisation, belief, fiducials.shape[0], sight, of_thing, waits)
    lasts = models.camera.command_known or fiducials.shape[0] > 0
    update_by(models.camera, belief, fiducials, sight, of_thing, detections, PRODUCT_FRAMES if lasts else 1.0)
    counts.conversions += mature(model.initialisation, belief)
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
    of_thing = associate_identified(models.filter.appearance, sight, detections, least)
    counts.rejected_matches += np.sum(detections["match"] == REJECTED)
    everything = np.ones(of_thing.shape[0], np.bool_)
    _count_misses(models.filter.initialisation, belief, fiducials.shape[0], sight, of_thing, everything)
    frames = IMAGE_PRODUCT_FRAMES if models.camera.command_known else 1.0
    update_by(models.camera, belief, fiducials, sight, of_thing, detections, frames)
    counts.conversions += mature(models.filter.initialisation, belief)


@compiled
def match_by_id(sight: Sight, detections: np.ndarray) -> np.ndarray:
    """(v,) the likeliest detection that bears each prediction's id, or -1; sets ``detections.match`` to their ids."""
    of_thing = np.full(sight.thing.shape[0], -1)
    for i in range(detections.shape[0]):
        detections[i].match = detections[i].id if detections[i].id != ANYTHING else NEW
        for a in range(of_thing.shape[0]):
            rival = of_thing[a]
            if detections[i].id == sight.thing[a].id and (
                rival < 0 or detections[i].log_ratio > detections[rival].log_ratio
            ):
                of_thing[a] = i
    return of_thing


@borrowing
def _count_misses(model: Record, belief: Belief, K: int, sight: Sight, of_thing: np.ndarray, waits: np.ndarray) -> None:
    """A match clears a feature's misses; being predicted well inside the image without a detection near adds one.
    Remembers which were crowded.

    Misses from places less than ``miss_spacing`` [m] apart count once: what hides a feature hides it from all of them.
    """
    camera, spacing = belief.state.camera, model.miss_spacing
    for a in range(of_thing.shape[0]):
        thing = sight.thing[a]
        if thing.row < K:
            continue
        feature = belief.feature[thing.row - K]
        if thing.crowded == 0:
            feature.crowded = belief.state.frame
        if of_thing[a] >= 0:
            feature.misses, feature.seen = 0, belief.state.frame
        elif thing.visibility == INSIDE and not waits[a]:
            if feature.misses == 0 or spacing == 0.0 or distance_between(feature.missed_at, camera) > spacing:
                feature.misses += 1
                copy_into(feature.missed_at, camera[POSITION])


@compiled
def update_by(
    lens: Record,
    belief: Belief,
    fiducials: np.ndarray,
    sight: Sight,
    of_thing: np.ndarray,
    detections: np.ndarray,
    frames: float,
) -> None:
    """Correct by the matched predictions, each with the R of its own detection.

    So many ``frames`` tell of the curvature of a feature what one does (see `PRODUCT_FRAMES`), so each is given as many
    times that noise.
    """
    matched = np.flatnonzero(of_thing >= 0)
    if matched.shape[0] == 0:
        return
    rows = pixel_rows(matched)
    things, HP, S = sight.thing[matched], np.empty((rows.shape[0], sight.HP.shape[1])), submatrix(sight.S, rows)
    more_frames, pixels = frames - 1.0, np.empty(rows.shape[0])
    for r in range(rows.shape[0]):
        thing, detection, i = things[r // 2], detections[of_thing[matched[r // 2]]], r % 2
        copy_into(HP[r], sight.HP[rows[r]])
        pixels[r] = detection.pixel[i]
        for axis in range(2):
            more = more_frames * thing.curvature[i, axis]
            S[r, r - i + axis] += detection.R[i, axis] - thing.R[i, axis] + more
            thing.R[i, axis] = detection.R[i, axis]
            thing.curvature[i, axis] += more
    correct(lens, belief, fiducials, Sight(things, HP, S), pixels)
