"""Negative information: an expected landmark that was looked at and not found is not there; it is expected elsewhere.

Only expected *points* move, of which the criteria and the observation make what is to be seen. Entropy, the threshold
of counting and the unmapped part of the log score keep the room's prior, so that staring at emptiness gains nothing and
rewards telescope as before.

A point is looked at once a viewpoint, when it has stood well inside the image for longer than an initialisation takes:
frames from one place are not independent. A look misses what is there with the probability 1 - P_D, and is no
evidence then. A disproved point is redrawn where no viewpoint of this run would have seen it: in the room, or on its
walls where landmarks are on surfaces. Draw r of point e is one of (key, e, r), so that no other point's fate changes
it.
"""

import math

import numpy as np

from activeslam_gym.camera import hidden, view_of, visible
from activeslam_gym.envs.run import Run, known_boxes
from activeslam_gym.information.entropy import VIEW, WAITING
from activeslam_gym.kernels import Record, borrowing, compiled
from activeslam_gym.linalg import copy_into
from activeslam_gym.world.noise import uniforms

VIEWS = 64  # viewpoints that a run remembers, the last ones
SAME_DISTANCE, SAME_COSINE = 0.3, 0.98
"""Two viewpoints are one if they are nearer to each other [m] and their axes differ by less (0.2 rad)."""
WELL_INSIDE_PX = 20.0  # a point is looked at so far inside the image [px]
TRIES = 24  # draws of which the first that no viewpoint would have seen is taken; else the last


@compiled
def disprove(run: Run) -> None:
    """One frame from the estimated pose: move the expected landmarks that it disproves."""
    models, boxes, expected, view = run.models, known_boxes(run), run.expected, run.viewpoint
    lens, pose = models.lens, run.estimate.state.camera
    frames = models.filter.initialisation.new_feature_detections + 2
    here, present, z = np.empty(1, VIEW), view_of(lens, pose, boxes), np.empty(2)
    copy_into(here[0].pose, pose[:7])
    copy_into(here[0].axis, present.R_WC[:, 2])
    run.episode.views = _remember(view, run.episode.views, here[0])
    for e in range(expected.shape[0]):
        one = expected[e]
        if one.feature != WAITING:
            continue
        if one.hidden or not visible(present, one.point, -WELL_INSIDE_PX, z):
            one.looked = min(one.looked, 0)
        elif one.looked >= 0 or not _same_view(one.looked_from, here[0]):
            one.looked = max(one.looked, 0) + 1
        if one.looked < frames:
            continue
        draws = uniforms(run.episode.redraw_key, (4096 * e + one.redraws % 4096) * (3 * TRIES + 1), 3 * TRIES + 1)
        one.redraws += 1
        if draws[3 * TRIES] < models.filter.association.detection_probability:
            one.looked = 0
            entered = view[: min(run.episode.views, view.shape[0])]
            _draw_anew(models, boxes, draws, entered, one.point)
        else:  # missed from here, whatever is there
            one.looked, one.looked_from = -1, here[0]


@borrowing
def _remember(view: np.ndarray, seen: int, here: Record) -> int:
    """Enter a viewpoint, if it is a new one, in the place of the oldest; returns how many were entered."""
    for v in range(min(seen, view.shape[0])):
        if _same_view(view[v], here):
            return seen
    view[seen % view.shape[0]] = here
    return seen + 1


@borrowing
def _same_view(a: Record, b: Record) -> bool:
    square, cosine = 0.0, 0.0
    for i in range(3):
        square += (a.pose[i] - b.pose[i]) ** 2
        cosine += a.axis[i] * b.axis[i]
    return square < SAME_DISTANCE**2 and cosine > SAME_COSINE


@compiled
def _draw_anew(models: Record, boxes: np.ndarray, draws: np.ndarray, view: np.ndarray, y: np.ndarray) -> None:
    """Write a point of the room, or of its walls, by ``draws`` (3 TRIES + 1,), into ``y`` (3,)."""
    lens, half, z = models.lens, models.motion.half, np.empty(2)
    for t in range(TRIES):
        for i in range(3):
            y[i] = half[i] * (2.0 * draws[3 * t + i] - 1.0)
        if models.on_surfaces:  # each of the four walls with a chance of its area
            side = draws[3 * t + 2] * (half[0] + half[2])
            if side < half[2]:
                y[0], y[2] = math.copysign(half[0], side - 0.5 * half[2]), half[2] * (2.0 * draws[3 * t] - 1.0)
            else:
                y[2] = math.copysign(half[2], side - half[2] - 0.5 * half[0])
        unseen = models.on_surfaces or not hidden(boxes, y, y)  # and in no known box
        for v in range(view.shape[0]):
            pose = view[v].pose
            earlier = view_of(lens, pose, boxes)
            unseen = unseen and not visible(earlier, y, -WELL_INSIDE_PX, z)
        if unseen:
            return
