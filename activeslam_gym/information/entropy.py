"""The entropy of a belief, at a dimension that never changes: a landmark that nobody has found holds its prior.

H = 1/2 log2((2 pi e)^n |P|) bits, n = 12 + 3 N, |P| = |P_counted| |Sigma_prior|^(N - m) with m counting features.
"""

import math

import numpy as np

from activeslam_gym.kernels import Record, borrowing, compiled
from activeslam_gym.linalg import cholesky_in_place, log2_det, log2_det_of_factor, submatrix
from activeslam_gym.motion import CAMERA_DIM
from activeslam_gym.slam.sight import POSE_DIM

LOG2_2PIE = math.log2(2.0 * math.pi * math.e)


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
