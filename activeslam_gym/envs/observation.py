"""The observation: a flat vector of what the belief holds, global features first, then one token per landmark.

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
from activeslam_gym.envs.run import Run, known_boxes
from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.information.entropy import WAITING, waiting_count
from activeslam_gym.kernels import borrowing, compiled, inlined
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

GLOBAL_FEATURES = {"position": 3, "forward": 3, "up": 3, "velocity": 3, "angular_velocity": 3, "time": 1, "phase": 1}
GLOBAL_FEATURES |= {"motion": MOTION_COUNT, "uncertainty": 4, "mapped": 1, "counting": 1, "features": 1, "gain": 1}
"""Name and length of each global feature, in order; `ActiveSLAMEnv` says what each is, and its scale."""

SENSED_FEATURES = {"clearance": MOTION_COUNT}
"""The same of the features that follow where there are boxes or another scene: how far each motion can go."""
FARTHEST_CLEARANCE = 3.0  # as far as the range finders reach [m]

TOKEN_FEATURES = {"direction": 3, "log_distance": 1, "log_uncertainty": 1, "log_depth_uncertainty": 1, "in_view": 1}
TOKEN_FEATURES |= {"fiducial": 1, "expected": 1, "initialising": 1, "mapped": 1}
"""Name and length of each feature of a token, in order; `ActiveSLAMEnv` says what each is, and its scale."""

CONTEXT_FEATURES = {"half_room": 3, "duration": 1, "time_left": 1, "noise": 1, "acceleration": 1}
CONTEXT_FEATURES |= {"angular_acceleration": 1, "landmarks": 1, "inverse_depth": 1, "field_of_view": 1}
CONTEXT_FEATURES |= {"reach": 1, "command_known": 1}
"""The same of the context, which an agent of several scenarios is given beside the observation; see `context_of`."""
CONTEXT_SIZE = sum(CONTEXT_FEATURES.values())
_FARTHEST = 10.0  # the range of a sensor without a limit is observed as this [m]


def _starts(lengths: dict[str, int]) -> Any:
    """Where each of the named parts begins: a named tuple."""
    return namedtuple("Starts", lengths)(*[0, *np.cumsum(list(lengths.values())).tolist()][:-1])  # type: ignore[misc]


_GLOBAL, _TOKEN = _starts(GLOBAL_FEATURES), _starts(TOKEN_FEATURES)
GLOBAL_SIZE = sum(GLOBAL_FEATURES.values())
TOKEN_SIZE = sum(TOKEN_FEATURES.values())
_LOG_FLOOR = 1e-3  # deviations below this are observed as this: 1 mm, 1 mrad
_GAIN_SCALE = 10.0  # bits per dimension that are observed as 1


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
def observe(run: Run) -> None:
    """Write the observation; it reads the estimate, the task's rhythm and the range finders, where there are some."""
    flat, first_token = np.empty(run.observation.shape[0]), GLOBAL_SIZE
    _observe_globals(run, flat)
    if run.models.motion.bodies:
        for index in range(MOTION_COUNT):
            flat[first_token + index] = run.episode.clearance[index] / FARTHEST_CLEARANCE
        first_token += MOTION_COUNT
    _observe_tokens(run, flat[first_token:])
    for i in range(flat.shape[0]):
        run.observation[i] = 0.0 if math.isnan(flat[i]) else min(max(flat[i], -1.0), 1.0)


@compiled
def _observe_globals(run: Run, out: np.ndarray) -> None:
    """Write the global features into ``out`` (>= G,), unclipped."""
    estimate, episode, task, landmarks = run.estimate, run.episode, run.models.task, run.expected.shape[0]
    x, P, half = estimate.state.camera, estimate.covariance, run.models.motion.half
    p, v, w = x[POSITION], x[VELOCITY], x[ANGULAR_VELOCITY]
    R_WC = rotation_matrix(x[QUATERNION])
    for i in range(3):
        out[_GLOBAL.position + i] = p[i] / half[i]
        out[_GLOBAL.forward + i], out[_GLOBAL.up + i] = R_WC[i, 2], R_WC[i, 1]
        out[_GLOBAL.velocity + i], out[_GLOBAL.angular_velocity + i] = v[i], w[i]
    out[_GLOBAL.time] = episode.steps / task.steps
    out[_GLOBAL.phase] = (episode.steps % task.steps_per_motion) / task.steps_per_motion
    motion_shares(episode.control.command, out[_GLOBAL.motion : _GLOBAL.motion + MOTION_COUNT])
    for block in range(4):
        variance = (P[3 * block, 3 * block] + P[3 * block + 1, 3 * block + 1] + P[3 * block + 2, 3 * block + 2]) / 3.0
        out[_GLOBAL.uncertainty + block] = _log_deviation(math.sqrt(max(variance, 0.0)))
    out[_GLOBAL.mapped] = np.sum(estimate.landmark["mapped"][: estimate.state.count]) / landmarks
    out[_GLOBAL.counting] = (landmarks - waiting_count(run.expected)) / landmarks
    out[_GLOBAL.features] = estimate.state.count / estimate.landmark.shape[0]
    out[_GLOBAL.gain] = episode.entropy_reduction / (_GAIN_SCALE * (CAMERA_DIM + 3 * landmarks))


@compiled
def _observe_tokens(run: Run, out: np.ndarray) -> None:
    """Write the tokens into ``out`` (T W,), unclipped: fiducials, then slots.

    A feature has the token of its slot for life; waiting expected landmarks take the tokens of free slots, in order, as
    many as there are.
    """
    estimate, expected, fiducials = run.estimate, run.expected, run.world.fiducials
    pose = estimate.state.camera
    view = view_of(run.models.lens, pose, known_boxes(run))
    K, F = fiducials.shape[0], estimate.landmark.shape[0]
    taken, z = np.zeros(F, np.bool_), np.empty(2)
    out[:] = 0.0
    for i in range(K):
        token = _token(out, i)
        _place(view, fiducials[i], z, token)
        token[_TOKEN.log_uncertainty], token[_TOKEN.log_depth_uncertainty], token[_TOKEN.fiducial] = -1.0, -1.0, 1.0
    for k in range(estimate.state.count):
        landmark, slot, at = estimate.landmark[k], run.owner[k].slot, CAMERA_DIM + 3 * k
        token = _token(out, K + slot)
        taken[slot] = True
        _place(view, landmark.point, z, token)
        _uncertainty(pose, landmark.point, estimate.covariance[at : at + 3, at : at + 3], token)
        token[_TOKEN.mapped if landmark.mapped else _TOKEN.initialising] = 1.0
    slot, prior = 0, diagonal(run.models.landmark_var)
    for e in range(expected.shape[0]):
        if expected[e].feature == WAITING:
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


# Beside the observation ----------------------------------------------------------------------------------------------


def context_of(runs: Run, duration: float) -> np.ndarray:
    """The context of each run, (B, `CONTEXT_SIZE`) float32 within [-1, 1]: the scales of the observation.

    Positions are scaled by the room, times by the duration, so that one policy for several scenarios needs them. The
    filter knows them all; none is the truth of an episode.

    In order: half the room's size [10 m], the decimal logarithm of the duration and of the time left [0.5 log10 s],
    of the measurement noise [log10 px], the process noise of translation [m/s²] and rotation [rad/s²] that the filter
    assumes (its logarithm, by half), expected landmarks [200], the prior of inverse depth [1/m], the tangent of half
    the angle of view [2], how far the sensor reaches [10 m], and whether the filter knows the commands.

    Of a batch of runs; ``duration``: time of an episode [s].
    """
    models, steps = runs.models, runs.episode["steps"]
    total = models["task"]["steps"]
    share = np.divide(steps, total, out=np.full(len(steps), np.nan), where=total > 0)  # NaN before the first reset
    motion, lens = models["motion"], models["lens"]
    out = np.empty((len(steps), CONTEXT_SIZE), np.float32)
    out[:, :3] = motion["half"] / 10.0
    columns = (
        np.log10(duration) / 2.0,
        np.log10(1.0 + duration * (1.0 - share)) / 2.0,
        np.log10(lens["pixel_std"]),
        np.log10(np.maximum(motion["filter_acceleration_std"], 1e-9)) / 2.0,
        np.log10(np.maximum(motion["filter_angular_acceleration_std"], 1e-9)) / 2.0,
        runs.expected.shape[1] / 200.0,
        models["filter"]["initialisation"]["rho_mean"],
        lens["u0"] / lens["focal"] / 2.0,
        np.minimum(lens["maximum_distance"], _FARTHEST) / 10.0,
        np.where(motion["command_known"], 1.0, 0.0),
    )
    for index, column in enumerate(columns, start=3):
        out[:, index] = column
    return np.clip(out, -1.0, 1.0)
