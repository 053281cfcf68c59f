"""The referee: what only those may see who judge, the truth and the labels, and the belief scored against them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from activeslam_gym.kernels import compiled, record
from activeslam_gym.linalg import copy_into
from activeslam_gym.metrics import camera_error, log2_normal_of_factor
from activeslam_gym.motion import CAMERA_DIM
from activeslam_gym.slam.belief import Belief, position_of
from activeslam_gym.world.simulator import World

OWNER = record(
    serial="i8",  # id of the slot's feature, of which the rest is told
    landmark="i8",  # index of the true landmark that most of its detections were of, or NOBODY
)
"""Whose detections the feature in a slot was made of."""
NOBODY = -1


@dataclass(frozen=True)
class Truth:
    """What really is; for referees, never for policies. Read-only copies. Of a batch, with a leading axis."""

    position: np.ndarray
    """(3,) [m]."""
    quaternion: np.ndarray
    """(4,) q_WC, scalar first."""
    velocity: np.ndarray
    """(3,) [m/s], world frame."""
    angular_velocity: np.ndarray
    """(3,) [rad/s], world frame."""
    landmarks: np.ndarray
    """(L, 3) [m]."""
    fiducials: np.ndarray
    """(K, 3) [m]."""


@dataclass(frozen=True)
class Labels:
    """Whose each feature is, and what was seen in the last frame; for referees, never for policies. Copies."""

    owners: np.ndarray
    """(n,) index of the true landmark that the public belief's k-th feature stands for, or -1."""
    detected: np.ndarray
    """(d,) what each detection was of: k for fiducial k, K + l for landmark l, -1 for clutter."""
    matched: np.ndarray
    """(d,) what the filter took it for: the id of a feature (a birth's, too), -1 - k for fiducial k; 0: nothing known;
    a number below -K: too ambiguous to be used."""


@compiled
def vote(
    owner: np.ndarray,
    votes: np.ndarray,
    belief: Belief,
    fiducial_count: int,
    candidates: np.ndarray,
    labels: np.ndarray,
) -> int:
    """Record a frame's matches, ``candidates.match`` (M,), with their ``labels`` (M,); returns how many were wrong.

    Wrong: a fiducial matched to something else, or a feature matched to another point than most of its detections.
    Call it after the frame, whose births start with no votes. ``votes`` (F, P + 1), by slot: detections of each true
    point, and of clutter, that its feature was matched to.
    """
    for k in range(belief.state.count):
        feature = belief.feature[k]
        if owner[feature.slot].serial != feature.serial:
            owner[feature.slot].serial, owner[feature.slot].landmark = feature.serial, NOBODY
            votes[feature.slot] = 0
    wrong = 0
    for i in range(candidates.shape[0]):
        match = candidates[i].match
        k = position_of(belief, match) if match > 0 else -1
        if k >= 0:
            slot = belief.feature[k].slot
            votes[slot, labels[i]] += 1  # clutter, -1, is the last column
            best = int(np.argmax(votes[slot]))
            owner[slot].landmark = _owned_landmark(votes[slot], best, fiducial_count)
            wrong += labels[i] != best
        elif -fiducial_count <= match < 0:
            wrong += labels[i] != -1 - match
    return wrong


@compiled
def _owned_landmark(votes: np.ndarray, best: int, fiducial_count: int) -> int:
    """The landmark with the most votes, ``best``, if it is one and has more than half of them, or NOBODY."""
    is_landmark = fiducial_count <= best < votes.shape[0] - 1
    return best - fiducial_count if is_landmark and 2 * votes[best] > votes.sum() else NOBODY


@compiled
def owners_of(owner: np.ndarray, belief: Belief) -> np.ndarray:
    """(n,) the landmark of each feature, oldest first, or NOBODY."""
    out = np.empty(belief.state.count, np.int64)
    for k in range(out.shape[0]):
        out[k] = owner[belief.feature[k].slot].landmark
    return out


@compiled
def features_of_landmarks(owners: np.ndarray, landmark_count: int, eligible: np.ndarray) -> np.ndarray:
    """(L,) for each true landmark the oldest ``eligible`` (n,) feature that it owns, by position k, or -1."""
    out = np.full(landmark_count, -1)
    for k in range(owners.shape[0]):
        if eligible[k] and owners[k] != NOBODY and out[owners[k]] < 0:
            out[owners[k]] = k
    return out


@compiled
def landmark_errors(landmarks: np.ndarray, points: np.ndarray, of_landmark: np.ndarray) -> np.ndarray:
    """(L,) distance [m] of each true landmark's feature from it; NaN where it has none."""
    out = np.full(of_landmark.shape[0], np.nan)
    for i in range(of_landmark.shape[0]):
        if of_landmark[i] >= 0:
            y, y_hat = landmarks[i], points[of_landmark[i]]
            out[i] = math.sqrt((y[0] - y_hat[0]) ** 2 + (y[1] - y_hat[1]) ** 2 + (y[2] - y_hat[2]) ** 2)
    return out


@compiled
def log2_density(
    world: World, belief: Belief, landmark_var: np.ndarray, points: np.ndarray, of_landmark: np.ndarray, U: np.ndarray
) -> float:
    """log2 N(truth | belief) over the camera and all true landmarks [bit]: a proper score.

    ``of_landmark`` (L,): the counting feature, by position k, that stands for each landmark; one without is scored by
    the room's prior; features that stand for none are marginalised out. ``U`` is a factor of the public covariance
    that begins with the features of ``of_landmark``, in its order, and the camera.
    """
    error = np.empty(3 * of_landmark.shape[0] + CAMERA_DIM)
    rest, at = 0.0, 0
    for i in range(of_landmark.shape[0]):
        y, k = world.landmarks[i], of_landmark[i]
        for axis in range(3):
            if k >= 0:
                error[at] = y[axis] - points[k, axis]
                at += 1
            else:
                variance = landmark_var[axis]
                rest -= 0.5 * (math.log2(2.0 * math.pi * variance) + y[axis] ** 2 / variance * math.log2(math.e))
    copy_into(error[at:], camera_error(world.state.camera, belief.state.camera))
    return rest + log2_normal_of_factor(error[: at + CAMERA_DIM], U)
