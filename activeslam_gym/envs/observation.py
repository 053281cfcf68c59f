"""The observation: a flat vector of what the belief holds, global features first, then one token per thing.

Directions are in camera axes (x left, y up, z forward) and every number is scaled by a constant and clipped to [-1, 1].
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from activeslam_gym.camera import CameraModel, camera_point, inside_image, pixel_from_camera_point
from activeslam_gym.compilation import part
from activeslam_gym.config import Scenario
from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.information import Expectation
from activeslam_gym.linalg import log2_det_3
from activeslam_gym.motion import CAMERA_DIM, MOTION_COUNT, QUATERNION, MotionModel
from activeslam_gym.slam.belief import FEATURES, FREE, Belief, feature_capacity

GLOBAL_FEATURES = {
    "position": 3,
    "forward": 3,
    "up": 3,
    "velocity": 3,
    "angular_velocity": 3,
    "time": 1,
    "phase": 1,
    "motion": MOTION_COUNT,
    "uncertainty": 4,
    "mapped": 1,
    "counting": 1,
    "features": 1,
    "gain": 1,
}
"""Name and length of each global feature, in order; `ActiveSLAMEnv` says what each is, and its scale."""

TOKEN_FEATURES = {
    "direction": 3,
    "log_distance": 1,
    "log_uncertainty": 1,
    "log_depth_uncertainty": 1,
    "in_view": 1,
    "fiducial": 1,
    "expected": 1,
    "initialising": 1,
    "mapped": 1,
}
"""Name and length of each feature of a token, in order; `ActiveSLAMEnv` says what each is, and its scale."""

_LOG_FLOOR = 1e-3
"""Deviations below this are told as this: 1 mm, 1 mrad."""
_GAIN_SCALE = 10.0
GLOBAL_SIZE = sum(GLOBAL_FEATURES.values())
TOKEN_SIZE = sum(TOKEN_FEATURES.values())
_FIDUCIAL, _EXPECTED, _INITIALISING, _MAPPED = 7, 8, 9, 10


@dataclass(frozen=True)
class ObservationLayout:
    """Where each part of a flat observation (D,) stands."""

    global_slices: dict[str, slice]
    """Name of each global feature, and where it stands in the observation."""
    tokens: slice
    """Where the tokens stand; reshape it to `token_shape`."""
    token_shape: tuple[int, int]
    """(tokens, features of a token): fiducials first, then landmark slots."""
    token_slices: dict[str, slice]
    """Name of each feature of a token, and where it stands in a token."""
    fiducial_count: int
    """Leading tokens that are fiducials."""
    size: int
    """D."""


def layout_of(scenario: Scenario) -> ObservationLayout:
    """The observation's layout, which depends on the scenario alone."""
    count = scenario.fiducial_count + feature_capacity(scenario)
    return ObservationLayout(
        global_slices=_slices(GLOBAL_FEATURES),
        tokens=slice(GLOBAL_SIZE, GLOBAL_SIZE + count * TOKEN_SIZE),
        token_shape=(count, TOKEN_SIZE),
        token_slices=_slices(TOKEN_FEATURES),
        fiducial_count=scenario.fiducial_count,
        size=GLOBAL_SIZE + count * TOKEN_SIZE,
    )


def _slices(lengths: dict[str, int]) -> dict[str, slice]:
    ends = np.cumsum(list(lengths.values())).tolist()
    return {name: slice(end - length, end) for (name, length), end in zip(lengths.items(), ends, strict=True)}


@part
def observe_globals(
    motion: MotionModel,
    belief: Belief,
    time: float,
    phase: float,
    motion_index: int,
    mapped: int,
    counting: int,
    landmarks: int,
    gain: float,
    out: np.ndarray,
) -> None:
    """Write the global features into ``out`` (G,), unclipped. ``time`` and ``phase`` in [0, 1], ``gain`` [bit]."""
    x, P = belief.camera, belief.covariance
    R_WC = rotation_matrix(x[QUATERNION])
    out[:] = 0.0
    half = (motion.half_x, motion.half_y, motion.half_z)
    for i in range(3):
        out[i] = x[i] / half[i]
        out[3 + i], out[6 + i] = R_WC[i, 2], R_WC[i, 1]
        out[9 + i], out[12 + i] = x[7 + i], x[10 + i]
    out[15], out[16] = time, phase
    out[17 + motion_index] = 1.0
    at = 17 + MOTION_COUNT
    for block in range(4):
        variance = (P[3 * block, 3 * block] + P[3 * block + 1, 3 * block + 1] + P[3 * block + 2, 3 * block + 2]) / 3.0
        out[at + block] = _log_deviation(math.sqrt(max(variance, 0.0)))
    out[at + 4], out[at + 5] = mapped / landmarks, counting / landmarks
    out[at + 6] = belief.size[FEATURES] / belief.kind.shape[0]
    out[at + 7] = gain / (_GAIN_SCALE * (CAMERA_DIM + 3 * landmarks))


@part
def observe_tokens(
    camera: CameraModel,
    belief: Belief,
    points: np.ndarray,
    covariance: np.ndarray,
    expectation: Expectation,
    fiducials: np.ndarray,
    mapped: np.ndarray,
    out: np.ndarray,
) -> None:
    """Write the tokens into ``out`` (T, W), unclipped: fiducials, then slots.

    A feature has its slot's token for life; waiting expected landmarks take the tokens of free slots, in order, as many
    as there are. ``points``, ``covariance``, ``mapped`` (n,): the public belief, by age.
    """
    pose = belief.camera
    R_WC = rotation_matrix(pose[QUATERNION])
    K, F = fiducials.shape[0], belief.kind.shape[0]
    out[:] = 0.0
    for i in range(K):
        _place(camera, pose, R_WC, fiducials[i], out[i])
        out[i, 4], out[i, 5], out[i, _FIDUCIAL] = -1.0, -1.0, 1.0
    for k in range(belief.size[FEATURES]):
        token = out[K + belief.order[k]]
        at = CAMERA_DIM + 3 * k
        _place(camera, pose, R_WC, points[k], token)
        _uncertainty(pose, points[k], covariance[at:, at:], token)
        token[_MAPPED if mapped[k] else _INITIALISING] = 1.0
    slot = 0
    prior = np.zeros((3, 3))
    for i in range(3):
        prior[i, i] = expectation.variance[i]
    for e in range(expectation.slot.shape[0]):
        if expectation.slot[e] < 0:
            while slot < F and belief.kind[slot] != FREE:
                slot += 1
            if slot == F:
                return
            _place(camera, pose, R_WC, expectation.points[e], out[K + slot])
            _uncertainty(pose, expectation.points[e], prior, out[K + slot])
            out[K + slot, _EXPECTED] = 1.0
            slot += 1


@part
def _place(camera: CameraModel, pose: np.ndarray, R_WC: np.ndarray, y: np.ndarray, token: np.ndarray) -> None:
    """Direction, log distance and visibility of the world point ``y`` (3,)."""
    p_C = camera_point(R_WC, pose, y)
    distance = max(math.sqrt(p_C[0] * p_C[0] + p_C[1] * p_C[1] + p_C[2] * p_C[2]), _LOG_FLOOR)
    for i in range(3):
        token[i] = p_C[i] / distance
    token[3] = math.log10(distance) / 1.5
    z = np.empty(2)
    if p_C[2] >= camera.minimum_depth and pixel_from_camera_point(camera, p_C, z) and inside_image(camera, z, 0.0):
        token[6] = 1.0


@part
def _uncertainty(pose: np.ndarray, y: np.ndarray, P_y: np.ndarray, token: np.ndarray) -> None:
    """Log deviation of a point: geometric mean, and along the line of sight relative to the distance."""
    square, along = _LOG_FLOOR**2, 0.0
    for i in range(3):
        sight = y[i] - pose[i]
        square += sight * sight
        for j in range(3):
            along += sight * P_y[i, j] * (y[j] - pose[j])
    log2_deviation = log2_det_3(P_y) / 6.0
    token[4] = math.log10(2.0) * log2_deviation / 3.0 if math.isfinite(log2_deviation) else 1.0
    token[5] = _log_deviation(math.sqrt(max(along, 0.0)) / square)


@part
def _log_deviation(deviation: float) -> float:
    return math.log10(max(deviation, _LOG_FLOOR)) / 3.0


@part
def clip_into(values: np.ndarray, out: np.ndarray) -> None:
    """Write ``values`` (D,) clipped to [-1, 1] into ``out`` (D,) float32; what is not a number becomes 0."""
    for i in range(values.shape[0]):
        value = values[i]
        out[i] = 0.0 if math.isnan(value) else min(max(value, -1.0), 1.0)
