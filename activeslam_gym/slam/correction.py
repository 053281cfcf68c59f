"""The correction of a frame: the update by all that was matched, iterated where its line is not straight enough."""

import numpy as np

from activeslam_gym.camera import View
from activeslam_gym.geometry import rotation_matrix, so3_left_jacobian
from activeslam_gym.kernels import Record, compiled
from activeslam_gym.linalg import copy_into
from activeslam_gym.motion import D_ROTATION, QUATERNION
from activeslam_gym.slam.belief import Belief
from activeslam_gym.slam.kalman import gain
from activeslam_gym.slam.manifold import shift_mean, subtract_and_recentre, turning
from activeslam_gym.slam.sight import POSE_DIM, Sight, measure, sight_with

ITERATIONS = 4
"""At most so many after the first update."""
STRAIGHT_PX = 0.3
"""Nothing is iterated where the pixels at the new mean are so near to what the line says."""


@compiled
def correct(camera: Record, belief: Belief, fiducials: np.ndarray, sight: Sight, pixels: np.ndarray) -> bool:
    """x ⊞ delta, P - W^T W by the ``pixels`` (2 m,) of the m things in ``sight``, which is overwritten.

    The iterated Kalman filter (Bell and Cathey 1993): delta = K (z - h(x_i) + H_i delta_i) with H_i, and so K and W,
    taken at the last mean x_i = x ⊞ delta_i. False, with nothing changed, if S has no factor.
    """
    P, dim, things = belief.covariance, belief.state.dim, sight.thing
    first, features = belief.state.camera.copy(), belief.feature[: belief.state.count].copy()
    line = np.empty(pixels.shape[0])  # what the line through the last mean says of the pixels at delta = 0
    for r in range(line.shape[0]):
        line[r] = things[r // 2].z_hat[r % 2]
    W, delta, sound = gain(sight.HP, sight.S, pixels - line)
    if not sound:
        return False
    for _ in range(ITERATIONS):
        shift_mean(belief, delta)
        bent = _bend(camera, belief, fiducials, things, line, delta)
        if STRAIGHT_PX < bent < np.inf:
            _refer_to_prior(belief, things, line, delta)
        copy_into(belief.state.camera, first)
        for k in range(features.shape[0]):
            copy_into(belief.feature[k].mean, features[k].mean)
        if not STRAIGHT_PX < bent < np.inf:
            break
        again = sight_with(things, P, dim, camera.pixel_std**2)
        W_next, delta_next, sound = gain(again.HP, again.S, pixels - line)
        if not sound:
            break
        W, delta = W_next, delta_next
    shift_mean(belief, delta)
    subtract_and_recentre(belief, W, delta)
    return True


@compiled
def _bend(
    camera: Record, belief: Belief, fiducials: np.ndarray, things: np.ndarray, line: np.ndarray, delta: np.ndarray
) -> float:
    """Measure ``things`` at the shifted mean: how far their pixels are from ``line`` + H delta [px].

    Infinitely, where one is not in front.
    """
    pose, bent = belief.state.camera, 0.0
    view = View(camera, pose, rotation_matrix(pose[QUATERNION]), np.empty((0, 2, 3)))
    for a in range(things.shape[0]):
        thing = things[a]
        said = (line[2 * a] + _along(thing, 0, delta), line[2 * a + 1] + _along(thing, 1, delta))
        if not measure(view, belief, fiducials, thing):
            return np.inf
        bent = max(bent, abs(thing.z_hat[0] - said[0]), abs(thing.z_hat[1] - said[1]))
    return bent


@compiled
def _along(thing: Record, axis: int, delta: np.ndarray) -> float:
    """H delta of one of a thing's two rows."""
    total = 0.0
    for i in range(POSE_DIM):
        total += thing.H_camera[axis, i] * delta[i]
    for i in range(thing.width):
        total += thing.H_feature[axis, i] * delta[thing.column + i]
    return total


@compiled
def _refer_to_prior(belief: Belief, things: np.ndarray, line: np.ndarray, delta: np.ndarray) -> None:
    """H at the shifted mean, by the tangent that P is of: H M, with the rotation's columns of `subtract_and_recentre`.

    Then the new line is h(x_i) - H delta.
    """
    E, J = turning(belief, delta), so3_left_jacobian(delta[D_ROTATION])
    for a in range(things.shape[0]):
        thing = things[a]
        for axis in range(2):
            h, y = thing.H_camera[axis], thing.H_feature[axis]
            turn = np.zeros(3)
            for k in range(3):
                for i in range(3):
                    turn[k] += h[3 + i] * J[i, k] + h[i] * E[k, i]
                for i in range(thing.width):
                    turn[k] += y[i] * E[k, thing.column + i]
            copy_into(h[D_ROTATION], turn)
            line[2 * a + axis] = thing.z_hat[axis] - _along(thing, axis, delta)
