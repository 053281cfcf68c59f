"""The evaluation of a run against the ground truth: data association by the hidden labels, errors, and the reward."""

import math
from dataclasses import dataclass

import numpy as np

from activeslam_gym.camera import distance_between
from activeslam_gym.envs.reward import REWARDS, potential_of_number
from activeslam_gym.envs.run import NO_OWNER, UNKNOWN, Run
from activeslam_gym.information.entropy import LOG2_2PIE, find_counting, gathered, log2_dets, traces
from activeslam_gym.kernels import borrowing, compiled
from activeslam_gym.linalg import cholesky_in_place
from activeslam_gym.metrics import UNSOUND_LOG_SCORE, camera_error, is_lost, log2_density, nees
from activeslam_gym.motion import CAMERA_DIM, D_POSITION, D_ROTATION
from activeslam_gym.slam.belief import fiducial_id
from activeslam_gym.slam.detection import REJECTED, UNASSOCIATED
from activeslam_gym.slam.estimate import EstimateArrays, index_of
from activeslam_gym.slam.map import free_slot
from activeslam_gym.world.simulator import CLUTTER_LABEL

_ENTROPY = list(REWARDS).index("entropy")
_LOST_PENALTY = len(REWARDS)  # entry of `gains` behind those of the package's rewards
LOSS = 100.0  # the price of a loss, beside all that was gained [bit]


@compiled
def evaluate(run: Run) -> None:
    """Bring the evaluation and the potentials up to date, from the estimate; ``gains`` become the potentials' gains.

    Where its covariance is not positive definite, the log score is UNSOUND_LOG_SCORE and the other potentials keep
    their values.
    """
    estimate, episode, var = run.estimate, run.episode, run.models.landmark_var
    e, N, covariance = episode.evaluation, run.expected.shape[0], estimate.covariance
    counting = find_counting(run.expected, estimate)
    of_landmark = features_of_landmarks(run.owner, N, counting)
    # Features are factored in this order: those that stand for a true landmark, the others that count, the rest.
    standing, others = of_landmark[of_landmark >= 0], counting.copy()
    others[standing] = False
    order = np.concatenate((standing, np.flatnonzero(others), np.flatnonzero(~counting)))
    counted, U = order[: np.sum(counting)], gathered(covariance, standing, order[standing.shape[0] :])
    sound = cholesky_in_place(U)
    _evaluate_errors(run)
    episode.lost_now = is_lost(sound, e.position_error, run.models.task.lost_position_error)
    episode.sound = sound and not math.isnan(e.position_error)
    if sound:
        waiting = N - counted.shape[0]
        log2_dets(var, waiting, covariance, U, counted, standing.shape[0], e)
        e.landmarks = N
        e.entropy = 0.5 * ((CAMERA_DIM + 3 * N) * LOG2_2PIE + e.log2_det_total)
        truth, camera, points = run.world.state.camera, estimate.state.camera, estimate.landmark["point"]
        e.log_density = log2_density(truth, run.world.landmarks, camera, points, var, of_landmark, U)
        e.position_trace, e.trace = traces(var, waiting, covariance, counted)
    else:
        e.log_density = episode.first_density + UNSOUND_LOG_SCORE
    e.log_score = e.log_density - episode.first_density
    for i in range(_LOST_PENALTY):
        potential = potential_of_number(i, e)
        episode.gains[i] = potential - episode.potential[i]
        episode.potential[i] = potential
    episode.entropy_reduction += episode.gains[_ENTROPY]


@compiled
def _evaluate_errors(run: Run) -> None:
    """Errors against the truth, and counts of mapped landmarks."""
    e, estimate = run.episode.evaluation, run.estimate
    error = camera_error(run.world.state.camera, estimate.state.camera)
    p, theta = error[D_POSITION], error[D_ROTATION]
    e.position_error = math.sqrt(p[0] ** 2 + p[1] ** 2 + p[2] ** 2)
    e.orientation_error = math.sqrt(theta[0] ** 2 + theta[1] ** 2 + theta[2] ** 2)
    e.position_nees = nees(p, estimate.covariance[D_POSITION, D_POSITION]) / 3.0
    count, squares = 0, 0.0
    for distance in landmark_errors(run.owner, run.world.landmarks, estimate):
        if not math.isnan(distance):
            count, squares = count + 1, squares + distance * distance
    e.landmarks_mapped, e.distinct_landmarks = np.sum(estimate.landmark["mapped"][: estimate.state.count]), count
    e.landmark_rmse = math.sqrt(squares / count) if count > 0 else np.inf


@borrowing
def begin_score(run: Run) -> None:
    """After the evaluation of the prior: it is the zero of the log score, and nothing is gained or lost yet."""
    episode = run.episode
    episode.first_density = episode.evaluation.log_density
    episode.evaluation.log_score = 0.0
    episode.lost, episode.lost_now = False, False
    episode.gains[:], episode.entropy_reduction = 0.0, 0.0


@borrowing
def give_reward(run: Run, reward: int) -> None:
    """The reward of a step: the gain of the potential ``reward``; where the run is lost, the return is
    min(it, 0) - 100.

    A run can be lost once: the failure penalty is due in the first such step.
    """
    episode = run.episode
    first = episode.lost_now and not episode.lost
    episode.lost = episode.lost or episode.lost_now
    episode.reward = episode.gains[reward]
    episode.total += episode.reward
    lost_penalty = -max(0.0, episode.total) - LOSS if first else 0.0
    episode.gains[_LOST_PENALTY] = lost_penalty
    episode.total += lost_penalty
    episode.reward += lost_penalty


# Data association by the hidden labels --------------------------------------------------------------------------------


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
            entry.id, entry.slot = estimate.landmark[k].id, free_slot(owner["slot"], k)


@compiled
def judge_matches(
    owner: np.ndarray, estimate: EstimateArrays, fiducial_count: int, detections: np.ndarray, labels: np.ndarray
) -> tuple[int, int]:
    """How many of a frame's ``detections`` (M,), with their true ``labels`` (M,), were wrong matches, and features from
    clutter.

    A feature is what the detection of its initialisation was of, for life: no later match frees a false claim, and none
    takes a true one away. Wrong is a match with anything else, and every match of a feature that was initialised from
    clutter; its initialisation is false. Call it after every frame, after `match_to_truth`, so that a feature of which
    nothing is known is a new one.
    """
    wrong, false = 0, 0
    for i in range(detections.shape[0]):
        match, label = detections[i].match, labels[i]
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
