"""The correction of a frame: the update by all that was matched, iterated where its line is not straight enough."""

import numpy as np

from activeslam_gym.camera import View
from activeslam_gym.geometry import rotation_matrix, so3_left_jacobian
from activeslam_gym.kernels import Record, compiled, filled, record
from activeslam_gym.linalg import copy_into, solve_vector
from activeslam_gym.motion import D_ROTATION, QUATERNION
from activeslam_gym.slam.belief import Belief
from activeslam_gym.slam.kalman import gain
from activeslam_gym.slam.manifold import shift_mean, subtract_and_recentre, turning
from activeslam_gym.slam.sight import POSE_DIM, Sight, measure, sight_with

ITERATIONS = 6
"""At most so many after the first update."""
STRAIGHT_PX = 0.3
"""Nothing is iterated where the pixels at the new mean are so near to what the line says."""
SHORTEST = 0.05
"""A step is halved until it lowers the cost, but not to under this share of it."""

CORRECTION = record(
    product_frames="f8",  # frames for which the second-order noise of inverse depth stays what it is
    doubt="f8",
)
"""Constants of the correction."""


def correction_of() -> Record:
    """The CORRECTION record."""
    return filled(CORRECTION, product_frames=20.0, doubt=0.0)


@compiled
def correct(
    model: Record, camera: Record, belief: Belief, fiducials: np.ndarray, sight: Sight, pixels: np.ndarray
) -> bool:
    """x ⊞ delta, P - W^T W by the ``pixels`` (2 m,) of the m things in ``sight``, which is overwritten.

    The iterated Kalman filter (Bell and Cathey 1993), which is Gauss and Newton's descent of the cost
    |delta|^2_P + sum of (z - h(x ⊞ delta))^2_R: delta = K (z - h(x_i) + H_i delta_i) with H_i, and so K and W, taken at
    the last mean x_i = x ⊞ delta_i, and half the step where that would raise the cost. False, with nothing changed, if
    S has no factor, or no step lowers the cost.
    """
    P, dim, things, var = belief.covariance, belief.state.dim, sight.thing, camera.pixel_std**2
    first, features = belief.state.camera.copy(), belief.feature[: belief.state.count].copy()
    line = np.empty(pixels.shape[0])  # what the line through the last mean says of the pixels at delta = 0
    for r in range(line.shape[0]):
        line[r] = things[r // 2].z_hat[r % 2]
    noise = np.empty((things.shape[0], 2, 2))
    for a in range(things.shape[0]):
        for i in range(2):
            for j in range(2):
                noise[a, i, j] = things[a].extra[i, j]
    HP, S, W = sight.HP, sight.S, np.zeros((1, dim))
    delta, pull, cost = np.zeros(dim), np.zeros(dim), _misfit(things, pixels, var)  # pull = P^-1 delta
    moved = False
    for _ in range(1 + ITERATIONS):
        nu = pixels - line
        W_next, target, sound = gain(HP, S, nu)
        if not sound:
            break
        target_pull = _pull(things, S, nu, dim)
        share, bent, lower = 1.0, np.inf, False
        while share > SHORTEST and not lower:
            step, step_pull = delta + share * (target - delta), pull + share * (target_pull - pull)
            shift_mean(belief, step)
            bent = _bend(camera, belief, fiducials, things, line, step)
            if bent < np.inf:
                now = _misfit(things, pixels, var) + np.sum(step * step_pull)
                lower = now <= cost + 1e-9
            if lower:
                W, delta, pull, cost, moved = W_next, step, step_pull, now, True
                again = bent > STRAIGHT_PX or share < 1.0
                if model.doubt > 0.0:
                    again = _doubt(things, noise, pixels, var, model.doubt) or again
                    cost = _misfit(things, pixels, var) + np.sum(step * step_pull)
                if again:
                    _refer_to_prior(belief, things, line, delta)
            share *= 0.5
            _restore(belief, first, features)
        if not lower or not again:
            break
        more = sight_with(things, P, dim, var)
        HP, S = more.HP, more.S
    if moved:
        shift_mean(belief, delta)
        subtract_and_recentre(belief, W, delta)
    return moved


@compiled
def _restore(belief: Belief, camera: np.ndarray, features: np.ndarray) -> None:
    """Give the belief back its first mean."""
    copy_into(belief.state.camera, camera)
    for k in range(features.shape[0]):
        copy_into(belief.feature[k].mean, features[k].mean)


@compiled
def _square(thing: Record, x: float, y: float, var: float) -> float:
    """(x, y)^2_R of a thing, R its noise."""
    a, b, c = var + thing.extra[0, 0], thing.extra[0, 1], var + thing.extra[1, 1]
    return (c * x * x - 2.0 * b * x * y + a * y * y) / (a * c - b * b)


@compiled
def _misfit(things: np.ndarray, pixels: np.ndarray, var: float) -> float:
    """Sum of (z - h)^2_R, h what was measured last."""
    total = 0.0
    for a in range(things.shape[0]):
        z_hat = things[a].z_hat
        total += _square(things[a], pixels[2 * a] - z_hat[0], pixels[2 * a + 1] - z_hat[1], var)
    return total


@compiled
def _doubt(things: np.ndarray, noise: np.ndarray, pixels: np.ndarray, var: float, bound: float) -> bool:
    """Reweigh; whether any weight changed by much."""
    changed = False
    for a in range(things.shape[0]):
        thing = things[a]
        old = thing.extra[0, 0] + thing.extra[1, 1] + 2.0 * var
        for i in range(2):
            for j in range(2):
                thing.extra[i, j] = noise[a, i, j]
        d2 = _square(thing, pixels[2 * a] - thing.z_hat[0], pixels[2 * a + 1] - thing.z_hat[1], var)
        w = max(d2 / bound, 1.0)
        for i in range(2):
            for j in range(2):
                thing.extra[i, j] *= w
            thing.extra[i, i] += (w - 1.0) * var
        new = thing.extra[0, 0] + thing.extra[1, 1] + 2.0 * var
        changed = changed or abs(new - old) > 0.2 * old
    return changed


@compiled
def _pull(things: np.ndarray, U: np.ndarray, y: np.ndarray, dim: int) -> np.ndarray:
    """P^-1 delta = H^T U^-1 y (dim,), from what `gain` left of S and nu; ``y`` is overwritten."""
    out = np.zeros(dim)
    solve_vector(U, y)
    for a in range(things.shape[0]):
        thing = things[a]
        for axis in range(2):
            for i in range(POSE_DIM):
                out[i] += thing.H_camera[axis, i] * y[2 * a + axis]
            for i in range(thing.width):
                out[thing.column + i] += thing.H_feature[axis, i] * y[2 * a + axis]
    return out


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
