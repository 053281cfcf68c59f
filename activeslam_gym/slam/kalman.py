"""Prediction and update of the mean and the joint covariance, cross-covariances included."""

import math

import numpy as np

from activeslam_gym.kernels import Record, borrowing, compiled
from activeslam_gym.linalg import (
    add_product,
    add_symmetric_product,
    cholesky_in_place,
    copy_block,
    copy_into,
    solve_transposed,
    solve_transposed_vector,
)
from activeslam_gym.motion import (
    ANGULAR_VELOCITY,
    CAMERA_DIM,
    D_VELOCITY,
    POSITION,
    VELOCITY,
    process_covariance,
    transition,
    transition_jacobian,
)
from activeslam_gym.slam.belief import AZIMUTH, ELEVATION, FEATURE_SIZE, POINT, Belief, point_of

_NEAREST = 0.1  # nearer than that, a view changes no faster [m]
_LEAST_LEVEL = 0.2
"""Straight above or below, an azimuth tells nothing: the cosine of the elevation counts as at least so much."""


@compiled
def predict(motion: Record, belief: Belief, u: np.ndarray, dt: float) -> None:
    """``dt`` seconds ahead under the known accelerations ``u`` (6,): x = f(x, u), P = F P F^T + Q in the camera's rows.

    The appendix's prediction, and section II's.
    """
    x = transition(belief.state.camera, u, dt)
    F_x = transition_jacobian(x[ANGULAR_VELOCITY], dt)
    copy_into(belief.state.camera, x)
    propagate(belief.covariance, belief.state.dim, F_x, process_covariance(motion, F_x, dt))
    belief.state.frame += 1


@compiled
def wander(belief: Belief, drift: float, dt: float) -> None:
    """Each feature's direction, as the camera sees it, walks at random while the camera's view of it changes.

    Its variance grows by ``drift``^2 [rad^2] for each radian, which is the way of ``dt`` seconds over the distance:
    what a patch shows from another side, or from nearer, is not quite the same point. A POINT walks in depth too.
    """
    x, P, T = belief.state.camera, belief.covariance, np.empty((3, FEATURE_SIZE))
    speed = math.sqrt(x[VELOCITY.start] ** 2 + x[VELOCITY.start + 1] ** 2 + x[VELOCITY.start + 2] ** 2)
    for k in range(belief.state.count):
        feature, point, square, depth_square = belief.feature[k], point_of(belief, k, T), 0.0, 0.0
        for i in range(3):
            square += (point[i] - x[POSITION.start + i]) ** 2
            depth_square += (point[i] - feature.mean[i]) ** 2
        if not square < np.inf:
            continue
        var = drift * drift * min(speed * dt / max(math.sqrt(square), _NEAREST), 1.0)
        if feature.kind == POINT:
            for row in range(feature.start, feature.start + 3):
                P[row, row] += var * square
        else:  # as its angles at the anchor
            var *= square / max(depth_square, _NEAREST * _NEAREST)
            level = max(math.cos(feature.mean[ELEVATION]), _LEAST_LEVEL)
            P[feature.start + AZIMUTH, feature.start + AZIMUTH] += var / (level * level)
            P[feature.start + ELEVATION, feature.start + ELEVATION] += var


@borrowing
def update_contact(belief: Belief, u: np.ndarray, dt: float) -> None:
    """The camera has struck something, to be called before that frame's `predict`: any part of its speed may be gone.

    So the variance of each axis' velocity grows by the square of what it would be.
    """
    for i in range(3):
        v = belief.state.camera[VELOCITY.start + i] + dt * u[i]
        row = D_VELOCITY.start + i
        belief.covariance[row, row] += v * v


@compiled
def propagate(P: np.ndarray, dim: int, F: np.ndarray, Q: np.ndarray) -> None:
    """P_cc = F P_cc F^T + Q and P_cy = F P_cy on the leading ``dim`` rows of ``P``, for any camera transition."""
    FP, P_cc = np.zeros((CAMERA_DIM, dim)), P[:CAMERA_DIM, :CAMERA_DIM]
    add_product(F, P[:CAMERA_DIM], FP)
    for i in range(CAMERA_DIM):
        for j in range(CAMERA_DIM, dim):
            P[i, j] = FP[i, j]
            P[j, i] = FP[i, j]
    copy_block(Q, P_cc)
    add_symmetric_product(FP, F, P_cc)


@compiled
def gain(HP: np.ndarray, S: np.ndarray, innovation: np.ndarray) -> tuple[np.ndarray, np.ndarray, bool]:
    """(W, delta, sound): with U^T U = S and W = U^-T H P, K S K^T = W^T W and delta = K nu = W^T (U^-T nu).

    One factor, no inverse. ``HP`` is (m, dim); ``S`` = H P H^T + R (m, m) and ``innovation`` nu (m,) are overwritten.
    Not sound if S has no factor.
    """
    W, delta = HP.copy(), np.zeros((1, HP.shape[1]))
    if not cholesky_in_place(S):
        return W, delta[0], False
    solve_transposed(S, W)
    solve_transposed_vector(S, innovation)
    add_product(innovation[None, :], W, delta)
    sound = True
    for value in delta[0]:
        sound = sound and math.isfinite(value)
    return W, delta[0], sound
