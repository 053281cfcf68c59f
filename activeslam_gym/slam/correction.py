"""The correction of a frame: the update by all that was matched, iterated where its line is not straight enough."""

from typing import NamedTuple

import numpy as np

from activeslam_gym.camera import view_of
from activeslam_gym.kernels import Record, borrowing, compiled
from activeslam_gym.linalg import copy_into
from activeslam_gym.motion import D_ROTATION
from activeslam_gym.slam.belief import Belief
from activeslam_gym.slam.kalman import gain
from activeslam_gym.slam.manifold import rotated, shift_mean, subtract_and_recentre, turning
from activeslam_gym.slam.sight import POSE_DIM, Sight, measure, sight_with

ITERATIONS = 3  # at most so many after the first update
STRAIGHT_PX = 0.3  # nothing is iterated where the pixels at the new mean are so near to what the line says


class Mean(NamedTuple):
    """The mean of a belief: camera (13,), biases, and its features (n,)."""

    camera: np.ndarray
    bias: np.ndarray
    feature: np.ndarray


@compiled
def correct(lens: Record, belief: Belief, fiducials: np.ndarray, sight: Sight, pixels: np.ndarray) -> bool:
    """x ⊞ delta, P - W^T W by the ``pixels`` (2 m,) of the m predictions in ``sight``, which is overwritten.

    The iterated Kalman filter (Bell and Cathey, "The iterated Kalman filter update as a Gauss-Newton method", 1993):
    delta = K (z - h(x_i) + H_i delta_i) with H_i, and so K and W, taken at the last mean x_i = x ⊞ delta_i. False, with
    nothing changed, if S has no factor.
    """
    points, HP, S = sight.point, sight.HP, sight.S
    first = _mean_of(belief)
    line = np.empty(pixels.shape[0])  # the pixels at delta = 0, by the line through the last mean
    for r in range(line.shape[0]):
        line[r] = points[r // 2].z_hat[r % 2]
    W, delta, sound = gain(HP, S, pixels - line)
    for _ in range(ITERATIONS if sound else 0):
        shift_mean(belief, delta)
        bends = _bend(lens, belief, fiducials, points, line, delta) > STRAIGHT_PX
        if bends:
            _refer_to_prior(belief, points, line, delta)
        _restore(belief, first)
        if not bends:
            break
        nearer = sight_with(points, belief.covariance, belief.state.dim)
        W_next, delta_next, next_sound = gain(nearer.HP, nearer.S, pixels - line)
        if not next_sound:
            break
        W, delta = W_next, delta_next
    if sound:
        shift_mean(belief, delta)
        subtract_and_recentre(belief, W, delta)
    return sound


@compiled
def _mean_of(belief: Belief) -> Mean:
    """A copy of the mean."""
    state = belief.state
    return Mean(state.camera.copy(), state.bias.copy(), belief.feature[: state.count].copy())


@borrowing
def _restore(belief: Belief, first: Mean) -> None:
    """Give the belief back its first mean."""
    copy_into(belief.state.camera, first.camera)
    copy_into(belief.state.bias, first.bias)
    for k in range(first.feature.shape[0]):
        copy_into(belief.feature[k].mean, first.feature[k].mean)


@compiled
def _bend(
    lens: Record, belief: Belief, fiducials: np.ndarray, points: np.ndarray, line: np.ndarray, delta: np.ndarray
) -> float:
    """Measure ``points`` at the shifted mean: how far their pixels are from ``line`` + H delta [px].

    Not at all, where one is not in front: there is no line to go on by.
    """
    pose, bent = belief.state.camera, 0.0
    view = view_of(lens, pose, np.empty((0, 2, 3)))
    for a in range(points.shape[0]):
        point = points[a]
        said = (line[2 * a] + _along(point, 0, delta), line[2 * a + 1] + _along(point, 1, delta))
        if not measure(view, belief, fiducials, point):
            return 0.0
        bent = max(bent, abs(point.z_hat[0] - said[0]), abs(point.z_hat[1] - said[1]))
    return bent


@borrowing
def _along(point: Record, axis: int, delta: np.ndarray) -> float:
    """H delta of one of a prediction's two rows."""
    total = 0.0
    for i in range(POSE_DIM):
        total += point.H_camera[axis, i] * delta[i]
    for i in range(point.width):
        total += point.H_feature[axis, i] * delta[point.column + i]
    return total


@compiled
def _refer_to_prior(belief: Belief, points: np.ndarray, line: np.ndarray, delta: np.ndarray) -> None:
    """H at the shifted mean, by the tangent that P is of: H M, with the rotation's columns of `subtract_and_recentre`.

    Then the new line is h(x_i) - H delta.
    """
    E, J = turning(belief, delta), rotated(belief, delta)
    for a in range(points.shape[0]):
        point = points[a]
        for axis in range(2):
            h, y = point.H_camera[axis], point.H_feature[axis]
            turn = np.zeros(3)
            for k in range(3):
                for i in range(3):
                    turn[k] += h[3 + i] * J[i, k] + h[i] * E[k, i]
                for i in range(point.width):
                    turn[k] += y[i] * E[k, point.column + i]
            copy_into(h[D_ROTATION], turn)
            line[2 * a + axis] = point.z_hat[axis] - _along(point, axis, delta)
