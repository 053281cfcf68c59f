"""Criteria: what the measurements predicted from a pose would teach. Each is a function of (P, sight, pixel_var).

``P`` (12 + 3 M, 12 + 3 M) is the joint covariance of camera and points when the measurements are taken, ``sight`` what
is in view then, ``pixel_var`` the variance of the image noise [px^2]. With nothing in view each is 0. To add a
criterion, write its function here, with its name above it: every score, policy and test knows it by that name.

Mutual information is never taken from determinants of P: by the determinant lemma it is 1/2 log2(|S| / |R|), with S
stacked over all predicted measurements. The same number, O(m^3), and no singularity for a fully correlated map. (The
idea in general: Kopitkov and Indelman, "No belief propagation required", IJRR 2017.)
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from activeslam_gym.kernels import compiled, one_of
from activeslam_gym.linalg import cholesky_in_place, log2_det, solve_transposed, subtract_gram
from activeslam_gym.motion import CAMERA_DIM
from activeslam_gym.slam.sight import POSE_DIM, Sight

Criterion = Callable[[np.ndarray, Sight, float], float]
CRITERIA: dict[str, Criterion] = {}
"""The criteria by name."""


def named(name: str) -> Callable[[Any], Any]:
    """Decorator that enters a criterion into `CRITERIA`."""

    def enter(criterion: Any) -> Any:
        CRITERIA[name] = compiled(criterion)
        return CRITERIA[name]

    return enter


@named("mutual_information")
def mutual_information(P: np.ndarray, sight: Sight, pixel_var: float) -> float:
    """I(x; z) = 1/2 log2(|S| / |R|) [bit]: section III-A's measure, by the determinant lemma."""
    return 0.5 * (log2_det(sight.S) - sight.S.shape[0] * math.log2(pixel_var))


@named("mutual_information_camera")
def mutual_information_camera(P: np.ndarray, sight: Sight, pixel_var: float) -> float:
    """I(camera; z) [bit]: for a map that is fully correlated, where the paper replaces x by x_v."""
    return information_about(np.arange(CAMERA_DIM), P, sight)


@named("mutual_information_position_map")
def mutual_information_position_map(P: np.ndarray, sight: Sight, pixel_var: float) -> float:
    """I(position and map; z) [bit]: the live system's measure, which leaves gaze and velocities out (section V).

    Given position and map, a pixel varies only by the camera's rotation; what the invisible part of the map tells
    of that rotation counts as well, so the part is the whole map.
    """
    return information_about(np.concatenate((np.arange(3), np.arange(CAMERA_DIM, P.shape[0]))), P, sight)


@named("fisher_trace")
def fisher_trace(P: np.ndarray, sight: Sight, pixel_var: float) -> float:
    """tr J of J = sum_i H_i^T S_i^-1 H_i over the tangent (section III-B), literally.

    It mixes units and depends on the parameterisation; mostly it counts features whose image is predictable.
    """
    total = 0.0
    for a in range(sight.thing.shape[0]):
        thing = sight.thing[a]
        p, q, r = sight.S[2 * a, 2 * a], sight.S[2 * a, 2 * a + 1], sight.S[2 * a + 1, 2 * a + 1]
        det = p * r - q * q
        for k in range(POSE_DIM):
            h0, h1 = thing.H_camera[0, k], thing.H_camera[1, k]
            total += (r * h0 * h0 - 2.0 * q * h0 * h1 + p * h1 * h1) / det
        for k in range(thing.width):
            h0, h1 = thing.H_feature[0, k], thing.H_feature[1, k]
            total += (r * h0 * h0 - 2.0 * q * h0 * h1 + p * h1 * h1) / det
    return total


@named("fisher_max_eigenvalue")
def fisher_max_eigenvalue(P: np.ndarray, sight: Sight, pixel_var: float) -> float:
    """Largest eigenvalue of the same J (the end of section III-B), from its small twin.

    With A = blockdiag(L_i^-1) H, where L_i L_i^T = S_i, J = A^T A; A A^T (2 v, 2 v) has the same non-zero eigenvalues.
    """
    v = sight.thing.shape[0]
    if v == 0:
        return 0.0
    A_camera, A_feature = np.empty((2 * v, POSE_DIM)), np.zeros((2 * v, 6))
    for a in range(v):
        thing = sight.thing[a]
        l00 = math.sqrt(sight.S[2 * a, 2 * a])
        l10 = sight.S[2 * a + 1, 2 * a] / l00
        l11 = math.sqrt(sight.S[2 * a + 1, 2 * a + 1] - l10 * l10)
        for k in range(POSE_DIM):
            A_camera[2 * a, k] = thing.H_camera[0, k] / l00
            A_camera[2 * a + 1, k] = (thing.H_camera[1, k] - l10 * A_camera[2 * a, k]) / l11
        for k in range(thing.width):
            A_feature[2 * a, k] = thing.H_feature[0, k] / l00
            A_feature[2 * a + 1, k] = (thing.H_feature[1, k] - l10 * A_feature[2 * a, k]) / l11
    G = np.zeros((2 * v, 2 * v))
    for r in range(2 * v):
        for c in range(2 * v):
            for k in range(POSE_DIM):
                G[r, c] += A_camera[r, k] * A_camera[c, k]
            if r // 2 == c // 2:
                for k in range(6):
                    G[r, c] += A_feature[r, k] * A_feature[c, k]
    return np.linalg.eigvalsh(G)[-1]


@named("variance_reduction")
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
    U, V = np.empty((part.shape[0], part.shape[0])), np.empty((part.shape[0], sight.S.shape[0]))
    for i in range(part.shape[0]):
        for j in range(part.shape[0]):
            U[i, j] = P[part[i], part[j]]
        for r in range(sight.S.shape[0]):
            V[i, r] = sight.HP[r, part[i]]
    if not cholesky_in_place(U):
        return np.nan
    solve_transposed(U, V)
    given = sight.S.copy()
    subtract_gram(given, V, given.shape[0])
    return 0.5 * (log2_det(sight.S) - log2_det(given))


criterion_of_number = one_of(list(CRITERIA.values()))
"""For kernels: of (number, P, sight, pixel_var), by the criterion of that number (see `criterion_number`)."""


def criterion_number(criterion: str) -> int:
    """Where a criterion stands in `CRITERIA`.

    Raises:
        ValueError: there is no such criterion; the message lists those that there are.
    """
    if not isinstance(criterion, str) or criterion not in CRITERIA:
        raise ValueError(f"criterion must be one of {', '.join(CRITERIA)}, got {criterion!r}")
    return list(CRITERIA).index(criterion)
