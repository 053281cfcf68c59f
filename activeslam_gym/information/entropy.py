"""The entropy of a belief, at a dimension that never changes: a landmark that nobody has found holds its prior.

The room is assumed to hold N landmarks at random points. Such an *expected* landmark waits (WAITING) until a feature is
known better than the prior: the feature retires it, and *counts* from then on. With m features that count

H = 1/2 log2((2 pi e)^n |P|) bits, n = 12 + 3 N, |P| = |P_counted| |Sigma_prior|^(N - m).
"""

import math

import numpy as np

from activeslam_gym.kernels import Record, borrowing, compiled, record
from activeslam_gym.linalg import (
    cholesky_in_place,
    diagonal,
    log2_det,
    log2_det_3,
    log2_det_of_factor,
    solve_transposed_vector,
    submatrix,
    sum_of_squares,
)
from activeslam_gym.motion import CAMERA_DIM
from activeslam_gym.slam.estimate import EstimateArrays, index_of
from activeslam_gym.slam.sight import POSE_DIM

LOG2_2PIE = math.log2(2.0 * math.pi * math.e)
VIEW = record(pose=("f8", 7), axis=("f8", 3))  # a viewpoint: position and quaternion, and the optical axis
EXPECTED = record(
    point=("f8", 3),  # where it is expected [m]; uncorrelated with the truth
    feature="i8",  # id of the counting feature that has retired it, or WAITING
    looked="i8",  # frames that it has been looked at, see `envs.disproof`; -1: to no avail
    looked_from=VIEW,  # and from where
    redraws="i8",  # so far
    hidden="b1",  # whether a sensor of a user's own would not measure it from the present pose
)
"""One expected landmark. Its covariance is that of the uniform room, `landmark_var` (3,) [m^2]."""
WAITING = 0


@compiled
def update_expectation(expected: np.ndarray, landmark_var: np.ndarray, estimate: EstimateArrays) -> None:
    """Retire and bring back expected landmarks, so that exactly the counting features have retired one each.

    A feature counts from the first frame in which the log-determinant of its own point marginal is under the prior's;
    it retires the expected landmark nearest to it (Mahalanobis, with the covariances of both); deleting it brings that
    landmark back. Rays never count. To be called after every frame.
    """
    for e in range(expected.shape[0]):
        if expected[e].feature != WAITING and index_of(estimate, expected[e].feature) < 0:
            expected[e].feature = WAITING
    bound = math.log2(landmark_var[0] * landmark_var[1] * landmark_var[2])
    counting = find_counting(expected, estimate)
    for k in range(estimate.state.count):
        landmark, at = estimate.landmark[k], CAMERA_DIM + 3 * k
        if counting[k] or not landmark.located:
            continue
        P_y = estimate.covariance[at : at + 3, at : at + 3]
        if log2_det_3(P_y) < bound:  # False for NaN
            e = _nearest_expected(expected, landmark_var, landmark.point, P_y)
            if e < 0:
                return
            expected[e].feature = landmark.id


@compiled
def _nearest_expected(expected: np.ndarray, landmark_var: np.ndarray, y: np.ndarray, P_y: np.ndarray) -> int:
    """Index of the waiting expected landmark nearest to the feature ``y`` (3,) with covariance ``P_y``, or -1."""
    U = P_y + diagonal(landmark_var)
    cholesky_in_place(U)
    best, nearest = -1, np.inf
    for e in range(expected.shape[0]):
        if expected[e].feature == WAITING:
            d = expected[e].point - y
            solve_transposed_vector(U, d)
            square = sum_of_squares(d)
            if square < nearest:
                best, nearest = e, square
    return best


@compiled
def find_counting(expected: np.ndarray, estimate: EstimateArrays) -> np.ndarray:
    """(n,) bool: which features, oldest first, count: have retired an expected landmark."""
    out = np.zeros(estimate.state.count, np.bool_)
    for e in range(expected.shape[0]):
        if expected[e].feature != WAITING:
            k = index_of(estimate, expected[e].feature)
            if k >= 0:
                out[k] = True
    return out


@compiled
def waiting_count(expected: np.ndarray) -> int:
    """How many expected landmarks no feature has retired."""
    count = 0
    for one in expected:
        count += one.feature == WAITING
    return count


@compiled
def gathered(covariance: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """The public covariance reordered: features ``before`` (by position k), the camera, features ``after``."""
    m = 3 * before.shape[0]
    rows = np.empty(m + CAMERA_DIM + 3 * after.shape[0], np.int64)
    for i in range(rows.shape[0]):
        if i < m:
            rows[i] = CAMERA_DIM + 3 * before[i // 3] + i % 3
        elif i < m + CAMERA_DIM:
            rows[i] = i - m
        else:
            rows[i] = CAMERA_DIM + 3 * after[(i - m - CAMERA_DIM) // 3] + (i - m) % 3
    return submatrix(covariance, rows)


@compiled
def log2_dets(
    landmark_var: np.ndarray,
    waiting: int,
    covariance: np.ndarray,
    U: np.ndarray,
    counting: np.ndarray,
    standing: int,
    out: Record,
) -> None:
    """Write log2 |P| of camera (12), pose (6), map (3 N) and total (12 + 3 N) into ``out``, which has such fields.

    ``waiting`` landmarks hold their prior. The features ``counting``, by position k, count; ``U`` is the factor of
    `gathered(covariance, the first of them, which are ``standing``, the others and more)`.
    """
    a, b = 3 * standing, 3 * (counting.shape[0] - standing)
    rest = waiting * math.log2(landmark_var[0] * landmark_var[1] * landmark_var[2])
    U_camera = covariance[:CAMERA_DIM, :CAMERA_DIM].copy()
    cholesky_in_place(U_camera)
    out.log2_det_camera = log2_det_of_factor(U_camera, 0, CAMERA_DIM)
    out.log2_det_pose = log2_det_of_factor(U_camera, 0, POSE_DIM)
    out.log2_det_total = log2_det_of_factor(U, 0, a + CAMERA_DIM + b) + rest
    if b == 0:
        out.log2_det_map = log2_det_of_factor(U, 0, a) + rest
    else:
        out.log2_det_map = log2_det(gathered(covariance, counting, counting[:0])[: a + b, : a + b]) + rest


@compiled
def traces(landmark_var: np.ndarray, waiting: int, covariance: np.ndarray, counting: np.ndarray) -> tuple[float, float]:
    """(trace of the positions of camera and map [m^2], trace of everything), ``waiting`` landmarks at their prior.

    The features ``counting``, by position k, count.
    """
    points = waiting * (landmark_var[0] + landmark_var[1] + landmark_var[2])
    for k in counting:
        points += trace(covariance, CAMERA_DIM + 3 * k, 3)
    return points + trace(covariance, 0, 3), points + trace(covariance, 0, CAMERA_DIM)


@borrowing
def trace(A: np.ndarray, start: int, count: int) -> float:
    """Sum of ``count`` diagonal entries from ``start`` on."""
    total = 0.0
    for i in range(start, start + count):
        total += A[i, i]
    return total
