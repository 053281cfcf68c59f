"""Rotations: quaternions (scalar first) and so(3), with the perturbation in the world frame, R = Exp(dtheta) R_hat."""

import math

import numpy as np

from activeslam_gym.kernels import borrowing, compiled, uncompiled

Quaternion = tuple[float, float, float, float]
_SMALL_ANGLE = 1e-4  # below this angle [rad] the series are exact to double precision and the closed forms lose digits


@compiled
def quaternion_product(a: np.ndarray | Quaternion, b: np.ndarray) -> np.ndarray:
    """Hamilton product a b of two quaternions (4,), scalar first."""
    out = np.empty(4)
    out[0] = a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3]
    out[1] = a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2]
    out[2] = a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1]
    out[3] = a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0]
    return out


@borrowing
def _exp(phi: np.ndarray) -> Quaternion:
    angle = math.sqrt(phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2])
    scale = 0.5 - angle * angle / 48.0 if angle < _SMALL_ANGLE else math.sin(0.5 * angle) / angle
    return math.cos(0.5 * angle), scale * phi[0], scale * phi[1], scale * phi[2]


def quaternion_exp(phi: np.ndarray) -> np.ndarray:
    """Unit quaternion (4,) of the rotation vector ``phi`` (3,) [rad]."""
    return np.array(uncompiled(_exp)(phi))


@compiled
def rotate_left(phi: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Exp(phi) q, normalised: the paper's left-multiplied quaternion transition."""
    out = quaternion_product(_exp(phi), q)
    norm = math.sqrt(out[0] * out[0] + out[1] * out[1] + out[2] * out[2] + out[3] * out[3])
    for i in range(4):
        out[i] /= norm
    return out


@compiled
def rotation_error(q_true: np.ndarray, q_hat: np.ndarray) -> np.ndarray:
    """Log(R_true R_hat^T) (3,) [rad], the shorter way round: the tangent error of an orientation estimate."""
    conjugate = np.array((q_hat[0], -q_hat[1], -q_hat[2], -q_hat[3]))
    q = quaternion_product(q_true, conjugate)
    sine = math.sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    scale = 2.0 if sine < 1e-12 else 2.0 * math.atan2(sine, abs(q[0])) / sine
    if q[0] < 0.0:
        scale = -scale
    return np.array((scale * q[1], scale * q[2], scale * q[3]))


@compiled
def rotation_matrix(q: np.ndarray) -> np.ndarray:
    """R_WC (3, 3) of a unit quaternion q_WC (4,)."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    R = np.empty((3, 3))
    R[0, 0] = 1.0 - 2.0 * (y * y + z * z)
    R[0, 1] = 2.0 * (x * y - w * z)
    R[0, 2] = 2.0 * (x * z + w * y)
    R[1, 0] = 2.0 * (x * y + w * z)
    R[1, 1] = 1.0 - 2.0 * (x * x + z * z)
    R[1, 2] = 2.0 * (y * z - w * x)
    R[2, 0] = 2.0 * (x * z - w * y)
    R[2, 1] = 2.0 * (y * z + w * x)
    R[2, 2] = 1.0 - 2.0 * (x * x + y * y)
    return R


@borrowing
def write_skew(v: np.ndarray, out: np.ndarray, at: int) -> None:
    """Write the matrix [v]x (3, 3) with [v]x w = v x w, but for its zeros, into ``out`` from column ``at`` on."""
    out[0, at + 1], out[0, at + 2] = -v[2], v[1]
    out[1, at], out[1, at + 2] = v[2], -v[0]
    out[2, at], out[2, at + 1] = -v[1], v[0]


@compiled
def skew(v: np.ndarray) -> np.ndarray:
    """The matrix [v]x (3, 3) with [v]x w = v x w."""
    out = np.zeros((3, 3))
    write_skew(v, out, 0)
    return out


@compiled
def _so3_series(phi: np.ndarray, identity: float, linear: float, quadratic: float) -> np.ndarray:
    """identity I + linear [phi]x + quadratic [phi]x^2, with [phi]x^2 = phi phi^T - |phi|^2 I."""
    out = skew(phi)
    square = phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2]
    for i in range(3):
        for j in range(3):
            out[i, j] = linear * out[i, j] + quadratic * phi[i] * phi[j]
        out[i, i] += identity - quadratic * square
    return out


@compiled
def so3_exp(phi: np.ndarray) -> np.ndarray:
    """Rotation matrix (3, 3) of the rotation vector ``phi`` (3,) [rad] (Rodrigues)."""
    angle = math.sqrt(phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2])
    if angle < _SMALL_ANGLE:
        return _so3_series(phi, 1.0, 1.0 - angle * angle / 6.0, 0.5 - angle * angle / 24.0)
    return _so3_series(phi, 1.0, math.sin(angle) / angle, (1.0 - math.cos(angle)) / (angle * angle))


@compiled
def so3_left_jacobian(phi: np.ndarray) -> np.ndarray:
    """J_l (3, 3) with Exp(phi + d) = Exp(J_l(phi) d) Exp(phi) to first order in d."""
    angle = math.sqrt(phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2])
    if angle < _SMALL_ANGLE:
        return _so3_series(phi, 1.0, 0.5 - angle * angle / 24.0, 1.0 / 6.0 - angle * angle / 120.0)
    linear = (1.0 - math.cos(angle)) / (angle * angle)
    return _so3_series(phi, 1.0, linear, (angle - math.sin(angle)) / (angle * angle * angle))
