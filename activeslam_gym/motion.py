"""The constant-velocity motion model of the paper's appendix, and the controller that drives the camera.

The camera's mean is a vector of 13: position, quaternion (scalar first), velocity, angular velocity (world frame). Its
covariance lives in the 12-D tangent: position, rotation dtheta (world frame), velocity, angular velocity.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from activeslam_gym.compilation import part
from activeslam_gym.config import Scenario
from activeslam_gym.geometry import rotate_left, rotation_matrix, so3_exp, so3_left_jacobian
from activeslam_gym.linalg import congruence, copy_into, product

CAMERA_SIZE = 13
CAMERA_DIM = 12
POSITION, QUATERNION, VELOCITY, ANGULAR_VELOCITY = slice(0, 3), slice(3, 7), slice(7, 10), slice(10, 13)
"""Blocks of the mean."""
D_POSITION, D_ROTATION, D_VELOCITY, D_ANGULAR = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12)
"""Blocks of the tangent."""


class Motion(IntEnum):
    """The seven translations, along the camera's axes."""

    FORWARD = 0
    BACKWARDS = 1
    RIGHT = 2
    LEFT = 3
    UP = 4
    DOWN = 5
    STAY = 6


class Gaze(IntEnum):
    """The three turns, about the world's vertical."""

    RIGHT = 0
    LEFT = 1
    STAY = 2


MOTION_COUNT = len(Motion)
GAZE_COUNT = len(Gaze)


class MotionModel(NamedTuple):
    """Constants of the motion model and the controller (SI units)."""

    dt: float
    acceleration_std: float
    angular_acceleration_std: float
    filter_acceleration_std: float
    filter_angular_acceleration_std: float
    command_known: bool
    step_length: float
    turn_rate: float
    frequency: float
    rate_loop_time: float
    period: float
    half_x: float
    half_y: float
    half_z: float
    goal_margin: float
    wall_margin: float
    script_amplitude: float
    script_period: float


def motion_of(scenario: Scenario, motion_period: float) -> MotionModel:
    """The motion constants of a scenario whose commanded translations take ``motion_period`` seconds."""
    linear, angular = scenario.filter_acceleration_stds
    x, y, z = scenario.room_size
    return MotionModel(
        float(scenario.frame_time),
        float(scenario.acceleration_std),
        float(scenario.angular_acceleration_std),
        float(linear),
        float(angular),
        bool(scenario.command_known),
        float(scenario.step_length),
        float(scenario.turn_rate),
        float(scenario.controller_frequency),
        float(scenario.rate_loop_time),
        float(motion_period),
        0.5 * x,
        0.5 * y,
        0.5 * z,
        float(scenario.goal_margin),
        float(scenario.wall_margin),
        float(scenario.scripted_gaze_amplitude),
        float(scenario.scripted_gaze_period),
    )


# The model ----------------------------------------------------------------------------------------------------------


@part
def transition(x: np.ndarray, u: np.ndarray, dt: float) -> np.ndarray:
    """The camera's next mean (13,) under the accelerations ``u`` = [a, alpha] (6,) held for ``dt`` (appendix).

    v+ = v + a dt, p+ = p + v+ dt, w+ = w + alpha dt, q+ = Exp(w+ dt) q: the paper's matrix Q with its factor
    corrected to 1/|w|, and the angular velocity in the world frame.
    """
    p, q, v, w = x[POSITION], x[QUATERNION], x[VELOCITY], x[ANGULAR_VELOCITY]
    out = np.empty(CAMERA_SIZE)
    turned = np.empty(3)
    for i in range(3):
        out[7 + i] = v[i] + dt * u[i]
        out[i] = p[i] + dt * out[7 + i]
        out[10 + i] = w[i] + dt * u[3 + i]
        turned[i] = dt * out[10 + i]
    copy_into(out[QUATERNION], rotate_left(turned, q))
    return out


@part
def transition_jacobian(angular_velocity: np.ndarray, dt: float) -> np.ndarray:
    """F_x (12, 12) of `transition` in the tangent, at the *new* angular velocity (3,) [rad/s].

    dtheta+ = Exp(w+ dt) dtheta + J_l(w+ dt) dt dw+, which follows from Exp((w + dw) dt) = Exp(J_l dw dt) Exp(w dt).
    """
    phi = np.array((dt * angular_velocity[0], dt * angular_velocity[1], dt * angular_velocity[2]))
    turn, spread = so3_exp(phi), so3_left_jacobian(phi)
    F_x = np.zeros((CAMERA_DIM, CAMERA_DIM))
    for i in range(CAMERA_DIM):
        F_x[i, i] = 1.0
    for i in range(3):
        F_x[i, 6 + i] = dt
        for j in range(3):
            F_x[3 + i, 3 + j] = turn[i, j]
            F_x[3 + i, 9 + j] = dt * spread[i, j]
    return F_x


@part
def process_covariance(motion: MotionModel, F_x: np.ndarray) -> np.ndarray:
    """Q (12, 12) of one frame: the noise enters v and w first and reaches p and theta as they do, Q = F_x Q_u F_x^T."""
    dt = motion.dt
    Q_u = np.zeros((CAMERA_DIM, CAMERA_DIM))
    for i in range(3):
        Q_u[6 + i, 6 + i] = (dt * motion.filter_acceleration_std) ** 2
        Q_u[9 + i, 9 + i] = (dt * motion.filter_angular_acceleration_std) ** 2
    return congruence(F_x, Q_u)


@part
def open_loop(motion: MotionModel, turn: float, frames: int) -> tuple[np.ndarray, np.ndarray]:
    """(F, Q), each (12, 12), of ``frames`` frames of turning about the vertical at ``turn`` [rad/s] unobserved."""
    F_x = transition_jacobian(np.array((0.0, turn, 0.0)), motion.dt)
    Q_1 = process_covariance(motion, F_x)
    F, Q = F_x.copy(), Q_1.copy()
    for _ in range(frames - 1):
        F = product(F_x, F)
        Q = congruence(F_x, Q)
        Q += Q_1
    return F, Q


# The controller -----------------------------------------------------------------------------------------------------


@part
def displacement(motion: MotionModel, index: int) -> np.ndarray:
    """The commanded translation (3,) [m] in camera axes of the motion with that index (FORWARD … STAY)."""
    out = np.zeros(3)
    if index < MOTION_COUNT - 1:  # z forward; x is to the left, so RIGHT is -x; y up
        axis = (2, 2, 0, 0, 1, 1)[index]
        out[axis] = motion.step_length * (1.0, -1.0, -1.0, 1.0, 1.0, -1.0)[index]
    return out


@part
def clipped_goal(motion: MotionModel, goal: np.ndarray) -> np.ndarray:
    """``goal`` (3,) moved to the nearest place that is ``goal_margin`` inside the room."""
    half = (motion.half_x, motion.half_y, motion.half_z)
    out = np.empty(3)
    for i in range(3):
        reach = half[i] - motion.goal_margin
        out[i] = min(max(goal[i], -reach), reach)
    return out


@part
def goal_of(motion: MotionModel, camera: np.ndarray, index: int) -> np.ndarray:
    """The clipped goal (3,) of a motion that begins at the camera's estimate ``camera`` (>= 7)."""
    R_WC, d = rotation_matrix(camera[QUATERNION]), displacement(motion, index)
    goal = np.empty(3)
    for i in range(3):
        goal[i] = camera[i] + R_WC[i, 0] * d[0] + R_WC[i, 1] * d[1] + R_WC[i, 2] * d[2]
    return clipped_goal(motion, goal)


@part
def turn_of(motion: MotionModel, gaze: int, time: float) -> float:
    """Reference of the turn rate about the vertical [rad/s]: RIGHT is negative, LEFT positive (Y is up)."""
    if motion.script_amplitude > 0.0:
        pulse = 2.0 * math.pi / motion.script_period
        return motion.script_amplitude * pulse * math.cos(pulse * time)
    return (-motion.turn_rate, motion.turn_rate, 0.0)[gaze]


@part
def accelerations(
    motion: MotionModel, x: np.ndarray, start: np.ndarray, goal: np.ndarray, elapsed: float, turn: float
) -> np.ndarray:
    """The commanded accelerations u (6,) [m/s^2, rad/s^2] at the estimated camera ``x`` (13,).

    Position: PD with feed-forward along a minimum-jerk reference from ``start`` to ``goal`` (3,), ``elapsed`` seconds
    after it began, critically damped. Rotation: a rate loop on all axes, alpha = (w_ref - w) / rate_loop_time.
    """
    s = min(elapsed / motion.period, 1.0)
    place = s * s * s * (10.0 - 15.0 * s + 6.0 * s * s)
    speed = 30.0 * s * s * (1.0 - s) * (1.0 - s) / motion.period
    push = 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / (motion.period * motion.period)
    w_n = motion.frequency
    u = np.empty(6)
    for i in range(3):
        step = goal[i] - start[i]
        u[i] = w_n * w_n * (start[i] + place * step - x[i]) + 2.0 * w_n * (speed * step - x[7 + i]) + push * step
        w_ref = turn if i == 1 else 0.0
        u[3 + i] = (w_ref - x[10 + i]) / motion.rate_loop_time
    return u
