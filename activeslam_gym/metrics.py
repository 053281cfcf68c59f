"""Comparison with the ground truth: errors, NEES, the proper log score; loop closures, and trajectory files."""

import math
import os
from collections.abc import Iterable

import numpy as np

from activeslam_gym.files import written_whole
from activeslam_gym.geometry import rotation_error
from activeslam_gym.kernels import compiled
from activeslam_gym.linalg import (
    cholesky_in_place,
    copy_into,
    log2_det_of_factor,
    solve_transposed_vector,
    sum_of_squares,
)
from activeslam_gym.motion import ANGULAR_VELOCITY, CAMERA_DIM, POSITION, QUATERNION, VELOCITY

LOST_POSITION_ERROR = 0.5
"""A run is lost where the true position error is over this [m], unless an environment is told another limit."""
UNSOUND_LOG_SCORE = -10_000.0
"""Log score of an estimate whose covariance is not positive definite [bit]."""
CLOSURE_GAP = 5.0
"""A match closes a loop after so long without a match [s]. The paper names no number."""


@compiled
def is_lost(sound: bool, position_error: float, limit: float) -> bool:
    """Whether a covariance is not ``sound`` (positive definite), or a position error is NaN or over ``limit`` [m]."""
    return not (sound and position_error <= limit)


@compiled
def camera_error(true_camera: np.ndarray, camera: np.ndarray) -> np.ndarray:
    """Tangent error (12,) of an estimated camera (13,): truth minus estimate, the rotation by Log(R R_hat^T)."""
    turn, d = rotation_error(true_camera[QUATERNION], camera[QUATERNION]), true_camera - camera
    return np.concatenate((d[POSITION], turn, d[VELOCITY], d[ANGULAR_VELOCITY]))


@compiled
def nees(error: np.ndarray, covariance: np.ndarray) -> float:
    """Normalised estimation error squared e^T P^-1 e of e (n,); inf where P (n, n) is not positive definite.

    Raises:
        ValueError: the sizes differ.
    """
    if covariance.shape != (error.shape[0], error.shape[0]):
        raise ValueError("error must be (n,), and covariance (n, n)")
    U, e = covariance.astype(np.float64), error.astype(np.float64)
    if not cholesky_in_place(U):
        return np.inf
    solve_transposed_vector(U, e)
    return sum_of_squares(e)


@compiled
def log2_normal_of_factor(error: np.ndarray, U: np.ndarray) -> float:
    """log2 N(error; 0, P) [bit] of ``error`` (n,), which is overwritten; P = U^T U, of which U may have more rows."""
    n = error.shape[0]
    solve_transposed_vector(U, error)
    square = sum_of_squares(error)
    return -0.5 * (n * math.log2(2.0 * math.pi) + log2_det_of_factor(U, 0, n) + square * math.log2(math.e))


@compiled
def log2_density(
    true_camera: np.ndarray,
    true_landmarks: np.ndarray,
    camera: np.ndarray,
    points: np.ndarray,
    landmark_var: np.ndarray,
    of_landmark: np.ndarray,
    U: np.ndarray,
) -> float:
    """log2 N(truth | estimate) over the camera (13,) and all true landmarks (L, 3) [bit]: a proper score.

    ``of_landmark`` (L,): the feature, by its position k in ``points`` (n, 3), that stands for each landmark. A landmark
    without one is scored by the room's prior, of variance ``landmark_var`` (3,) [m^2]; other features are marginalised
    out. ``U`` is a factor of the covariance that begins with the features of ``of_landmark``, in its order, and the
    camera.
    """
    error = np.empty(3 * of_landmark.shape[0] + CAMERA_DIM)
    rest, at = 0.0, 0
    for i in range(of_landmark.shape[0]):
        y, k = true_landmarks[i], of_landmark[i]
        for axis in range(3):
            if k >= 0:
                error[at] = y[axis] - points[k, axis]
                at += 1
            else:
                variance = landmark_var[axis]
                rest -= 0.5 * (math.log2(2.0 * math.pi * variance) + y[axis] ** 2 / variance * math.log2(math.e))
    copy_into(error[at:], camera_error(true_camera, camera))
    return rest + log2_normal_of_factor(error[: at + CAMERA_DIM], U)


class LoopClosures:
    """Counts features and fiducials that are matched again after `CLOSURE_GAP`."""

    def __init__(self) -> None:
        self._last: dict[int, float] = {}

    def count(self, ids: Iterable[int], time: float) -> int:
        """Loops that the matches ``ids`` of ``time`` [s] close."""
        closed = 0
        for id in ids:
            closed += time - self._last.get(id, time) >= CLOSURE_GAP
            self._last[id] = time
        return closed


def write_tum(path: str | os.PathLike[str], times: np.ndarray, positions: np.ndarray, quaternions: np.ndarray) -> None:
    """Write a trajectory in TUM format, a line a pose: time x y z qx qy qz qw (scalar *last* in the file).

    ``times`` (T,) [s], ``positions`` (T, 3) [m], ``quaternions`` (T, 4) scalar first. Written whole or not at all.

    Raises:
        ValueError: the lengths differ.
    """
    times, positions, quaternions = np.asarray(times), np.asarray(positions), np.asarray(quaternions)
    if positions.shape != (len(times), 3) or quaternions.shape != (len(times), 4):
        raise ValueError(
            f"positions and quaternions must be ({len(times)}, 3) and ({len(times)}, 4) for {len(times)} times, "
            f"got {positions.shape} and {quaternions.shape}"
        )
    table = np.column_stack([times, positions, quaternions[:, [1, 2, 3, 0]]])
    with written_whole(path) as unfinished:
        np.savetxt(unfinished, table, fmt="%.9f")
