"""Information: the entropy of a belief, and what a pose would teach (mutual and Fisher information, variance).

Everything here works on the *public* belief, in which each feature is a point with a (12 + 3 n)^2 joint covariance.
For a feature that the filter holds in other parameters nothing is lost: both linearise at the same mean, so by the
chain rule H_point T P T^T H_point^T is the filter's own innovation covariance.

Mutual information is never taken from determinants of P: by the determinant lemma it is 1/2 log2(|S| / |R|), with S
stacked over all predicted measurements. The same number, O(m^3), and no singularity for a fully correlated map. (The
idea in general: Kopitkov and Indelman, "No belief propagation required", IJRR 2017.)
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from activeslam_gym.camera import CameraModel, inside_image
from activeslam_gym.compilation import kernel, part
from activeslam_gym.geometry import rotate_left, rotation_matrix
from activeslam_gym.linalg import (
    cholesky_in_place,
    copy_into,
    log2_det,
    log2_det_3,
    log2_det_of_factor,
    solve_transposed,
    solve_transposed_vector,
    subtract_gram,
)
from activeslam_gym.motion import (
    CAMERA_DIM,
    CAMERA_SIZE,
    GAZE_COUNT,
    MOTION_COUNT,
    POSITION,
    QUATERNION,
    Gaze,
    MotionModel,
    goal_of,
    open_loop,
    turn_of,
)
from activeslam_gym.slam.belief import FEATURES, FREE, RAY, Belief, point_marginal
from activeslam_gym.slam.measurement import POSE_DIM, point_measurement
from activeslam_gym.slam.prediction import propagate

_STAY_GAZE = int(Gaze.STAY)
LOG2_2PIE = math.log2(2.0 * math.pi * math.e)

# Expected landmarks and entropy -------------------------------------------------------------------------------------


class Expectation(NamedTuple):
    """The landmarks that the room is expected to hold: the reason not to stay at home. N of them."""

    points: np.ndarray
    """(N, 3) where they are expected [m]; uncorrelated with the truth."""
    variance: np.ndarray
    """(3,) their prior variance along X, Y, Z [m^2]."""
    slot: np.ndarray
    """(N,) slot of the counting feature that has retired it, or -1."""
    serial: np.ndarray
    """(N,) that feature's serial number."""


@part
def update_expectation(expectation: Expectation, belief: Belief) -> None:
    """Retire and bring back expected landmarks, so that exactly the counting features have retired one each.

    A feature counts from the first frame in which the log-determinant of its own point marginal is under the prior's;
    it retires the expected landmark nearest to it (Mahalanobis, with the covariances of both); deleting it brings that
    landmark back. Rays never count. To be called after every frame.
    """
    for e in range(expectation.slot.shape[0]):
        slot = expectation.slot[e]
        if slot >= 0 and (belief.kind[slot] == FREE or belief.serial[slot] != expectation.serial[e]):
            expectation.slot[e] = -1
    variance = expectation.variance
    bound = math.log2(variance[0] * variance[1] * variance[2])
    P_y = np.empty((3, 3))
    for k in range(belief.size[FEATURES]):
        slot = belief.order[k]
        if belief.kind[slot] == RAY or counts(expectation.slot, slot):
            continue
        y = point_marginal(belief, slot, P_y)
        if log2_det_3(P_y) < bound:  # False for NaN
            e = _nearest_expected(expectation, y, P_y)
            if e < 0:
                return
            expectation.slot[e] = slot
            expectation.serial[e] = belief.serial[slot]


@part
def _nearest_expected(expectation: Expectation, y: np.ndarray, P_y: np.ndarray) -> int:
    """Index of the waiting expected landmark nearest to the feature ``y`` (3,) with covariance ``P_y``, or -1."""
    U = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            U[i, j] = P_y[i, j] + (expectation.variance[i] if i == j else 0.0)
    cholesky_in_place(U)
    best, nearest = -1, np.inf
    d = np.empty(3)
    for e in range(expectation.slot.shape[0]):
        if expectation.slot[e] < 0:
            for i in range(3):
                d[i] = expectation.points[e, i] - y[i]
            solve_transposed_vector(U, d)
            square = d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
            if square < nearest:
                best, nearest = e, square
    return best


@part
def counts(retired: np.ndarray, slot: int) -> bool:
    """Whether the slot's feature counts: whether it is one of those that have ``retired`` (N,) an expected landmark."""
    for e in range(retired.shape[0]):
        if retired[e] == slot:
            return True
    return False


@part
def find_counting(expectation: Expectation, belief: Belief) -> np.ndarray:
    """(n,) bool: which features of the public belief, oldest first, count."""
    out = np.empty(belief.size[FEATURES], np.bool_)
    for k in range(belief.size[FEATURES]):
        out[k] = counts(expectation.slot, belief.order[k])
    return out


@part
def waiting_count(expectation: Expectation) -> int:
    """How many expected landmarks no feature has retired."""
    count = 0
    for slot in expectation.slot:
        if slot < 0:
            count += 1
    return count


@part
def gathered(covariance: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """The public covariance reordered: features ``before`` (by position k), the camera, features ``after``."""
    m, size = 3 * before.shape[0], CAMERA_DIM + 3 * (before.shape[0] + after.shape[0])
    rows = np.empty(size, np.int64)
    for i in range(size):
        if i < m:
            rows[i] = CAMERA_DIM + 3 * before[i // 3] + i % 3
        elif i < m + CAMERA_DIM:
            rows[i] = i - m
        else:
            rows[i] = CAMERA_DIM + 3 * after[(i - m - CAMERA_DIM) // 3] + (i - m) % 3
    out = np.empty((size, size))
    for i in range(size):
        source = covariance[rows[i]]
        for j in range(size):
            out[i, j] = source[rows[j]]
    return out


CAMERA, MAP, TOTAL, POSE = 0, 1, 2, 3
"""Entries of `log2_dets`."""


@part
def log2_dets(
    expectation: Expectation, covariance: np.ndarray, U: np.ndarray, first: np.ndarray, second: np.ndarray
) -> np.ndarray:
    """log2 |P| of camera (12), map (3 N), total (12 + 3 N) and pose (6), at a dimension that never changes.

    An expected landmark that no feature has retired holds its prior: |P| = |P_counted| |Sigma_prior|^(N - m).
    ``U`` is the factor of `gathered(covariance, first, second and more)`; the features ``first`` and ``second`` count.
    """
    a, b = 3 * first.shape[0], 3 * second.shape[0]
    waiting = expectation.slot.shape[0] - first.shape[0] - second.shape[0]
    rest = waiting * math.log2(expectation.variance[0] * expectation.variance[1] * expectation.variance[2])
    U_camera = covariance[:CAMERA_DIM, :CAMERA_DIM].copy()
    cholesky_in_place(U_camera)
    out = np.empty(4)
    out[CAMERA] = log2_det_of_factor(U_camera, 0, CAMERA_DIM)
    out[POSE] = log2_det_of_factor(U_camera, 0, POSE_DIM)
    out[TOTAL] = log2_det_of_factor(U, 0, a + CAMERA_DIM + b) + rest
    if b == 0:
        out[MAP] = log2_det_of_factor(U, 0, a) + rest
    else:
        both = np.empty(first.shape[0] + second.shape[0], np.int64)
        copy_into(both, first)
        copy_into(both[first.shape[0] :], second)
        out[MAP] = log2_det(gathered(covariance, both, first[:0])[: a + b, : a + b]) + rest
    return out


def entropy_bits(log2_determinant: float, dimension: int) -> float:
    """H = 1/2 log2((2 pi e)^n |P|) [bit] of a Gaussian of n dimensions."""
    return 0.5 * (dimension * LOG2_2PIE + log2_determinant)


@part
def variance_sums(
    expectation: Expectation, covariance: np.ndarray, first: np.ndarray, second: np.ndarray
) -> tuple[float, float]:
    """(trace of the positions of camera and map [m^2], trace of everything), waiting landmarks at their prior.

    The features ``first`` and ``second``, by position k, count.
    """
    variance = expectation.variance
    waiting = expectation.slot.shape[0] - first.shape[0] - second.shape[0]
    positions = waiting * (variance[0] + variance[1] + variance[2])
    for features in (first, second):
        for k in features:
            for i in range(3):
                positions += covariance[CAMERA_DIM + 3 * k + i, CAMERA_DIM + 3 * k + i]
    everything = positions
    for i in range(CAMERA_DIM):
        everything += covariance[i, i]
    for i in range(3):
        positions += covariance[i, i]
    return positions, everything


# What a pose would teach --------------------------------------------------------------------------------------------

MUTUAL_INFORMATION = "mutual_information"
MUTUAL_INFORMATION_CAMERA = "mutual_information_camera"
MUTUAL_INFORMATION_POSITION_MAP = "mutual_information_position_map"
FISHER_TRACE = "fisher_trace"
FISHER_MAX_EIGENVALUE = "fisher_max_eigenvalue"
VARIANCE_REDUCTION = "variance_reduction"
CRITERIA = {
    MUTUAL_INFORMATION: 0,
    MUTUAL_INFORMATION_CAMERA: 1,
    MUTUAL_INFORMATION_POSITION_MAP: 2,
    FISHER_TRACE: 3,
    FISHER_MAX_EIGENVALUE: 4,
    VARIANCE_REDUCTION: 5,
}
"""Number of each criterion, as the kernels know it."""


def criterion_number(criterion: str) -> int:
    """The kernels' number of a criterion.

    Raises:
        ValueError: there is no such criterion; the message lists those that there are.
    """
    if criterion not in CRITERIA:
        raise ValueError(f"criterion must be one of {', '.join(CRITERIA)}, got {criterion!r}")
    return CRITERIA[criterion]


class Prospect(NamedTuple):
    """What a policy plans with: points to be seen, features of the map and expected landmarks alike. M points."""

    camera: np.ndarray
    """(13,) estimated camera."""
    points: np.ndarray
    """(M, 3) [m]."""
    covariance: np.ndarray
    """(12 + 3 M, 12 + 3 M)."""
    fiducials: np.ndarray
    """(K, 3) points of known position [m]."""


@part
def prospect_of(
    belief: Belief, points: np.ndarray, covariance: np.ndarray, expectation: Expectation, fiducials: np.ndarray
) -> Prospect:
    """The public belief without rays, and the waiting expected landmarks at their prior."""
    keep = np.empty(belief.size[FEATURES], np.int64)
    count = 0
    for k in range(belief.size[FEATURES]):
        if belief.kind[belief.order[k]] != RAY:
            keep[count] = k
            count += 1
    keep = keep[:count]
    waiting = waiting_count(expectation)
    size = CAMERA_DIM + 3 * count
    P = np.zeros((size + 3 * waiting, size + 3 * waiting))
    P[:size, :size] = gathered(covariance, keep[:0], keep)
    out = np.empty((count + waiting, 3))
    for i in range(count):
        out[i] = points[keep[i]]
    for e in range(expectation.slot.shape[0]):
        if expectation.slot[e] < 0:
            out[count] = expectation.points[e]
            for i in range(3):
                P[size + i, size + i] = expectation.variance[i]
            count += 1
            size += 3
    return Prospect(belief.camera.copy(), out, P, fiducials)


class Sight(NamedTuple):
    """The measurements predicted from a pose: v visible things, fiducials first."""

    point: np.ndarray
    """(v,) index of the point, or -1 for a fiducial."""
    H_camera: np.ndarray
    """(v, 2, 6)."""
    H_point: np.ndarray
    """(v, 2, 3), zero for a fiducial."""


@part
def sight_from(camera: CameraModel, prospect: Prospect, pose: np.ndarray) -> Sight:
    """What lies in the image of ``pose`` (>= 7: position, quaternion), with Jacobians. No occlusion."""
    K, M = prospect.fiducials.shape[0], prospect.points.shape[0]
    index = np.empty(K + M, np.int64)
    H_camera, H_point = np.empty((K + M, 2, POSE_DIM)), np.empty((K + M, 2, 3))
    R_WC = rotation_matrix(pose[QUATERNION])
    z = np.empty(2)
    v = 0
    for i in range(K + M):
        y = prospect.fiducials[i] if i < K else prospect.points[i - K]
        if not point_measurement(camera, pose, R_WC, y, z, H_camera[v], H_point[v]):
            continue
        if inside_image(camera, z, 0.0):
            index[v] = -1 if i < K else i - K
            if i < K:
                H_point[v] = 0.0
            v += 1
    return Sight(index[:v], H_camera[:v], H_point[:v])


@part
def measured_covariance(P: np.ndarray, sight: Sight, columns: int) -> np.ndarray:
    """H P[:, :columns], (2 v, columns): covariance of the predicted pixels with the leading part of the state."""
    v = sight.point.shape[0]
    out = np.zeros((2 * v, columns))
    for i in range(v):
        at = CAMERA_DIM + 3 * sight.point[i]
        for axis in range(2):
            row = out[2 * i + axis]
            for k in range(POSE_DIM):
                factor = sight.H_camera[i, axis, k]
                for j in range(columns):
                    row[j] += factor * P[k, j]
            if sight.point[i] >= 0:
                for k in range(3):
                    factor = sight.H_point[i, axis, k]
                    for j in range(columns):
                        row[j] += factor * P[at + k, j]
    return out


@part
def _times_H(HP: np.ndarray, sight: Sight, first_point_column: np.ndarray, pixel_var: float) -> np.ndarray:
    """S (2 v, 2 v) = HP H^T + R, where thing i's point stands in the columns of HP from first_point_column[i] on."""
    m = HP.shape[0]
    S = np.empty((m, m))
    for c in range(m):
        i, axis = c // 2, c % 2
        at = first_point_column[i]
        for r in range(c + 1):
            value = pixel_var if r == c else 0.0
            for k in range(POSE_DIM):
                value += HP[r, k] * sight.H_camera[i, axis, k]
            if sight.point[i] >= 0:
                for k in range(3):
                    value += HP[r, at + k] * sight.H_point[i, axis, k]
            S[r, c] = value
            S[c, r] = value
    return S


@part
def seen_covariance(P: np.ndarray, sight: Sight) -> tuple[np.ndarray, np.ndarray]:
    """(covariance of the camera and the v things in view only, (12 + 3 v)^2; first column of each of them)."""
    v = sight.point.shape[0]
    rows = np.empty(CAMERA_DIM + 3 * v, np.int64)
    rows[:CAMERA_DIM] = np.arange(CAMERA_DIM)
    first = np.empty(v, np.int64)
    size = CAMERA_DIM
    for i in range(v):
        first[i] = size
        if sight.point[i] >= 0:
            for k in range(3):
                rows[size + k] = CAMERA_DIM + 3 * sight.point[i] + k
            size += 3
    out = np.empty((size, size))
    for i in range(size):
        for j in range(size):
            out[i, j] = P[rows[i], rows[j]]
    return out, first


@part
def innovation_of(P: np.ndarray, sight: Sight, pixel_var: float) -> tuple[np.ndarray, np.ndarray]:
    """(S (2 v, 2 v), covariance of the predicted pixels with the camera's 12 dimensions (2 v, 12))."""
    inner, first = seen_covariance(P, sight)
    local = Sight(_local_point(sight.point, first), sight.H_camera, sight.H_point)
    HP = measured_covariance(inner, local, inner.shape[0])
    return _times_H(HP, local, first, pixel_var), HP[:, :CAMERA_DIM].copy()


@part
def _local_point(index: np.ndarray, first: np.ndarray) -> np.ndarray:
    out = np.empty_like(index)
    for i in range(index.shape[0]):
        out[i] = (first[i] - CAMERA_DIM) // 3 if index[i] >= 0 else -1
    return out


@part
def score(camera: CameraModel, prospect: Prospect, P: np.ndarray, pose: np.ndarray, criterion: int) -> float:
    """What ``pose`` would teach with the covariance ``P``, by the criterion of that number; 0 with nothing in view."""
    sight = sight_from(camera, prospect, pose)
    if sight.point.shape[0] == 0:
        return 0.0
    pixel_var = camera.pixel_std**2
    if criterion == 0:
        S, _ = innovation_of(P, sight, pixel_var)
        return half_log2_ratio(S, pixel_var)
    if criterion == 1:
        S, cross = innovation_of(P, sight, pixel_var)
        return mutual_information_with(S, cross, P[:CAMERA_DIM, :CAMERA_DIM].copy())
    if criterion == 2:
        return _position_map_information(P, sight, pixel_var)
    if criterion == 3:
        return fisher_trace(P, sight, pixel_var)
    if criterion == 4:
        return fisher_max_eigenvalue(P, sight, pixel_var)
    return variance_reduction(P, sight, pixel_var)


@part
def half_log2_ratio(S: np.ndarray, pixel_var: float) -> float:
    """I(x; z) = 1/2 log2(|S| / |R|) [bit]."""
    return 0.5 * (log2_det(S) - S.shape[0] * math.log2(pixel_var))


@part
def mutual_information_with(S: np.ndarray, cross: np.ndarray, P_part: np.ndarray) -> float:
    """I(part; z) = 1/2 log2(|S| / |S - C P_part^-1 C^T|) [bit], ``cross`` C = cov(z, part) (m, d)."""
    whole = log2_det(S)
    V = cross.T.copy()
    U = P_part.copy()
    if not cholesky_in_place(U):
        return np.nan
    solve_transposed(U, V)
    subtract_gram(S, V, S.shape[0])
    return 0.5 * (whole - log2_det(S))


@part
def _position_map_information(P: np.ndarray, sight: Sight, pixel_var: float) -> float:
    """I(position and map; z): the live system's measure, which leaves gaze and velocities out (section V).

    Given position and map, a pixel varies only by the camera's rotation; what the invisible part of the map tells
    of that rotation counts as well, so the part is the whole map.
    """
    size = P.shape[0]
    S, _ = innovation_of(P, sight, pixel_var)
    HP = measured_covariance(P, sight, size)
    kept = np.concatenate((np.arange(3), np.arange(CAMERA_DIM, size)))
    part = np.empty((kept.shape[0], kept.shape[0]))
    cross = np.empty((HP.shape[0], kept.shape[0]))
    for i in range(kept.shape[0]):
        for j in range(kept.shape[0]):
            part[i, j] = P[kept[i], kept[j]]
        for r in range(HP.shape[0]):
            cross[r, i] = HP[r, kept[i]]
    return mutual_information_with(S, cross, part)


@part
def _own_innovation(S: np.ndarray, i: int) -> tuple[float, float, float]:
    """Inverse (a, b, c) = [[a, b], [b, c]] of thing i's own 2 x 2 block of S."""
    p, q, r = S[2 * i, 2 * i], S[2 * i, 2 * i + 1], S[2 * i + 1, 2 * i + 1]
    det = p * r - q * q
    return r / det, -q / det, p / det


@part
def fisher_trace(P: np.ndarray, sight: Sight, pixel_var: float) -> float:
    """tr J of J = sum_i H_i^T S_i^-1 H_i over the tangent (section III-B), literally.

    It mixes units and depends on the parameterisation; mostly it counts features whose image is predictable.
    """
    S, _ = innovation_of(P, sight, pixel_var)
    total = 0.0
    for i in range(sight.point.shape[0]):
        a, b, c = _own_innovation(S, i)
        for k in range(POSE_DIM + 3):
            h0 = sight.H_camera[i, 0, k] if k < POSE_DIM else sight.H_point[i, 0, k - POSE_DIM]
            h1 = sight.H_camera[i, 1, k] if k < POSE_DIM else sight.H_point[i, 1, k - POSE_DIM]
            total += a * h0 * h0 + 2.0 * b * h0 * h1 + c * h1 * h1
    return total


@part
def fisher_max_eigenvalue(P: np.ndarray, sight: Sight, pixel_var: float) -> float:
    """Largest eigenvalue of the same J (the end of section III-B), from its small twin.

    With A = blockdiag(L_i^-1) H, J = A^T A; A A^T (2 v, 2 v) has the same non-zero eigenvalues.
    """
    S, _ = innovation_of(P, sight, pixel_var)
    v = sight.point.shape[0]
    A_camera, A_point = np.empty((2 * v, POSE_DIM)), np.empty((2 * v, 3))
    for i in range(v):
        l00 = math.sqrt(S[2 * i, 2 * i])
        l10 = S[2 * i + 1, 2 * i] / l00
        l11 = math.sqrt(S[2 * i + 1, 2 * i + 1] - l10 * l10)
        A_camera[2 * i] = sight.H_camera[i, 0] / l00
        A_camera[2 * i + 1] = (sight.H_camera[i, 1] - l10 * A_camera[2 * i]) / l11
        A_point[2 * i] = sight.H_point[i, 0] / l00
        A_point[2 * i + 1] = (sight.H_point[i, 1] - l10 * A_point[2 * i]) / l11
    G = np.zeros((2 * v, 2 * v))
    for r in range(2 * v):
        for c in range(2 * v):
            for k in range(POSE_DIM):
                G[r, c] += A_camera[r, k] * A_camera[c, k]
            if r // 2 == c // 2:
                for k in range(3):
                    G[r, c] += A_point[r, k] * A_point[c, k]
    return np.linalg.eigvalsh(G)[-1]


@part
def variance_reduction(P: np.ndarray, sight: Sight, pixel_var: float) -> float:
    """tr(P H^T S^-1 H P): how much the update that is predicted lowers tr P. With U^T U = S it is |U^-T H P|^2."""
    S, _ = innovation_of(P, sight, pixel_var)
    W = measured_covariance(P, sight, P.shape[0])
    if not cholesky_in_place(S):
        return np.nan
    solve_transposed(S, W)
    return np.sum(W * W)


# Candidate actions --------------------------------------------------------------------------------------------------


@part
def pose_after(motion: MotionModel, camera: np.ndarray, index: int, turned: float) -> np.ndarray:
    """The camera (13,) at the clipped goal of a motion, turned about the vertical by ``turned`` [rad], at rest."""
    out = np.zeros(CAMERA_SIZE)
    out[POSITION] = goal_of(motion, camera, index)
    out[QUATERNION] = rotate_left(np.array((0.0, turned, 0.0)), camera[QUATERNION])
    return out


@part
def propagated(motion: MotionModel, P: np.ndarray, turn: float, frames: int) -> np.ndarray:
    """The covariance after ``frames`` frames of turning at ``turn`` [rad/s] without a measurement."""
    F, Q = open_loop(motion, turn, frames)
    out = P.copy()
    propagate(out, P.shape[0], F, Q)
    return out


@part
def joint_scores(
    camera: CameraModel, motion: MotionModel, prospect: Prospect, frames: int, time: float, criterion: int
) -> np.ndarray:
    """(7, 3): each motion with each gaze held for its whole period of ``frames`` frames."""
    out = np.empty((MOTION_COUNT, GAZE_COUNT))
    for gaze in range(GAZE_COUNT):
        out[:, gaze] = motion_scores(camera, motion, prospect, frames, time, criterion, gaze)
    return out


@part
def motion_scores(
    camera: CameraModel,
    motion: MotionModel,
    prospect: Prospect,
    frames: int,
    time: float,
    criterion: int,
    gaze: int,
) -> np.ndarray:
    """(7,): each motion's goal with ``gaze`` held, the covariance propagated over ``frames`` frames."""
    turn = turn_of(motion, gaze, time)
    P = propagated(motion, prospect.covariance, turn, frames)
    out = np.empty(MOTION_COUNT)
    for index in range(MOTION_COUNT):
        pose = pose_after(motion, prospect.camera, index, turn * motion.dt * frames)
        out[index] = score(camera, prospect, P, pose, criterion)
    return out


@part
def motion_score(
    camera: CameraModel,
    motion: MotionModel,
    prospect: Prospect,
    frames: int,
    time: float,
    criterion: int,
    gaze: int,
    index: int,
) -> float:
    """One entry of `motion_scores`, computed alone."""
    turn = turn_of(motion, gaze, time)
    P = propagated(motion, prospect.covariance, turn, frames)
    pose = pose_after(motion, prospect.camera, index, turn * motion.dt * frames)
    return score(camera, prospect, P, pose, criterion)


@part
def gaze_scores(
    camera: CameraModel, motion: MotionModel, prospect: Prospect, frames: int, time: float, criterion: int
) -> np.ndarray:
    """(3,): the present position after ``frames`` frames of each turn."""
    out = np.empty(GAZE_COUNT)
    for gaze in range(GAZE_COUNT):
        turn = turn_of(motion, gaze, time)
        P = propagated(motion, prospect.covariance, turn, frames)
        pose = prospect.camera.copy()
        pose[QUATERNION] = rotate_left(np.array((0.0, turn * motion.dt * frames, 0.0)), pose[QUATERNION])
        out[gaze] = score(camera, prospect, P, pose, criterion)
    return out


@kernel
def lookahead_scores(
    camera: CameraModel, motion: MotionModel, prospect: Prospect, frames: int, time: float, horizon: int
) -> np.ndarray:
    """(7,): mutual information [bit] of each motion followed by the best ``horizon - 1`` more, gaze STAY.

    By the chain rule I(x; z_1, z_2) = I(x; z_1) + I(x; z_2 | z_1): after each motion the covariance is updated by the
    measurements expected there, and propagated on. A tree of 7^horizon poses.
    """
    turn = turn_of(motion, _STAY_GAZE, time)
    F, Q = open_loop(motion, turn, frames)
    P = prospect.covariance.copy()
    propagate(P, P.shape[0], F, Q)
    pixel_var = camera.pixel_std**2
    out = np.empty(MOTION_COUNT)
    for index in range(MOTION_COUNT):
        pose = pose_after(motion, prospect.camera, index, turn * motion.dt * frames)
        sight = sight_from(camera, prospect, pose)
        S, _ = innovation_of(P, sight, pixel_var)
        out[index] = half_log2_ratio(S, pixel_var)
        if horizon > 1:
            P_next = P.copy()
            if sight.point.shape[0] > 0 and cholesky_in_place(S):
                W = measured_covariance(P, sight, P.shape[0])
                solve_transposed(S, W)
                subtract_gram(P_next, W, P.shape[0])
            ahead = Prospect(pose, prospect.points, P_next, prospect.fiducials)
            out[index] += np.max(lookahead_scores(camera, motion, ahead, frames, time, horizon - 1))
    return out
