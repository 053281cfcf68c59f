"""What several tests need: numerical derivatives, random beliefs, and matrix formulas written as in a textbook."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from activeslam_gym.camera import CameraModel, camera_of, inside_image, pixel_from_camera_point
from activeslam_gym.config import DEPTH_PARTICLES, INVERSE_DEPTH, Scenario
from activeslam_gym.envs.active_slam import ActiveSLAMEnv
from activeslam_gym.envs.frame import Simulation
from activeslam_gym.geometry import rotate_left, rotation_error, rotation_matrix, skew
from activeslam_gym.information import Prospect
from activeslam_gym.metrics import camera_error
from activeslam_gym.motion import CAMERA_DIM, QUATERNION
from activeslam_gym.slam import belief as layout
from activeslam_gym.slam.belief import DIM, FEATURES, KIND_DIM, POINT, RAY, Belief
from activeslam_gym.slam.measurement import Predictions

PAPER = Scenario()
CAMERA = camera_of(PAPER)


# Numerical derivatives ----------------------------------------------------------------------------------------------


def numerical_jacobian(f: Callable[[np.ndarray], Any], size: int, step: float) -> np.ndarray:
    """df/de at e = 0 (n, size) by central differences of the fourth order."""

    def slope(j: int) -> np.ndarray:
        e = step * np.eye(size)[j]
        return (8.0 * (f(e) - f(-e)) - (f(2.0 * e) - f(-2.0 * e))) / (12.0 * step)

    return np.stack([np.ravel(slope(j)) for j in range(size)], axis=1)


def relative_error(found: np.ndarray, expected: np.ndarray) -> float:
    """Largest error of a column relative to its own length; a column of zeros is measured by the longest."""
    lengths = np.linalg.norm(expected, axis=0)
    lengths[lengths < 1e-9 * lengths.max()] = lengths.max()
    return float(np.max(np.linalg.norm(found - expected, axis=0) / lengths))


# Cameras ------------------------------------------------------------------------------------------------------------


def random_camera(rng: np.random.Generator, spread: float = 0.3, turn: float = 0.3) -> np.ndarray:
    """A camera (13,) near the room's centre, facing about +Z, on the move."""
    camera = np.empty(13)
    camera[:3] = spread * rng.standard_normal(3)
    camera[QUATERNION] = Rotation.from_rotvec(turn * rng.standard_normal(3)).as_quat(scalar_first=True)
    camera[7:] = 0.3 * rng.standard_normal(6)
    return camera


def moved(camera: np.ndarray, e: np.ndarray) -> np.ndarray:
    """camera ⊞ e: the tangent vector (6,) or (12,) added to the mean (13,), the rotation in the world frame."""
    out = camera.copy()
    out[:3] += e[:3]
    out[QUATERNION] = rotate_left(e[3:6], camera[QUATERNION])
    out[7:] += np.concatenate((e[6:], np.zeros(12 - len(e))))
    return out


def world_points(
    rng: np.random.Generator, camera: np.ndarray, count: int, depth: tuple[float, float] = (1.0, 4.0)
) -> np.ndarray:
    """Points (count, 3) in front of the camera, well inside its image."""
    z = rng.uniform(*depth, count)
    points_C = np.stack((z * rng.uniform(-0.5, 0.5, count), z * rng.uniform(-0.35, 0.35, count), z), axis=1)
    return camera[:3] + points_C @ rotation_matrix(camera[QUATERNION]).T


def pixel_of(camera_model: CameraModel, camera: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Equation 1, for the world point ``y`` (3,)."""
    z = np.full(2, np.nan)
    assert pixel_from_camera_point(camera_model, rotation_matrix(camera[QUATERNION]).T @ (y - camera[:3]), z)
    return z


# Beliefs ------------------------------------------------------------------------------------------------------------


def random_spd(rng: np.random.Generator, stds: Sequence[float] | np.ndarray, freedom: int = 3) -> np.ndarray:
    """A covariance (n, n) with about these standard deviations and random correlations."""
    n = len(stds)
    A = rng.standard_normal((n, freedom * n)) / np.sqrt(freedom * n)
    P = A @ A.T * np.outer(stds, stds)
    return 0.5 * (P + P.T)


def random_belief(
    scenario: Scenario,
    kinds: Sequence[int],
    rng: np.random.Generator,
    camera: np.ndarray | None = None,
    point_std: float = 0.1,
) -> Belief:
    """A belief with features of these kinds in view, oldest first, and a covariance with all correlations."""
    belief = layout.empty_belief(scenario)
    layout.reset_belief(belief, scenario)
    belief.camera[:] = random_camera(rng) if camera is None else camera
    stds = [[0.05] * 3 + [0.02] * 3 + [0.1] * 6]
    for kind, y in zip(kinds, world_points(rng, belief.camera, len(kinds)), strict=True):
        width = KIND_DIM[kind]
        mean = np.zeros(6)
        if kind == POINT:
            mean[:3] = y
            stds.append([point_std] * 3)
        else:
            anchor = belief.camera[:3] + 0.1 * rng.standard_normal(3)
            sight = y - anchor
            depth = np.linalg.norm(sight)
            mean[:3] = anchor
            mean[3], mean[4] = np.arctan2(sight[0], sight[2]), np.arcsin(sight[1] / depth)
            mean[5] = 1.0 / depth
            stds.append([0.05] * 3 + [0.02] * 2 + [0.1 / depth] * (width - 5))
        slot = layout.append_feature(belief, kind, mean, np.zeros((width, CAMERA_DIM)), np.eye(width))
        if kind == RAY:
            belief.depth[slot] = depth, 0.3**2
            belief.particles[slot, :, 0] = np.linspace(0.5 * depth, 1.5 * depth, belief.particles.shape[1])
            belief.particles[slot, :, 1] = 1.0 / belief.particles.shape[1]
            belief.weighed_at[slot] = belief.camera[:3]
    dim = belief.size[DIM]
    belief.covariance[:dim, :dim] = random_spd(rng, np.concatenate(stds))
    return belief


def scenario_for(kinds: Sequence[int]) -> Scenario:
    """The paper's scenario with the initialiser that makes such features."""
    return Scenario(initialisation=DEPTH_PARTICLES if RAY in kinds else INVERSE_DEPTH)


def slots_of(belief: Belief) -> list[int]:
    """Slots in use, oldest first."""
    return belief.order[: belief.size[FEATURES]].tolist()


def joint_covariance(belief: Belief) -> np.ndarray:
    """The part of the covariance in use, (dim, dim)."""
    return belief.covariance[: belief.size[DIM], : belief.size[DIM]].copy()


def rows_of(belief: Belief, slot: int) -> np.ndarray:
    """Covariance rows of a feature."""
    return belief.start[slot] + np.arange(KIND_DIM[belief.kind[slot]])


def copied(arrays: Any) -> Any:
    """A deep copy of a (nested) named tuple of arrays."""
    return type(arrays)(*(a.copy() if isinstance(a, np.ndarray) else copied(a) for a in arrays))


def mean_difference(one: Belief, other: Belief) -> np.ndarray:
    """one ⊟ other, (dim,): camera, then the features from the oldest to the youngest."""
    parts = [camera_error(one.camera, other.camera)]
    for slot in slots_of(one):
        width = KIND_DIM[one.kind[slot]]
        parts.append(one.feature[slot, :width] - other.feature[slot, :width])
    return np.concatenate(parts)


def dense_H(belief: Belief, K: int, rows: Sequence[int] | np.ndarray, predictions: Predictions) -> np.ndarray:
    """H (2 M, dim) of the stacked rows."""
    H = np.zeros((2 * len(rows), belief.size[DIM]))
    for i, row in enumerate(rows):
        H[2 * i : 2 * i + 2, :6] = predictions.H_camera[row]
        if row >= K:
            columns = rows_of(belief, row - K)
            H[2 * i : 2 * i + 2, columns] = predictions.H_feature[row][:, : len(columns)]
    return H


def log2_det(A: np.ndarray) -> float:
    """log2 |A| of a positive definite matrix, scaled first so that mixed units cost no digits."""
    scale = np.sqrt(np.diag(A))
    L = np.linalg.cholesky(A / np.outer(scale, scale))
    return float(2.0 * np.sum(np.log2(np.diag(L))) + 2.0 * np.sum(np.log2(scale)))


# Prospects ----------------------------------------------------------------------------------------------------------


def prospect_with(
    points: np.ndarray, covariance: np.ndarray, camera: np.ndarray, fiducials: np.ndarray | None = None
) -> Prospect:
    """A prospect of these points (M, 3) with the joint covariance (12 + 3 M)^2."""
    return Prospect(
        camera,
        np.ascontiguousarray(np.reshape(points, (-1, 3)), float),
        np.ascontiguousarray(covariance, float),
        np.zeros((0, 3)) if fiducials is None else np.ascontiguousarray(fiducials, float),
    )


def numerical_sight(model: CameraModel, prospect: Prospect, pose: np.ndarray) -> np.ndarray:
    """H (2 v, 12 + 3 M) of everything in the image of ``pose``, fiducials first, by numerical differentiation."""
    K, M = len(prospect.fiducials), len(prospect.points)
    blocks = []
    for i, y in enumerate(np.concatenate((prospect.fiducials, prospect.points))):
        p_C = rotation_matrix(pose[QUATERNION]).T @ (y - pose[:3])
        z = np.empty(2)
        if (
            p_C[2] < model.minimum_depth
            or not pixel_from_camera_point(model, p_C, z)
            or not inside_image(model, z, 0.0)
        ):
            continue
        H = np.zeros((2, 12 + 3 * M))
        H[:, :6] = numerical_jacobian(lambda e, y=y: pixel_of(model, moved(pose, e), y), 6, 1e-3)
        if i >= K:
            at = 12 + 3 * (i - K)
            H[:, at : at + 3] = numerical_jacobian(lambda e, y=y: pixel_of(model, pose, y + e), 3, 1e-3)
        blocks.append(H)
    return np.concatenate(blocks) if blocks else np.zeros((0, 12 + 3 * M))


# Environments -------------------------------------------------------------------------------------------------------


def simulation_of(env: Any) -> Simulation:
    """The arrays behind an environment: the one place where the tests look inside it."""
    inner = env.unwrapped
    assert isinstance(inner, ActiveSLAMEnv)
    return inner._run.simulation


def rotation_between(q_true: np.ndarray, q_hat: np.ndarray) -> np.ndarray:
    """Log(R_true R_hat^T) (3,)."""
    return rotation_error(np.ascontiguousarray(q_true), np.ascontiguousarray(q_hat))


def turn_of_everything(belief: Belief) -> np.ndarray:
    """N (dim, 3): what a small turn of camera and map about each world axis does to the coordinates."""
    N = np.zeros((belief.size[DIM], 3))
    N[3:6] = np.eye(3)
    vectors = {0: belief.camera[:3], 6: belief.camera[7:10], 9: belief.camera[10:]}
    for slot in slots_of(belief):
        vectors[int(belief.start[slot])] = belief.feature[slot, :3]
        if belief.kind[slot] != POINT:
            angles = belief.feature[slot, 3:5]
            J_h = np.empty((2, 3))
            m = layout.bearing(*angles)[0]
            layout.angles_of(m, J_h)
            N[rows_of(belief, slot)[3:5]] = J_h @ -skew(m)
    for start, vector in vectors.items():
        N[start : start + 3] = -skew(vector)
    return N
