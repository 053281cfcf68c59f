"""What the line leaves out of a measurement: second-order terms, whose covariance counts as noise of the image.

They are products of two errors, and matter where both are large: a filter that leaves them out measures what nobody
saw. The mean that they have is left out.
"""

import numpy as np

from activeslam_gym.camera import View
from activeslam_gym.kernels import Record, compiled
from activeslam_gym.linalg import congruence, product
from activeslam_gym.motion import D_ROTATION
from activeslam_gym.slam.belief import RHO

NEGLIGIBLE_PX = 0.2
"""The terms of a point are left out where they cannot come to about so much [px]."""


@compiled
def curvature_of_inverse_depth(P: np.ndarray, start: int, rho: float, H_y: np.ndarray, extra: np.ndarray) -> None:
    """Write what the line leaves out of an inverse-depth measurement into ``extra`` (2, 2) [px^2].

    Its point moves by d(rho) (anchor - p) + rho d(anchor - p) + d(rho) d(anchor - p). The last, a product of what may
    both be vague, has for Gaussians the covariance var(rho) D + c c^T, D = Cov(anchor - p), c = Cov(rho, anchor - p);
    in the image J of it J^T, with J = H_anchor / rho.
    """
    D = np.empty((3, 3))
    r = start + RHO
    for i in range(3):
        a = start + i
        for j in range(3):
            b = start + j
            D[i, j] = P[r, r] * (P[a, b] - P[a, j] - P[i, b] + P[i, j]) + (P[r, a] - P[r, i]) * (P[r, b] - P[r, j])
    for i in range(2):
        for j in range(i + 1):
            value = 0.0
            for k in range(3):
                for m in range(3):
                    value += H_y[i, k] * D[k, m] * H_y[j, m]
            extra[i, j] = value / (rho * rho)
            extra[j, i] = extra[i, j]


@compiled
def curvature_of_point(view: View, P: np.ndarray, y: np.ndarray, thing: Record) -> None:
    """Write what the line leaves out of the measurement of the point ``y`` (>= 3,) into ``thing.extra`` [px^2].

    Let D = y - p, n the camera's axis, J = dz/dy. To the camera that turns by theta the point moves by
    c = dy - dp - theta x D, and its pixel by J c and, besides, by

        -(J c) (n . c) / (n . D) - J (theta x c) - (J theta) (theta . D) / 2:

    what is nearer moves farther, what has moved is turned, and a turn is round. Each row is x^T M x with
    x = (theta, c); for a Gaussian x of covariance Sigma, Cov(x^T M_i x, x^T M_j x) = 2 tr(M_i Sigma M_j Sigma).
    Sigma is that given the pixel, where the iterated correction ends: what remains is what the pixel does not tell.

    Where the commands are not known, every frame begins with a wide turn. All of its points together tell that turn,
    each by itself does not: so counted, they would hardly count, and a camera in the hand would be lost. There nothing
    is counted.
    """
    D, turn, way, square, known = np.empty(3), 0.0, 0.0, 0.0, thing.width == 0
    for i in range(3):
        D[i] = y[i] - view.pose[i]
        k, r = thing.column + i, D_ROTATION.start + i
        turn += P[r, r]
        way += P[i, i] if known else P[i, i] - 2.0 * P[i, k] + P[k, k]
        square += D[i] * D[i]
    if view.camera.point_curvature * view.camera.focal * (turn + way / square) < NEGLIGIBLE_PX:
        return
    J = -thing.H_camera[:, :3]
    Sigma = _of_turn_and_motion(P, D, thing.column, thing.width)
    _condition_on_pixel(Sigma, J, view.camera.pixel_std**2)
    first = product(_form(J[0], D, view.R_WC[:, 2]), Sigma)
    second = product(_form(J[1], D, view.R_WC[:, 2]), Sigma)
    for i in range(6):
        for j in range(6):
            thing.extra[0, 0] += 2.0 * first[i, j] * first[j, i]
            thing.extra[0, 1] += 2.0 * first[i, j] * second[j, i]
            thing.extra[1, 1] += 2.0 * second[i, j] * second[j, i]
    thing.extra[1, 0] = thing.extra[0, 1]


@compiled
def _of_turn_and_motion(P: np.ndarray, D: np.ndarray, column: int, width: int) -> np.ndarray:
    """Covariance (6, 6) of theta and c = dy - dp - theta x D; y has ``width`` rows of ``P`` from ``column`` on."""
    n = 6 + width
    T, P_pose_y = np.zeros((6, n)), np.empty((n, n))
    for i in range(3):
        T[i, 3 + i], T[3 + i, i] = 1.0, -1.0
        if width > 0:
            T[3 + i, 6 + i] = 1.0
    T[3, 4], T[3, 5] = -D[2], D[1]
    T[4, 3], T[4, 5] = D[2], -D[0]
    T[5, 3], T[5, 4] = -D[1], D[0]
    for a in range(n):
        for b in range(n):
            P_pose_y[a, b] = P[a if a < 6 else column + a - 6, b if b < 6 else column + b - 6]
    return congruence(T, P_pose_y)


@compiled
def _condition_on_pixel(Sigma: np.ndarray, J: np.ndarray, pixel_var: float) -> None:
    """Sigma (6, 6) of (theta, c) given J c, seen with the image noise."""
    V, s = np.empty((2, 6)), np.empty((2, 2))
    for i in range(2):
        for a in range(6):
            V[i, a] = J[i, 0] * Sigma[3, a] + J[i, 1] * Sigma[4, a] + J[i, 2] * Sigma[5, a]
        for j in range(2):
            s[i, j] = V[i, 3] * J[j, 0] + V[i, 4] * J[j, 1] + V[i, 5] * J[j, 2]
        s[i, i] += pixel_var
    det = s[0, 0] * s[1, 1] - s[0, 1] * s[1, 0]
    for a in range(6):
        g0, g1 = (s[1, 1] * V[0, a] - s[0, 1] * V[1, a]) / det, (s[0, 0] * V[1, a] - s[1, 0] * V[0, a]) / det
        for b in range(6):
            Sigma[a, b] -= g0 * V[0, b] + g1 * V[1, b]


@compiled
def _form(j: np.ndarray, D: np.ndarray, n: np.ndarray) -> np.ndarray:
    """M (6, 6) of one row ``j`` (3,) of J.

    x^T M x = -(j . c)(n . c) / (n . D) - j . (theta x c) - (j . theta)(theta . D) / 2.
    """
    M, depth = np.zeros((6, 6)), n[0] * D[0] + n[1] * D[1] + n[2] * D[2]
    for a in range(3):
        for b in range(3):
            M[a, b] = -0.25 * (j[a] * D[b] + D[a] * j[b])
            M[3 + a, 3 + b] = -0.5 * (j[a] * n[b] + n[a] * j[b]) / depth
    M[0, 4], M[0, 5], M[1, 5] = -0.5 * j[2], 0.5 * j[1], -0.5 * j[0]
    M[1, 3], M[2, 3], M[2, 4] = 0.5 * j[2], -0.5 * j[1], 0.5 * j[0]
    for a in range(3):
        for b in range(3, 6):
            M[b, a] = M[a, b]
    return M
