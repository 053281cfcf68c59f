"""Expected landmarks: what the room is assumed to hold and nobody has found yet, the reason not to stay at home."""

import math

import numpy as np

from activeslam_gym.kernels import compiled, record
from activeslam_gym.linalg import cholesky_in_place, diagonal, log2_det_3, solve_transposed_vector, sum_of_squares
from activeslam_gym.motion import CAMERA_DIM
from activeslam_gym.slam.estimate import EstimateArrays, index_of

VIEW = record(pose=("f8", 7), axis=("f8", 3))  # a viewpoint: position and quaternion, and the optical axis
EXPECTED = record(
    point=("f8", 3),  # where it is expected [m]; uncorrelated with the truth
    feature="i8",  # id of the counting feature that has retired it, or WAITING
    looked="i8",  # frames that it has been looked at, see `envs.disproof`; -1: to no avail
    looked_from=VIEW,  # and from where
    redraws="i8",  # so far
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
    return np.sum(expected["feature"] == WAITING)
