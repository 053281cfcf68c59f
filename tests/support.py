"""What several tests need: numerical derivatives, random beliefs, and matrix formulas written as in a textbook."""

import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from copy import deepcopy as copied  # noqa: F401  (of nested named tuples of arrays and records)
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from activeslam_gym.camera import View, camera_of, pixel_from_camera_point, visible
from activeslam_gym.config import DEPTH_PARTICLES, INVERSE_DEPTH, Scenario
from activeslam_gym.envs.active_slam import ActiveSLAMEnv
from activeslam_gym.envs.run import Run
from activeslam_gym.geometry import rotate_left, rotation_matrix, skew
from activeslam_gym.information.candidates import PredictedBelief
from activeslam_gym.kernels import row
from activeslam_gym.metrics import camera_error
from activeslam_gym.motion import CAMERA_DIM, QUATERNION
from activeslam_gym.slam import belief as layout
from activeslam_gym.slam.belief import KIND_DIM, POINT, RAY, Belief
from activeslam_gym.slam.estimate import EstimateArrays, empty_estimates
from activeslam_gym.slam.kalman import factored_gain, shift_mean, update_covariance
from activeslam_gym.slam.map import append_feature
from activeslam_gym.slam.sight import Sight, sight_of_belief

PAPER = Scenario()
CAMERA = camera_of(PAPER)
NO_FIDUCIALS, NO_BOXES = np.zeros((0, 3)), np.zeros((0, 2, 3))


def replaced(record: np.record, **values: Any) -> np.record:
    """A copy of a record with other ``values``."""
    out = record.copy()
    for name, value in values.items():
        out[name] = value
    return out


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


def pixel_of(camera_model: np.record, camera: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Equation 1, for the world point ``y`` (3,)."""
    z = np.full(2, np.nan)
    assert pixel_from_camera_point(camera_model, rotation_matrix(camera[QUATERNION]).T @ (y - camera[:3]), z)
    return z


def random_spd(rng: np.random.Generator, stds: Sequence[float] | np.ndarray, freedom: int = 3) -> np.ndarray:
    """A covariance (n, n) with about these standard deviations and random correlations."""
    n = len(stds)
    A = rng.standard_normal((n, freedom * n)) / np.sqrt(freedom * n)
    P = A @ A.T * np.outer(stds, stds)
    return 0.5 * (P + P.T)


def prior_belief(scenario: Scenario = PAPER) -> Belief:
    """A scenario's belief before its first frame."""
    belief = row(layout.empty_beliefs(scenario, 1), 0)
    layout.reset_belief(belief, *layout.start_of(scenario))
    return belief


def random_belief(
    scenario: Scenario,
    kinds: Sequence[int],
    rng: np.random.Generator,
    camera: np.ndarray | None = None,
    point_std: float = 0.1,
) -> Belief:
    """A belief with features of these kinds in view, oldest first, and a covariance with all correlations."""
    belief = prior_belief(scenario)
    pose = belief.state.camera
    pose[:] = random_camera(rng) if camera is None else camera
    stds = [[0.05] * 3 + [0.02] * 3 + [0.1] * 6]
    for kind, y in zip(kinds, world_points(rng, pose, len(kinds)), strict=True):
        width = KIND_DIM[kind]
        mean = np.zeros(6)
        if kind == POINT:
            mean[:3] = y
            stds.append([point_std] * 3)
        else:
            anchor = pose[:3] + 0.1 * rng.standard_normal(3)
            sight = y - anchor
            depth = np.linalg.norm(sight)
            mean[:3] = anchor
            mean[3], mean[4] = np.arctan2(sight[0], sight[2]), np.arcsin(sight[1] / depth)
            mean[5] = 1.0 / depth
            stds.append([0.05] * 3 + [0.02] * 2 + [0.1 / depth] * (width - 5))
        feature = belief.feature[append_feature(belief, kind, mean, np.zeros((width, CAMERA_DIM)), np.eye(width))]
        if kind == RAY:
            particles = belief.particles[feature.slot]
            particles[:, 0], particles[:, 1] = np.linspace(0.5 * depth, 1.5 * depth, len(particles)), 1 / len(particles)
            feature.depth, feature.depth_var, feature.weighed_at[:] = depth, 0.3**2, pose[:3]
    dim = belief.state.dim
    belief.covariance[:dim, :dim] = random_spd(rng, np.concatenate(stds))
    return belief


def scenario_for(kinds: Sequence[int]) -> Scenario:
    """The paper's scenario with the initialiser that makes such features."""
    return Scenario(initialisation=DEPTH_PARTICLES if RAY in kinds else INVERSE_DEPTH)


def estimate_of(belief: Belief, ratio: float = PAPER.mapped_depth_ratio) -> EstimateArrays:
    """The estimate of a belief."""
    estimate = row(empty_estimates(len(belief.feature), 1), 0)
    layout.write_estimate(belief, ratio, estimate)
    return estimate


def public(belief: Belief) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) and covariance of the public belief."""
    estimate, n = estimate_of(belief), int(belief.state.count)
    size = CAMERA_DIM + 3 * n
    return estimate.landmark["point"][:n].copy(), estimate.covariance[:size, :size].copy()


def features_of(belief: Belief) -> np.ndarray:
    """(n,) the features in use, oldest first: a view."""
    return belief.feature[: belief.state.count]


def joint_covariance(belief: Belief) -> np.ndarray:
    """The part of the covariance in use, (dim, dim)."""
    return belief.covariance[: belief.state.dim, : belief.state.dim].copy()


def rows_of(belief: Belief, k: int) -> np.ndarray:
    """Covariance rows of feature ``k``."""
    return belief.feature[k].start + np.arange(KIND_DIM[belief.feature[k].kind])


def mean_difference(one: Belief, other: Belief) -> np.ndarray:
    """one ⊟ other, (dim,): camera, then the features from the oldest to the youngest."""
    parts = [camera_error(one.state.camera, other.state.camera)]
    for a, b in zip(features_of(one), features_of(other), strict=True):
        parts.append((a.mean - b.mean)[: KIND_DIM[a.kind]])
    return np.concatenate(parts)


def sight_of(belief: Belief, fiducials: np.ndarray = NO_FIDUCIALS, boxes: np.ndarray = NO_BOXES) -> Sight:
    """What the paper's camera should see."""
    return sight_of_belief(CAMERA, belief, fiducials, boxes)


def dense_H(sight: Sight) -> np.ndarray:
    """H (2 v, dim) of all that is in sight."""
    H = np.zeros(sight.HP.shape)
    for H_point, point in zip(H.reshape(-1, 2, H.shape[1]), sight.point, strict=True):
        column, width = point["column"], point["width"]
        H_point[:, :6] = point["H_camera"]
        H_point[:, column : column + width] = point["H_feature"][:, :width]
    return H


def log2_det(A: np.ndarray) -> float:
    """log2 |A| of a positive definite matrix, scaled first so that mixed units cost no digits."""
    scale = np.sqrt(np.diag(A))
    L = np.linalg.cholesky(A / np.outer(scale, scale))
    return float(2.0 * np.sum(np.log2(np.diag(L))) + 2.0 * np.sum(np.log2(scale)))


def predicted_belief_with(
    points: np.ndarray,
    covariance: np.ndarray,
    camera: np.ndarray,
    fiducials: np.ndarray = NO_FIDUCIALS,
    waiting: int = 0,
) -> PredictedBelief:
    """A belief of these points (M, 3) with the joint covariance (12 + 3 M)^2; the last ``waiting`` are expected."""
    points = np.ascontiguousarray(np.reshape(points, (-1, 3)), float)
    return PredictedBelief(camera, points, np.ascontiguousarray(covariance, float), fiducials, NO_BOXES, waiting)


def numerical_sight(model: np.record, belief: PredictedBelief, pose: np.ndarray) -> np.ndarray:
    """H (2 v, 12 + 3 M) of everything in the image of ``pose``, fiducials first, by numerical differentiation."""
    K, M = len(belief.fiducials), len(belief.points)
    view, z = View(model, pose, rotation_matrix(pose[QUATERNION]), belief.boxes), np.empty(2)
    blocks = [np.zeros((0, 12 + 3 * M))]
    for i, y in enumerate(np.concatenate((belief.fiducials, belief.points))):
        if visible(view, y, 0.0, z):
            H = np.zeros((2, 12 + 3 * M))
            H[:, :6] = numerical_jacobian(lambda e, y=y: pixel_of(model, moved(pose, e), y), 6, 1e-3)
            if i >= K:
                at = 12 + 3 * (i - K)
                H[:, at : at + 3] = numerical_jacobian(lambda e, y=y: pixel_of(model, pose, y + e), 3, 1e-3)
            blocks.append(H)
    return np.concatenate(blocks)


def simulation_of(env: Any) -> Run:
    """The arrays behind an environment: the one place where the tests look inside it."""
    inner = env.unwrapped
    assert isinstance(inner, ActiveSLAMEnv)
    return inner._run


def moments(env: Any, seed: int | None, actions: Any) -> tuple[np.ndarray, np.ndarray, list[dict[str, Any]]]:
    """Observations (K + 1, D), rewards (K,) and infos (K + 1) of a reset and of ``actions``, until the end."""
    told, over = [(*env.reset(seed=seed), 0.0)], False
    for action in actions:
        if not over:
            observation, reward, terminated, truncated, info = env.step(action)
            told.append((observation, info, float(reward)))
            over = terminated or truncated
    observations, infos, rewards = zip(*told, strict=True)
    return np.array(observations), np.array(rewards[1:]), list(infos)


def random_actions(count: int, seed: int = 0) -> np.ndarray:
    """(count, 2) motions and gazes."""
    return np.random.default_rng(seed).integers((7, 3), size=(count, 2))


def turn_of_everything(belief: Belief) -> np.ndarray:
    """N (dim, 3): what a small turn of camera and map about each world axis does to the coordinates."""
    N, camera = np.zeros((belief.state.dim, 3)), belief.state.camera
    N[3:6] = np.eye(3)
    vectors = {0: camera[:3], 6: camera[7:10], 9: camera[10:]}
    for feature in features_of(belief):
        vectors[int(feature.start)] = feature.mean[:3]
        if feature.kind != POINT:
            J_h, m = np.empty((2, 3)), np.array(layout.bearing(feature.mean[3], feature.mean[4])[0])
            layout.angles_of(m, J_h)
            N[feature.start + 3 : feature.start + 5] = J_h @ -skew(m)
    for start, vector in vectors.items():
        N[start : start + 3] = -skew(vector)
    return N


def assert_same_record(one: dict[str, Any], other: dict[str, Any]) -> None:
    """The same arrays of two episodes to the bit, wall-clock times apart."""
    assert set(one) == set(other)
    for field in set(one) - {"decision_us"}:
        np.testing.assert_array_equal(one[field], other[field], err_msg=field)


def python(*arguments: str | Path, cwd: Path | None = None, **environment: str) -> str:
    """What a fresh interpreter with these arguments prints; it must not fail."""
    command = [sys.executable, *map(str, arguments)]
    done = subprocess.run(command, cwd=cwd, env=os.environ | environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def update(belief: Belief, HP: np.ndarray, S: np.ndarray, innovation: np.ndarray) -> bool:
    """One Kalman update, as `correct` makes it at the end; False, with nothing changed, if S has no factor."""
    W, delta, sound = factored_gain(HP, S, innovation)
    if sound:
        shift_mean(belief, delta)
        update_covariance(belief, W, delta)
    return bool(sound)


def until(holds: Callable[[], Any], seconds: float = 60.0) -> Any:
    """Wait until it holds; its value."""
    end = time.monotonic() + seconds
    while not (value := holds()) and time.monotonic() < end:
        time.sleep(0.05)
    assert value, "it did not happen in time"
    return value
