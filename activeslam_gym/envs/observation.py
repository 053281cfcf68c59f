"""The observation: a flat vector of what the belief holds, global features first, then one token per thing.

Directions are in camera axes (x left, y up, z forward) and every number is scaled by a constant and clipped to [-1, 1].
"""

import math
from collections import namedtuple
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium import spaces

from activeslam_gym.camera import View, camera_point, view_of, visible
from activeslam_gym.config import Scenario
from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.information.expectation import WAITING
from activeslam_gym.kernels import Record, borrowing, compiled, inlined
from activeslam_gym.linalg import diagonal, log2_det_3
from activeslam_gym.motion import (
    ANGULAR_VELOCITY,
    CAMERA_DIM,
    MOTION_COUNT,
    POSITION,
    QUATERNION,
    VELOCITY,
    motion_shares,
)
from activeslam_gym.slam.belief import feature_capacity
from activeslam_gym.slam.estimate import EstimateArrays, copy_own_covariance

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

SENSED_FEATURES = {"clearance": MOTION_COUNT}
"""The same of what follows them where there are boxes or a registered scene: how far each motion can go."""
FARTHEST_CLEARANCE = 3.0
"""As far as the range finders reach [m]."""

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


def _starts(lengths: dict[str, int]) -> Any:
    """Where each of the named parts begins: a named tuple."""
    return namedtuple("Starts", lengths)(*[0, *np.cumsum(list(lengths.values())).tolist()][:-1])  # type: ignore[misc]


_GLOBAL, _TOKEN = _starts(GLOBAL_FEATURES), _starts(TOKEN_FEATURES)
GLOBAL_SIZE = sum(GLOBAL_FEATURES.values())
TOKEN_SIZE = sum(TOKEN_FEATURES.values())
_LOG_FLOOR = 1e-3
"""Deviations below this are told as this: 1 mm, 1 mrad."""
_GAIN_SCALE = 10.0
"""Bits per dimension that are told as 1."""


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
    lengths = GLOBAL_FEATURES | (SENSED_FEATURES if scenario.has_bodies else {})
    first = sum(lengths.values())
    return ObservationLayout(
        global_slices=_slices(lengths),
        tokens=slice(first, first + count * TOKEN_SIZE),
        token_shape=(count, TOKEN_SIZE),
        token_slices=_slices(TOKEN_FEATURES),
        fiducial_count=scenario.fiducial_count,
        size=first + count * TOKEN_SIZE,
    )


def observation_space(layout: ObservationLayout) -> spaces.Box:
    """Of one environment: float32 (D,) in [-1, 1]."""
    return spaces.Box(-1.0, 1.0, (layout.size,), np.float32)


def _slices(lengths: dict[str, int]) -> dict[str, slice]:
    return {name: slice(start, start + lengths[name]) for name, start in _starts(lengths)._asdict().items()}


@compiled
def observe_globals(
    motion: Record,
    estimate: EstimateArrays,
    time: float,
    phase: float,
    command: np.ndarray,
    mapped: int,
    counting: int,
    landmarks: int,
    gain: float,
    out: np.ndarray,
) -> None:
    """Write the global features into ``out`` (G,), unclipped. ``time`` and ``phase`` in [0, 1], ``gain`` [bit].

    ``command`` (>= 3,) is the translation under way, see `motion.COMMANDS`.
    """
    x, P = estimate.state.camera, estimate.covariance
    p, v, w = x[POSITION], x[VELOCITY], x[ANGULAR_VELOCITY]
    R_WC = rotation_matrix(x[QUATERNION])
    for i in range(3):
        out[_GLOBAL.position + i] = p[i] / motion.half[i]
        out[_GLOBAL.forward + i], out[_GLOBAL.up + i] = R_WC[i, 2], R_WC[i, 1]
        out[_GLOBAL.velocity + i], out[_GLOBAL.angular_velocity + i] = v[i], w[i]
    out[_GLOBAL.time], out[_GLOBAL.phase] = time, phase
    motion_shares(command, out[_GLOBAL.motion : _GLOBAL.motion + MOTION_COUNT])
    for block in range(4):
        variance = (P[3 * block, 3 * block] + P[3 * block + 1, 3 * block + 1] + P[3 * block + 2, 3 * block + 2]) / 3.0
        out[_GLOBAL.uncertainty + block] = _log_deviation(math.sqrt(max(variance, 0.0)))
    out[_GLOBAL.mapped], out[_GLOBAL.counting] = mapped / landmarks, counting / landmarks
    out[_GLOBAL.features] = estimate.state.count / estimate.landmark.shape[0]
    out[_GLOBAL.gain] = gain / (_GAIN_SCALE * (CAMERA_DIM + 3 * landmarks))


@compiled
def observe_tokens(
    camera: Record,
    estimate: EstimateArrays,
    owner: np.ndarray,
    expected: np.ndarray,
    landmark_var: np.ndarray,
    fiducials: np.ndarray,
    boxes: np.ndarray,
    out: np.ndarray,
) -> None:
    """Write the tokens into ``out`` (T W,), unclipped: fiducials, then slots.

    A feature has the token of its slot in ``owner`` (F,) for life; waiting expected landmarks take the tokens of free
    slots, in order, as many as there are.
    """
    pose = estimate.state.camera
    view = view_of(camera, pose, boxes)
    K, F = fiducials.shape[0], estimate.landmark.shape[0]
    taken, z, P_y = np.zeros(F, np.bool_), np.empty(2), np.empty((3, 3))
    out[:] = 0.0
    for i in range(K):
        token = _token(out, i)
        _place(view, fiducials[i], z, token)
        token[_TOKEN.log_uncertainty], token[_TOKEN.log_depth_uncertainty], token[_TOKEN.fiducial] = -1.0, -1.0, 1.0
    for k in range(estimate.state.count):
        landmark, slot = estimate.landmark[k], owner[k].slot
        token = _token(out, K + slot)
        taken[slot] = True
        _place(view, landmark.point, z, token)
        copy_own_covariance(estimate, k, P_y)
        _uncertainty(pose, landmark.point, P_y, token)
        token[_TOKEN.mapped if landmark.mapped else _TOKEN.initialising] = 1.0
    slot, prior = 0, diagonal(landmark_var)
    for e in range(expected.shape[0]):
        if expected[e].serial == WAITING:
            while slot < F and taken[slot]:
                slot += 1
            if slot == F:
                return
            token = _token(out, K + slot)
            _place(view, expected[e].point, z, token)
            _uncertainty(pose, expected[e].point, prior, token)
            token[_TOKEN.expected] = 1.0
            slot += 1


@inlined
def _token(tokens: np.ndarray, i: int) -> np.ndarray:
    """(W,) number ``i`` of ``tokens`` (T W,): a view."""
    return tokens[i * TOKEN_SIZE : (i + 1) * TOKEN_SIZE]


@borrowing
def _place(view: View, y: np.ndarray, z: np.ndarray, token: np.ndarray) -> None:
    """Direction, log distance and visibility of the world point ``y`` (3,); writes its pixel into ``z`` (2,)."""
    p_C = camera_point(view.R_WC, view.pose, y)
    distance = max(math.sqrt(p_C[0] * p_C[0] + p_C[1] * p_C[1] + p_C[2] * p_C[2]), _LOG_FLOOR)
    for i in range(3):
        token[_TOKEN.direction + i] = p_C[i] / distance
    token[_TOKEN.log_distance] = math.log10(distance) / 1.5
    token[_TOKEN.in_view] = 1.0 if visible(view, y, 0.0, z) else 0.0


@borrowing
def _uncertainty(pose: np.ndarray, y: np.ndarray, P_y: np.ndarray, token: np.ndarray) -> None:
    """Log deviation of a point: geometric mean, and along the line of sight relative to the distance."""
    square, along = _LOG_FLOOR**2, 0.0
    for i in range(3):
        sight = y[i] - pose[i]
        square += sight * sight
        for j in range(3):
            along += sight * P_y[i, j] * (y[j] - pose[j])
    log2_deviation = log2_det_3(P_y) / 6.0
    token[_TOKEN.log_uncertainty] = math.log10(2.0) * log2_deviation / 3.0 if math.isfinite(log2_deviation) else 1.0
    token[_TOKEN.log_depth_uncertainty] = _log_deviation(math.sqrt(max(along, 0.0)) / square)


@compiled
def _log_deviation(deviation: float) -> float:
    return math.log10(max(deviation, _LOG_FLOOR)) / 3.0


@borrowing
def clip_into(values: np.ndarray, out: np.ndarray) -> None:
    """Write ``values`` (D,) clipped to [-1, 1] into ``out`` (D,) float32; what is not a number becomes 0."""
    for i in range(values.shape[0]):
        value = values[i]
        out[i] = 0.0 if math.isnan(value) else min(max(value, -1.0), 1.0)
