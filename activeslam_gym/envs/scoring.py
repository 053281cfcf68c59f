"""Score the belief against the truth, by labels that the filter never sees."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from activeslam_gym.compilation import part
from activeslam_gym.information import Expectation
from activeslam_gym.linalg import copy_into
from activeslam_gym.metrics import camera_error, log2_normal_of_factor
from activeslam_gym.motion import CAMERA_DIM
from activeslam_gym.slam.belief import FEATURES, FREE, Belief, depth_ratio
from activeslam_gym.world.simulator import World


class Labels(NamedTuple):
    """Whose detections each feature was made of. F slots, P true points."""

    votes: np.ndarray
    """(F, P + 1) detections of each true point that were matched to the slot's feature; the last column: clutter."""
    serial: np.ndarray
    """(F,) serial number of the feature that the votes are of."""
    owner: np.ndarray
    """(F,) index of the true landmark that most of the feature's detections were of, or -1."""


@part
def vote(labels: Labels, belief: Belief, fiducial_count: int, match: np.ndarray, truth: np.ndarray) -> int:
    """Record the matches (M,) of a frame with their true labels ``truth`` (M,); returns how many were wrong.

    Wrong: a fiducial matched to something else, or a feature matched to another point than most of its detections.
    Call it after the frame, whose births start with no votes.
    """
    wrong = 0
    for slot in range(belief.kind.shape[0]):
        if belief.kind[slot] != FREE and labels.serial[slot] != belief.serial[slot]:
            labels.serial[slot] = belief.serial[slot]
            labels.votes[slot] = 0
            labels.owner[slot] = -1
    for i in range(match.shape[0]):
        if match[i] < 0:
            continue
        slot = match[i] - fiducial_count
        if slot < 0:
            wrong += truth[i] != match[i]
        elif belief.kind[slot] != FREE:
            labels.votes[slot, truth[i]] += 1  # clutter, -1, is the last column
            best = int(np.argmax(labels.votes[slot]))
            labels.owner[slot] = _owned_landmark(labels.votes[slot], best, fiducial_count)
            wrong += truth[i] != best
    return wrong


@part
def _owned_landmark(votes: np.ndarray, best: int, fiducial_count: int) -> int:
    """The landmark with the most votes, ``best``, if it is one and has more than half of them, or -1."""
    is_landmark = fiducial_count <= best < votes.shape[0] - 1
    return best - fiducial_count if is_landmark and 2 * votes[best] > votes.sum() else -1


@part
def features_of_landmarks(labels: Labels, belief: Belief, landmark_count: int, eligible: np.ndarray) -> np.ndarray:
    """For each true landmark the oldest eligible feature that is mostly its own, as its position k by age, or -1.

    ``eligible`` (>= n,) bool, by age.
    """
    out = np.full(landmark_count, -1)
    for k in range(belief.size[FEATURES]):
        landmark = labels.owner[belief.order[k]]
        if eligible[k] and landmark >= 0 and out[landmark] < 0:
            out[landmark] = k
    return out


@part
def find_mapped(belief: Belief, ratio: float, out: np.ndarray) -> None:
    """Write into ``out`` (>= n,) bool, by age, whether sigma_depth / depth is under ``ratio``."""
    for k in range(belief.size[FEATURES]):
        out[k] = depth_ratio(belief, belief.order[k]) < ratio


@part
def landmark_errors(world: World, points: np.ndarray, of_landmark: np.ndarray, fiducial_count: int) -> np.ndarray:
    """(L,) distance [m] of each true landmark's feature from it; NaN where it has none."""
    out = np.full(of_landmark.shape[0], np.nan)
    for i in range(of_landmark.shape[0]):
        if of_landmark[i] >= 0:
            y, y_hat = world.points[fiducial_count + i], points[of_landmark[i]]
            out[i] = math.sqrt((y[0] - y_hat[0]) ** 2 + (y[1] - y_hat[1]) ** 2 + (y[2] - y_hat[2]) ** 2)
    return out


@part
def log2_density(
    world: World,
    belief: Belief,
    expectation: Expectation,
    points: np.ndarray,
    of_landmark: np.ndarray,
    U: np.ndarray,
    fiducial_count: int,
) -> float:
    """log2 N(truth | belief) over the camera and all true landmarks [bit]: a proper score.

    ``of_landmark`` (L,): the counting feature, by position k, that stands for each landmark; one without is scored by
    the room's prior; features that stand for none are marginalised out. ``U`` is a factor of the public covariance
    that begins with the features of ``of_landmark``, in its order, and the camera.
    """
    standing = 0
    for k in of_landmark:
        standing += k >= 0
    error = np.empty(3 * standing + CAMERA_DIM)
    rest = 0.0
    at = 0
    for i in range(of_landmark.shape[0]):
        y = world.points[fiducial_count + i]
        if of_landmark[i] >= 0:
            for axis in range(3):
                error[at + axis] = y[axis] - points[of_landmark[i], axis]
            at += 3
        else:
            for axis in range(3):
                variance = expectation.variance[axis]
                rest -= 0.5 * (math.log2(2.0 * math.pi * variance) + y[axis] ** 2 / variance * math.log2(math.e))
    copy_into(error[at:], camera_error(world.camera, belief.camera))
    return rest + log2_normal_of_factor(error, U)
