"""The mean on its manifold: how an update shifts it, and what the covariance is about the new mean.

The estimator `ekf` is the right-invariant filter. `ekf-plain` keeps the tangent as it is, and so gains orientation that
it never measured.
"""

import math

import numpy as np

from activeslam_gym.geometry import rotate_left, so3_left_jacobian, write_skew
from activeslam_gym.kernels import borrowing, compiled
from activeslam_gym.linalg import (
    add_product,
    add_symmetric_product,
    copy_block,
    copy_into,
    diagonal,
    subtract_from_one,
    subtract_symmetric,
)
from activeslam_gym.motion import (
    ANGULAR_VELOCITY,
    CAMERA_DIM,
    D_ANGULAR,
    D_POSITION,
    D_ROTATION,
    D_VELOCITY,
    POSITION,
    QUATERNION,
    VELOCITY,
)
from activeslam_gym.slam.belief import AZIMUTH, ELEVATION, INVERSE_DEPTH, KIND_DIM, PLAIN, POINT, RHO, Belief

MINIMUM_INVERSE_DEPTH = 0.01  # updates keep inverse depths above this [1/m]


@compiled
def shift_mean(belief: Belief, delta: np.ndarray) -> None:
    """mean ⊞ ``delta`` (dim,): the camera's rotation is perturbed on the left, in the world frame."""
    x = belief.state.camera
    _add(x[POSITION], delta[D_POSITION])
    _add(x[VELOCITY], delta[D_VELOCITY])
    _add(x[ANGULAR_VELOCITY], delta[D_ANGULAR])
    copy_into(x[QUATERNION], rotate_left(delta[D_ROTATION], x[QUATERNION]))
    _add(belief.state.bias, delta[CAMERA_DIM : CAMERA_DIM + belief.state.bias_dim])
    for k in range(belief.state.count):
        feature = belief.feature[k]
        _add(feature.mean, delta[feature.start : feature.start + KIND_DIM[feature.kind]])
        if feature.kind == INVERSE_DEPTH:
            feature.mean[RHO] = max(feature.mean[RHO], MINIMUM_INVERSE_DEPTH)


@borrowing
def _add(x: np.ndarray, delta: np.ndarray) -> None:
    for i in range(delta.shape[0]):
        x[i] += delta[i]


@compiled
def subtract_and_recentre(belief: Belief, W: np.ndarray, delta: np.ndarray) -> None:
    """M (P - W^T W) M^T: the update's covariance in the tangent of the mean just shifted by ``delta`` (dim,).

    M keeps what no bearing can tell, a turn of camera and map together, what it is. Such a turn a moves a point f by
    a x f; before the shift that is a x f, and after it has to be a x (f + df), so every world vector gets
    + dtheta x df. With the plain tangent (M = I) the direction would change with the estimate, and the filter would
    gain orientation that it never measured. It is the covariance of the right-invariant filter in these coordinates
    (Barrau and Bonnabel, *An EKF-SLAM algorithm with consistency properties*, 2015). The rotation's own rows follow
    from Exp(dtheta) = Exp(dtheta+) Exp(delta_theta), dtheta+ = J_l(delta_theta) (dtheta - delta_theta): the modern form
    of the paper's Jacobian of the quaternion's normalisation.

    With M = I + E^T on the rotation's columns, E (3, dim), and B = P_theta + P_theta,theta E / 2 of the P after the
    update, M P M^T = P + E^T B + B^T E; all that is subtracted, at once: (W, -E, -B)^T (W, B, E).
    """
    P, dim, m = belief.covariance, belief.state.dim, W.shape[0]
    E, left, right = turning(belief, delta), np.empty((m + 6, dim)), np.empty((m + 6, dim))
    B = right[m : m + 3]
    copy_block(P[D_ROTATION, :dim], B)
    for i in range(3):
        subtract_from_one(B, i, W[:, D_ROTATION], W, m, 0, dim)
    add_product(0.5 * B[:, D_ROTATION], E, B)
    copy_block(W, left)
    copy_block(W, right)
    copy_block(E, right[m + 3 :])
    for i in range(3):
        for j in range(dim):
            left[m + i, j], left[m + 3 + i, j] = -E[i, j], -B[i, j]
    subtract_symmetric(P, left, right, dim)
    _recentre_rotation(belief, delta)


@compiled
def turning(belief: Belief, delta: np.ndarray) -> np.ndarray:
    """E (3, dim), M = I + E^T on the rotation's columns: how the shift changed what a turn does to each coordinate.

    Of a world vector that is shifted by d it is [d]x: a x d = E^T a.
    """
    E = np.zeros((3, belief.state.dim))
    if belief.state.variant == PLAIN:
        return E
    write_skew(delta[D_POSITION], E[:, D_POSITION])
    write_skew(delta[D_VELOCITY], E[:, D_VELOCITY])
    write_skew(delta[D_ANGULAR], E[:, D_ANGULAR])
    for k in range(belief.state.count):
        feature = belief.feature[k]
        at = feature.start
        write_skew(delta[at : at + 3], E[:, at : at + 3])
        if feature.kind != POINT:
            azimuth, elevation = feature.mean[AZIMUTH], feature.mean[ELEVATION]
            angles = E[:, at + AZIMUTH : at + AZIMUTH + 2]
            _turn_angles(azimuth, elevation, 1.0, angles)
            _turn_angles(azimuth - delta[at + AZIMUTH], elevation - delta[at + ELEVATION], -1.0, angles)
    return E


@borrowing
def _turn_angles(azimuth: float, elevation: float, sign: float, E: np.ndarray) -> None:
    """Add ``sign`` times d(azimuth, elevation) of a direction by a turn of the world, the derivative of a x m."""
    sin_a, cos_a, tan_e = math.sin(azimuth), math.cos(azimuth), math.tan(elevation)
    E[0, 0] -= sign * tan_e * sin_a
    E[1, 0] += sign
    E[2, 0] -= sign * tan_e * cos_a
    E[0, 1] -= sign * cos_a
    E[2, 1] += sign * sin_a


@compiled
def rotated(belief: Belief, delta: np.ndarray) -> np.ndarray:
    """J_l (3, 3), M on the rotation's own rows and columns."""
    return diagonal(np.ones(3)) if belief.state.variant == PLAIN else so3_left_jacobian(delta[D_ROTATION])


@compiled
def _recentre_rotation(belief: Belief, delta: np.ndarray) -> None:
    """P_theta = J_l P_theta, rows and columns."""
    P, dim = belief.covariance, belief.state.dim
    J, P_theta = rotated(belief, delta), np.zeros((3, dim))
    add_product(J, P[D_ROTATION], P_theta)
    for i in range(3):
        for j in range(dim):
            P[D_ROTATION.start + i, j] = P_theta[i, j]
            P[j, D_ROTATION.start + i] = P_theta[i, j]
    P[D_ROTATION, D_ROTATION] = 0.0
    add_symmetric_product(P_theta[:, D_ROTATION], J, P[D_ROTATION, D_ROTATION])
