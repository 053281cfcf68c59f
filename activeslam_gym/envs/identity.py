"""Data association by the hidden labels, for the evaluator alone."""

from dataclasses import dataclass

import numpy as np

from activeslam_gym.camera import distance_between
from activeslam_gym.kernels import borrowing, compiled, record
from activeslam_gym.slam.belief import fiducial_id
from activeslam_gym.slam.detection import REJECTED, UNASSOCIATED
from activeslam_gym.slam.estimate import EstimateArrays, index_of
from activeslam_gym.slam.map import free_slot
from activeslam_gym.world.simulator import CLUTTER_LABEL

OWNER = record(
    id="i8",  # of the landmark of the estimate; 0: none
    slot="i8",  # its place in the observation, for life
    label="i8",  # of the detection that initialised it, or UNKNOWN
    landmark="i8",  # index of that true landmark, or NOBODY
)
"""The data association, by hidden labels, of one landmark of the estimate."""
NO_OWNER = -1
UNKNOWN = -2  # the label of a landmark of which no detection is known yet


@dataclass(frozen=True)
class Labels:
    """Data association of the features and the last frame; for the evaluator, never for policies. Copies."""

    owners: np.ndarray
    """(n,) index of the true landmark that the k-th feature was initialised from, or -1."""
    detected: np.ndarray
    """(d,) source of each detection: k for fiducial k, K + l for landmark l, -1 for clutter."""
    matched: np.ndarray
    """(d,) the filter's association: the id of a feature (a new one's, too), -1 - k for fiducial k; 0: nothing known; a
    number below -K: too ambiguous to be used."""


@compiled
def match_to_truth(owner: np.ndarray, estimate: EstimateArrays) -> None:
    """After a frame: let entry k of ``owner`` (F,) be of landmark k of the estimate.

    A landmark that stays keeps its entry. A new one takes the lowest free slot; nothing is known of it yet.
    """
    kept, count = 0, estimate.state.count
    while kept < count and owner[kept].id == estimate.landmark[kept].id:
        kept += 1
    if kept == count and (kept == owner.shape[0] or owner[kept].id == 0):
        return  # the same landmarks as before
    for k in range(kept, owner.shape[0]):
        if owner[k].id > 0 and index_of(estimate, owner[k].id) >= 0:
            owner[kept] = owner[k]
            kept += 1
    for k in range(kept, owner.shape[0]):
        entry = owner[k]
        entry.id, entry.label, entry.landmark = 0, UNKNOWN, NO_OWNER
        if k < count:
            entry.id, entry.slot = estimate.landmark[k].id, free_slot(owner, k)


@compiled
def judge_matches(
    owner: np.ndarray, estimate: EstimateArrays, fiducial_count: int, candidates: np.ndarray, labels: np.ndarray
) -> tuple[int, int]:
    """How many of a frame's ``candidates`` (M,), with their true ``labels`` (M,), were wrong matches, and features from
    clutter.

    A feature is what the detection of its initialisation was of, for life: no later match frees a false claim, and none
    takes a true one away. Wrong is a match with anything else, and every match of a feature that was initialised from
    clutter; its initialisation is false. Call it after every frame, after `match_to_truth`, so that a feature of which
    nothing is known is a new one.
    """
    wrong, false = 0, 0
    for i in range(candidates.shape[0]):
        match, label = candidates[i].match, labels[i]
        k = index_of(estimate, match) if match > 0 else -1
        if k >= 0:
            known = owner[k]
            if known.label == UNKNOWN:
                known.label = label
                known.landmark = label - fiducial_count if label >= fiducial_count else NO_OWNER
                false += label == CLUTTER_LABEL
            else:
                wrong += label != known.label or label == CLUTTER_LABEL
        elif -fiducial_count <= match < 0:
            wrong += fiducial_id(label) != match
    return wrong, false


@borrowing
def true_id(owner: np.ndarray, fiducial_count: int, label: int) -> int:
    """The id of what a detection with that label is of: a fiducial's, or that of the oldest feature of the
    point.

    UNASSOCIATED where the point has no feature yet; REJECTED for clutter, of which nothing shall be made.
    """
    if label == CLUTTER_LABEL:
        return REJECTED
    if label < fiducial_count:
        return fiducial_id(label)
    for entry in owner:
        if entry.id > 0 and entry.label == label:
            return entry.id
    return UNASSOCIATED


@compiled
def features_of_landmarks(owner: np.ndarray, landmark_count: int, eligible: np.ndarray) -> np.ndarray:
    """(L,) for each true landmark the oldest ``eligible`` (n,) feature that it owns, by position k, or -1."""
    out = np.full(landmark_count, -1)
    for k in range(eligible.shape[0]):
        landmark = owner[k].landmark
        if eligible[k] and landmark != NO_OWNER and out[landmark] < 0:
            out[landmark] = k
    return out


@compiled
def landmark_errors(owner: np.ndarray, landmarks: np.ndarray, estimate: EstimateArrays) -> np.ndarray:
    """(L,) distance [m] of each true landmark (L, 3) from its mapped feature; NaN where it has none."""
    out, mapped = np.full(landmarks.shape[0], np.nan), estimate.landmark["mapped"][: estimate.state.count]
    of_landmark = features_of_landmarks(owner, landmarks.shape[0], mapped)
    for i in range(out.shape[0]):
        if of_landmark[i] >= 0:
            out[i] = distance_between(landmarks[i], estimate.landmark[of_landmark[i]].point)
    return out
