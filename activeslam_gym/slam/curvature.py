"""The second-order term of an inverse depth that the linearised measurement leaves out; its covariance counts as noise.

It is a product of two errors, and matters where both are large: a filter that leaves it out is overconfident. Its mean
is left out.
"""

import numpy as np

from activeslam_gym.kernels import Record, borrowing
from activeslam_gym.slam.belief import RHO

PRODUCT_FRAMES, IMAGE_PRODUCT_FRAMES = 8.0, 3.0
"""So many frames tell of a product of two errors together what one does; and of images.

The errors of a way and of an inverse depth barely change from frame to frame, so neither does their product. But noise
that is overstated makes the filter follow the camera too slowly, and what it lags behind counts as parallax: a camera
that turns on the spot believes its features too near. In images, whose pixels are nearly exact, it is 3 frames for that
reason. With unknown commands the product is counted once in images, where the noise of a feature grows with its mean
residual, and where there are no fiducials, as way and inverse depths then have one free scale.
"""


@borrowing
def curvature_of_inverse_depth(P: np.ndarray, rho: float, point: Record, D: np.ndarray) -> None:
    """Write the covariance of the neglected term of an inverse-depth measurement into ``point.curvature`` [px^2].

    ``D`` (3, 3) is room for a matrix. The point moves by d(rho) (anchor - p) + rho d(anchor - p)
    + d(rho) d(anchor - p). The last, a product of two errors that may both be large, has for Gaussians the covariance
    C = var(rho) D + c c^T, D = Cov(anchor - p), c = Cov(rho, anchor - p); in the image J C J^T, J = H_anchor / rho.
    """
    r, H_y = point.column + RHO, point.H_feature
    for i in range(3):
        a = point.column + i
        for j in range(3):
            b = point.column + j
            D[i, j] = P[r, r] * (P[a, b] - P[a, j] - P[i, b] + P[i, j]) + (P[r, a] - P[r, i]) * (P[r, b] - P[r, j])
    for i in range(2):
        for j in range(i + 1):
            value = 0.0
            for k in range(3):
                for m in range(3):
                    value += H_y[i, k] * D[k, m] * H_y[j, m]
            point.curvature[i, j] = value / (rho * rho)
            point.curvature[j, i] = point.curvature[i, j]
