"""Second-order terms that the linearised measurement leaves out; their covariance counts as measurement noise.

They are products of two errors, and matter where both are large: a filter that leaves them out is overconfident. Their
mean is left out.
"""

import numpy as np

from activeslam_gym.camera import Vector, View
from activeslam_gym.kernels import Record, borrowing
from activeslam_gym.motion import D_ROTATION
from activeslam_gym.slam.belief import KIND_DIM, POINT, RHO

NEGLIGIBLE_PX = 0.2  # the terms of a point are left out where they cannot come to about so much [px]


PRODUCT_FRAMES, IMAGE_PRODUCT_FRAMES = 8.0, 3.0
"""So many frames tell of a product of two errors together what one does; and of images.

The errors of a way and of an inverse depth barely change from frame to frame, so neither does their product. But noise
that is overstated makes the filter follow the camera too slowly, and what it lags behind counts as parallax: a camera
that turns on the spot believes its features too near. In images, whose pixels are nearly exact, it is 3 frames for that
reason. With unknown commands the product is counted once in images, where the noise of a feature grows with its mean
residual, and where there are no fiducials, as way and inverse depths then have one free scale.
"""


@borrowing
def curvature_of_inverse_depth(P: np.ndarray, rho: float, thing: Record, work: np.ndarray) -> None:
    """Write the covariance of the neglected terms of an inverse-depth measurement into ``thing.curvature`` [px^2].

    ``work`` (>= 1, 6, 6) is room for matrices. The point moves by d(rho) (anchor - p) + rho d(anchor - p)
    + d(rho) d(anchor - p). The last, a product of two errors that may both be large, has for Gaussians the covariance
    C = var(rho) D + c c^T, D = Cov(anchor - p), c = Cov(rho, anchor - p); in the image J C J^T, J = H_anchor / rho.
    """
    D, r, H_y = work[0], thing.column + RHO, thing.H_feature
    for i in range(3):
        a = thing.column + i
        for j in range(3):
            b = thing.column + j
            D[i, j] = P[r, r] * (P[a, b] - P[a, j] - P[i, b] + P[i, j]) + (P[r, a] - P[r, i]) * (P[r, b] - P[r, j])
    for i in range(2):
        for j in range(i + 1):
            value = 0.0
            for k in range(3):
                for m in range(3):
                    value += H_y[i, k] * D[k, m] * H_y[j, m]
            thing.curvature[i, j] = value / (rho * rho)
            thing.curvature[j, i] = thing.curvature[i, j]


@borrowing
def curvature_of_point(view: View, P: np.ndarray, y: Vector, thing: Record, work: np.ndarray) -> None:
    """Write the covariance of the neglected terms of a measured point ``y`` (>= 3,) into ``thing.curvature`` [px^2].

    Let D = y - p, n the camera's axis, J = dz/dy. To the camera that turns by theta the point moves by
    c = dy - dp - theta x D, and its pixel by J c and, besides, by

        -(J c) (n . c) / (n . D) - J (theta x c) - (J theta) (theta . D) / 2:

    what is nearer moves farther, what has moved is turned, and a turn is round. Each row is x^T M x with
    x = (theta, c); for a Gaussian x of covariance Sigma, Cov(x^T M_i x, x^T M_j x) = 2 tr(M_i Sigma M_j Sigma).
    Sigma is that given the pixel, where the iterated correction ends: what remains is what the pixel does not tell.

    Where the commands are not known, nothing is written: every frame begins with a wide turn, which all of its points
    tell together and none by itself, so that each would hardly count, and a camera in the hand would be lost.
    ``work`` (>= 4, 6, 6) is room for matrices.
    """
    lens, D = view.camera, (y[0] - view.pose[0], y[1] - view.pose[1], y[2] - view.pose[2])
    turn, way, known = 0.0, 0.0, thing.width < KIND_DIM[POINT]
    for i in range(3):
        k, r = thing.column + i, D_ROTATION.start + i
        turn += P[r, r]
        way += P[i, i] if known else P[i, i] - 2.0 * P[i, k] + P[k, k]
    square = D[0] ** 2 + D[1] ** 2 + D[2] ** 2
    if not lens.command_known or lens.focal * (turn + way / square) < NEGLIGIBLE_PX:
        return
    Sigma, M, first, second, minus_J = work[0], work[1], work[2], work[3], thing.H_camera[:, :3]
    n = (view.R_WC[0, 2], view.R_WC[1, 2], view.R_WC[2, 2])
    _of_turn_and_motion(P, D, thing.column, known, Sigma)
    _condition_on_pixel(Sigma, minus_J, lens.pixel_std**2, M)
    _form(minus_J[0], D, n, M)  # the sign of J does not matter
    _product_of_six(M, Sigma, first)
    _form(minus_J[1], D, n, M)
    _product_of_six(M, Sigma, second)
    a, b, c = 0.0, 0.0, 0.0
    for i in range(6):
        for j in range(6):
            a += first[i, j] * first[j, i]
            b += first[i, j] * second[j, i]
            c += second[i, j] * second[j, i]
    out = thing.curvature
    out[0, 0], out[0, 1], out[1, 0], out[1, 1] = 2.0 * a, 2.0 * b, 2.0 * b, 2.0 * c


@borrowing
def _of_turn_and_motion(P: np.ndarray, D: Vector, column: int, known: bool, Sigma: np.ndarray) -> None:
    """Write the covariance (6, 6) of theta and c = dy - dp - theta x D; y is known, or in ``P`` from ``column`` on."""
    for i in range(3):
        for j in range(3):
            turn, y_i, y_j = D_ROTATION.start + j, column + i, column + j
            Sigma[i, j] = P[D_ROTATION.start + i, turn]
            Sigma[3 + i, j] = -P[i, turn] if known else P[y_i, turn] - P[i, turn]
            Sigma[3 + i, 3 + j] = P[i, j] if known else P[i, j] - P[i, y_j] - P[y_i, j] + P[y_i, y_j]
            Sigma[j, 3 + i] = Sigma[3 + i, j]
    for j in range(6):  # so far of dy - dp
        a, b, c = Sigma[0, j], Sigma[1, j], Sigma[2, j]
        Sigma[3, j] += D[1] * c - D[2] * b
        Sigma[4, j] += D[2] * a - D[0] * c
        Sigma[5, j] += D[0] * b - D[1] * a
    for i in range(6):
        row = Sigma[i]
        a, b, c = row[0], row[1], row[2]
        row[3] += D[1] * c - D[2] * b
        row[4] += D[2] * a - D[0] * c
        row[5] += D[0] * b - D[1] * a


@borrowing
def _condition_on_pixel(Sigma: np.ndarray, J: np.ndarray, pixel_var: float, work: np.ndarray) -> None:
    """Sigma (6, 6) of (theta, c) given J c, seen with the image noise; ``work`` (>= 2, 6)."""
    u, v = work[0], work[1]
    for a in range(6):
        u[a] = J[0, 0] * Sigma[3, a] + J[0, 1] * Sigma[4, a] + J[0, 2] * Sigma[5, a]
        v[a] = J[1, 0] * Sigma[3, a] + J[1, 1] * Sigma[4, a] + J[1, 2] * Sigma[5, a]
    s00 = u[3] * J[0, 0] + u[4] * J[0, 1] + u[5] * J[0, 2] + pixel_var
    s01 = u[3] * J[1, 0] + u[4] * J[1, 1] + u[5] * J[1, 2]
    s11 = v[3] * J[1, 0] + v[4] * J[1, 1] + v[5] * J[1, 2] + pixel_var
    det = s00 * s11 - s01 * s01
    for a in range(6):
        g, h = (s11 * u[a] - s01 * v[a]) / det, (s00 * v[a] - s01 * u[a]) / det
        for b in range(6):
            Sigma[a, b] -= g * u[b] + h * v[b]


@borrowing
def _form(j: np.ndarray, D: Vector, n: Vector, M: np.ndarray) -> None:
    """Write M (6, 6) of one row ``j`` (3,) of J.

    x^T M x = -(j . c)(n . c) / (n . D) - j . (theta x c) - (j . theta)(theta . D) / 2.
    """
    depth = n[0] * D[0] + n[1] * D[1] + n[2] * D[2]
    for a in range(3):
        for b in range(3):
            M[a, b] = -0.25 * (j[a] * D[b] + D[a] * j[b])
            M[3 + a, 3 + b] = -0.5 * (j[a] * n[b] + n[a] * j[b]) / depth
        M[a, 3 + a] = 0.0
    M[0, 4], M[0, 5], M[1, 5] = -0.5 * j[2], 0.5 * j[1], -0.5 * j[0]
    M[1, 3], M[2, 3], M[2, 4] = 0.5 * j[2], -0.5 * j[1], 0.5 * j[0]
    for a in range(3):
        for b in range(3, 6):
            M[b, a] = M[a, b]


@borrowing(fastmath={"contract"})
def _product_of_six(A: np.ndarray, B: np.ndarray, out: np.ndarray) -> None:
    """out = A B, all (6, 6)."""
    for i in range(6):
        target = out[i]
        for j in range(6):
            target[j] = A[i, 0] * B[0, j]
        for k in range(1, 6):
            factor, source = A[i, k], B[k]
            for j in range(6):
                target[j] += factor * source[j]
