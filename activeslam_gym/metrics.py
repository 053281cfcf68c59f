"""Is the belief true? Errors, NEES, the proper log score, and trajectory files."""

import math
import os

import numpy as np

from activeslam_gym.files import written_whole
from activeslam_gym.geometry import rotation_error
from activeslam_gym.kernels import compiled
from activeslam_gym.linalg import cholesky_in_place, log2_det_of_factor, solve_transposed_vector, sum_of_squares
from activeslam_gym.motion import ANGULAR_VELOCITY, POSITION, QUATERNION, VELOCITY

LOST_POSITION_ERROR = 0.5
"""A run is lost where the true position error is over this [m], unless an environment is told another limit."""


@compiled
def camera_error(true_camera: np.ndarray, camera: np.ndarray) -> np.ndarray:
    """Tangent error (12,) of an estimated camera (13,): truth minus estimate, the rotation by Log(R R_hat^T)."""
    turn, d = rotation_error(true_camera[QUATERNION], camera[QUATERNION]), true_camera - camera
    return np.concatenate((d[POSITION], turn, d[VELOCITY], d[ANGULAR_VELOCITY]))


@compiled
def nees(error: np.ndarray, covariance: np.ndarray) -> float:
    """Normalised estimation error squared e^T P^-1 e; inf where P (n, n) is not positive definite."""
    U = covariance.copy()
    if not cholesky_in_place(U):
        return np.inf
    e = error.copy()
    solve_transposed_vector(U, e)
    return sum_of_squares(e)


@compiled
def log2_normal_of_factor(error: np.ndarray, U: np.ndarray) -> float:
    """log2 N(error; 0, P) [bit] of ``error`` (n,), which is overwritten; P = U^T U, of which U may have more rows."""
    n = error.shape[0]
    solve_transposed_vector(U, error)
    square = sum_of_squares(error)
    return -0.5 * (n * math.log2(2.0 * math.pi) + log2_det_of_factor(U, 0, n) + square * math.log2(math.e))


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
