"""Criteria: what the measurements predicted from a pose would teach. Each is a function of (P, sight, pixel_var).

``P`` (12 + 3 M, 12 + 3 M) is the joint covariance of camera and points when the measurements are taken, ``sight`` what
is in view then, ``pixel_var`` the variance of the image noise [px^2]. With nothing in view each is 0. Those of this
module are compiled into the kernel of the scores. Any other function of these three is called from Python: scores and
policies take it in place of a name.

Mutual information is never taken from determinants of P: by the determinant lemma it is 1/2 log2(|S| / |R|), with S
stacked over all predicted measurements. The same number, O(m^3), and no singularity for a fully correlated map. (The
idea in general: Kopitkov and Indelman, "No belief propagation required", IJRR 2017.)
"""

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np

from activeslam_gym.kernels import compiled, one_of
from activeslam_gym.linalg import cholesky_in_place, copy_block, log2_det, product, solve_transposed, subtract_symmetric
from activeslam_gym.motion import CAMERA_DIM
from activeslam_gym.slam.sight import Sight

Criterion = Callable[[np.ndarray, Sight, float], float]


@compiled
def mutual_information(P: np.ndarray, sight: Sight, pixel_var: float) -> float:
    """I(x; z) = 1/2 log2(|S| / |R|) [bit]: section III-A's measure, by the determinant lemma."""
    return 0.5 * (log2_det(sight.S) - sight.S.shape[0] * math.log2(pixel_var))


@compiled
def net_information(P: np.ndarray, sight: Sight, pixel_var: float) -> float:
    """Of one set of measurements, `mutual_information` [bit]; scores of plans by this name are `net.net_of_plans`.

    Those are net of the entropy that process noise adds, and leave out the expected landmarks that the present image
    would show: nothing was found there.
    """
    return mutual_information(P, sight, pixel_var)


@compiled
def mutual_information_camera(P: np.ndarray, sight: Sight, pixel_var: float) -> float:
    """I(camera; z) [bit]: for a map that is fully correlated, where the paper replaces x by x_v."""
    return information_about(np.arange(CAMERA_DIM), P, sight)


@compiled
def mutual_information_position_map(P: np.ndarray, sight: Sight, pixel_var: float) -> float:
    """I(position and map; z) [bit]: the live system's measure, which leaves gaze and velocities out (section V).

    Given position and map, a pixel varies only by the camera's rotation; what the invisible part of the map tells
    of that rotation counts as well, so the part is the whole map.
    """
    return information_about(np.concatenate((np.arange(3), np.arange(CAMERA_DIM, P.shape[0]))), P, sight)


@compiled
def _whitened(P: np.ndarray, sight: Sight) -> np.ndarray:
    """A (2 v, 12 + 3 M) with A^T A = J = sum_i H_i^T S_i^-1 H_i: the rows U_i^-T H_i, where S_i = U_i^T U_i.

    A measurement of more than two numbers is several consecutive points of one row. NaN where an S_i has no factor.
    """
    (v, first), A = (sight.point.shape[0], 0), np.zeros((2 * sight.point.shape[0], P.shape[0]))
    for a in range(v):
        point, rows = sight.point[a], A[2 * a : 2 * a + 2]
        copy_block(point.H_camera, rows)
        copy_block(point.H_feature[:, : point.width], rows[:, point.column :])
        if a == v - 1 or sight.point[a + 1].row != point.row:  # the last of its measurement
            U = sight.S[2 * first : 2 * a + 2, 2 * first : 2 * a + 2].copy()
            if not cholesky_in_place(U):
                A[:] = np.nan
                return A
            solve_transposed(U, A[2 * first : 2 * a + 2])
            first = a + 1
    return A


@compiled
def fisher_trace(P: np.ndarray, sight: Sight, pixel_var: float) -> float:
    """tr J of J = sum_i H_i^T S_i^-1 H_i over the tangent (section III-B), literally.

    It mixes units and depends on the parameterisation; mostly it counts features whose image is predictable.
    """
    A = _whitened(P, sight)
    return np.sum(A * A)


@compiled
def fisher_max_eigenvalue(P: np.ndarray, sight: Sight, pixel_var: float) -> float:
    """Largest eigenvalue of the same J = A^T A (the end of section III-B), which is that of A A^T (2 v, 2 v) too."""
    A = _whitened(P, sight)
    if A.shape[0] == 0 or math.isnan(A[0, 0]):
        return np.sum(A)
    return np.linalg.eigvalsh(product(A, A.T))[-1]


@compiled
def variance_reduction(P: np.ndarray, sight: Sight, pixel_var: float) -> float:
    """tr(P H^T S^-1 H P): how much the update that is predicted lowers tr P. With U^T U = S it is |U^-T H P|^2."""
    U, W = sight.S.copy(), sight.HP.copy()
    if not cholesky_in_place(U):
        return np.nan
    solve_transposed(U, W)
    return np.sum(W * W)


@compiled
def information_about(part: np.ndarray, P: np.ndarray, sight: Sight) -> float:
    """I(part; z) = 1/2 log2(|S| / |S - C P_part^-1 C^T|) [bit], C = cov(z, part), ``part`` (d,) rows of ``P``."""
    U, V = P[part][:, part].copy(), sight.HP[:, part].T.copy()
    if not cholesky_in_place(U):
        return np.nan
    solve_transposed(U, V)
    given = sight.S.copy()
    subtract_symmetric(given, V, V, given.shape[0])
    return 0.5 * (log2_det(sight.S) - log2_det(given))


_OWN = (
    mutual_information,
    net_information,
    mutual_information_camera,
    mutual_information_position_map,
    fisher_trace,
    fisher_max_eigenvalue,
    variance_reduction,
)
CRITERIA: Mapping[str, Criterion] = MappingProxyType({one.__name__: one for one in _OWN})
"""The criteria by name."""
criterion_of_number = one_of(_OWN)
"""For kernels: of (number, P, sight, pixel_var), by the criterion of that number (see `registry.number_of`)."""
NET = list(CRITERIA).index("net_information")  # the criterion whose scores are net
