"""The correction of a frame: the update by all that was matched, iterated where its line is not straight enough."""

from typing import NamedTuple

import numpy as np

from activeslam_gym.camera import view_of
from activeslam_gym.kernels import Record, borrowing, compiled
from activeslam_gym.linalg import copy_into, solve_vector
from activeslam_gym.motion import D_ROTATION
from activeslam_gym.slam.belief import FIRST_ESTIMATES, Belief
from activeslam_gym.slam.kalman import gain
from activeslam_gym.slam.manifold import rotated, shift_mean, subtract_and_recentre, turning
from activeslam_gym.slam.sight import POSE_DIM, Sight, measure, sight_with

ITERATIONS = 6  # at most so many after the first update
STRAIGHT_PX = 0.3  # nothing is iterated where the pixels at the new mean are so near to what the line says
SHORTEST = 0.05  # a step is halved until it lowers the cost, but not to under this share of it
ROUNDING = 1e-9  # by which a cost that is lower may seem higher


class Step(NamedTuple):
    """A step away from the prior mean."""

    delta: np.ndarray  # (dim,) in the tangent
    pull: np.ndarray  # (dim,) P^-1 delta
    cost: float  # delta^T P^-1 delta + (z - h)^T R^-1 (z - h) there; inf where it lowers nothing


class Mean(NamedTuple):
    """The mean of a belief: camera (13,), biases, and its features (n,)."""

    camera: np.ndarray
    bias: np.ndarray
    feature: np.ndarray


@compiled
def correct(lens: Record, belief: Belief, fiducials: np.ndarray, sight: Sight, pixels: np.ndarray) -> bool:
    """x ⊞ delta, P - W^T W by the ``pixels`` (2 m,) of the m predictions in ``sight``, which is overwritten.

    The iterated Kalman filter (Bell and Cathey 1993), which is Gauss and Newton's descent of the cost
    delta^T P^-1 delta + (z - h)^T R^-1 (z - h): delta = K (z - h(x_i) + H_i delta_i) with H_i, and so K and W, taken at
    the last mean x_i = x ⊞ delta_i, and half of such a step where the whole would raise the cost. False, with nothing
    changed, if S has no factor, or no step lowers the cost.
    """
    dim, things = belief.state.dim, sight.thing
    first = _mean_of(belief)
    line = np.empty(pixels.shape[0])  # the pixels at delta = 0, by the line through the last mean
    for r in range(line.shape[0]):
        line[r] = things[r // 2].z_hat[r % 2]
    HP, S, W, moved = sight.HP, sight.S, np.zeros((1, dim)), False
    last = Step(np.zeros(dim), np.zeros(dim), _misfit(things, pixels))
    for _ in range(1 + ITERATIONS):
        nu = pixels - line
        W_next, delta, sound = gain(HP, S, nu)
        if not sound:
            break
        target = Step(delta, _pull(things, S, nu, dim), np.inf)
        step, bent = _descend(lens, belief, fiducials, things, pixels, line, last, target)
        lowers = step.cost < np.inf
        if lowers:
            W, last, moved = W_next, step, True
        again = lowers and bent > STRAIGHT_PX and belief.state.variant != FIRST_ESTIMATES
        if again:
            _refer_to_prior(belief, things, line, last.delta)
        _restore(belief, first)
        if not again:
            break
        nearer = sight_with(things, belief.covariance, dim)
        HP, S = nearer.HP, nearer.S
    if moved:
        shift_mean(belief, last.delta)
        subtract_and_recentre(belief, W, last.delta)
    return moved


@compiled
def _descend(
    lens: Record,
    belief: Belief,
    fiducials: np.ndarray,
    things: np.ndarray,
    pixels: np.ndarray,
    line: np.ndarray,
    last: Step,
    target: Step,
) -> tuple[Step, float]:
    """So much of the way from ``last`` to ``target`` as lowers the cost, and its `_bend` [px], inf of a part of it.

    ``things`` are measured there, and the mean stands there.
    """
    first = _mean_of(belief)
    share, delta, pull = 1.0, target.delta, target.pull
    while share > SHORTEST:
        delta = last.delta + share * (target.delta - last.delta)
        pull = last.pull + share * (target.pull - last.pull)
        shift_mean(belief, delta)
        bent = _bend(lens, belief, fiducials, things, line, delta)
        if bent < np.inf:
            cost = np.sum(delta * pull) + _misfit(things, pixels)
            if cost <= last.cost + ROUNDING:
                return Step(delta, pull, cost), bent if share == 1.0 else np.inf
        _restore(belief, first)
        share *= 0.5
    return target, np.inf


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


@borrowing
def _misfit(things: np.ndarray, pixels: np.ndarray) -> float:
    """Sum of (z - h)^T R^-1 (z - h), h measured last, R with the curvature."""
    total = 0.0
    for k in range(things.shape[0]):
        z_hat, R, extra = things[k].z_hat, things[k].R, things[k].curvature
        x, y = pixels[2 * k] - z_hat[0], pixels[2 * k + 1] - z_hat[1]
        a, b, c = R[0, 0] + extra[0, 0], R[0, 1] + extra[0, 1], R[1, 1] + extra[1, 1]
        total += (c * x * x - 2.0 * b * x * y + a * y * y) / (a * c - b * b)
    return total


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
    lens: Record, belief: Belief, fiducials: np.ndarray, things: np.ndarray, line: np.ndarray, delta: np.ndarray
) -> float:
    """Measure ``things`` at the shifted mean: how far their pixels are from ``line`` + H delta [px].

    Infinitely, where one is not in front.
    """
    pose, bent = belief.state.camera, 0.0
    view = view_of(lens, pose, np.empty((0, 2, 3)))
    for a in range(things.shape[0]):
        thing = things[a]
        said = (line[2 * a] + _along(thing, 0, delta), line[2 * a + 1] + _along(thing, 1, delta))
        if not measure(view, belief, fiducials, thing):
            return np.inf
        bent = max(bent, abs(thing.z_hat[0] - said[0]), abs(thing.z_hat[1] - said[1]))
    return bent


@borrowing
def _along(thing: Record, axis: int, delta: np.ndarray) -> float:
    """H delta of one of a prediction's two rows."""
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
    E, J = turning(belief, delta), rotated(belief, delta)
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
