"""The constant-velocity motion model of the paper's appendix, and the controller that drives the camera.

The camera's mean is a vector of 13: position, quaternion (scalar first), velocity, angular velocity (world frame). Its
covariance lives in the 12-D tangent: position, rotation dtheta (world frame), velocity, angular velocity.
"""

import math
from enum import IntEnum

import numpy as np

from activeslam_gym.config import Scenario
from activeslam_gym.geometry import rotate_left, rotation_matrix, so3_exp, so3_left_jacobian
from activeslam_gym.kernels import Record, compiled, constants
from activeslam_gym.linalg import add_symmetric_product, congruence, copy_block, copy_into, product

CAMERA_SIZE = 13
CAMERA_DIM = 12
POSITION, QUATERNION, VELOCITY, ANGULAR_VELOCITY = slice(0, 3), slice(3, 7), slice(7, 10), slice(10, 13)
"""Blocks of the mean."""
CAMERA_PARTS = {
    "position": POSITION,
    "quaternion": QUATERNION,
    "velocity": VELOCITY,
    "angular_velocity": ANGULAR_VELOCITY,
}
"""The same by name."""
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
GAZE_SHARE = (-1.0, 1.0, 0.0)  # share of the turn rate of each gaze, positive to the left
MOTION_AXIS, MOTION_SIGN = (2, 2, 0, 0, 1, 1), (1.0, -1.0, -1.0, 1.0, 1.0, -1.0)
"""Along which camera axis each translation goes, and whither: z forward; x is to the left, so RIGHT is -x; y up."""


COMMANDS = np.zeros((MOTION_COUNT, GAZE_COUNT, 4))
"""Of each motion and gaze the command: a displacement in steps, in camera axes, and a share of the turn rate."""
for _motion, (_axis, _sign) in enumerate(zip(MOTION_AXIS, MOTION_SIGN, strict=True)):
    COMMANDS[_motion, :, _axis] = _sign
COMMANDS[:, :, 3] = GAZE_SHARE


MOTION, _motion_of = constants(
    Scenario(),
    dt=lambda s: s.frame_time,
    acceleration_std="f8",
    angular_acceleration_std="f8",
    filter_acceleration_std=lambda s: s.filter_acceleration_std or s.acceleration_std,
    filter_angular_acceleration_std=lambda s: s.filter_angular_acceleration_std or s.angular_acceleration_std,
    command_known="b1",
    step_length="f8",
    turn_rate="f8",
    controller_frequency="f8",
    rate_loop_time="f8",
    period=1.0,
    half=lambda s: 0.5 * np.array(s.room_size),
    goal_margin="f8",
    wall_margin="f8",
    bodies=lambda s: s.has_bodies,  # whether something beside the walls may stop the camera
    scripted_gaze_amplitude="f8",
    scripted_gaze_period="f8",
)
"""Constants of the motion model and the controller (SI units); see the fields of `Scenario`. ``half`` of the room."""


def motion_of(scenario: Scenario, motion_period: float) -> Record:
    """The MOTION record of a scenario whose commanded translations take ``motion_period`` seconds."""
    motion = _motion_of(scenario)
    motion.period = motion_period
    return motion


LARGEST_ACCELERATION, LARGEST_ANGULAR_ACCELERATION = 10.0, 10.0
"""What is commanded at most [m/s^2, rad/s^2]: several times what a motion takes, and less than what an estimate that
jumps by metres would ask for."""


# The model ----------------------------------------------------------------------------------------------------------


@compiled
def transition(x: np.ndarray, u: np.ndarray, dt: float) -> np.ndarray:
    """The camera's next mean (13,) under the accelerations ``u`` = [a, alpha] (6,) held for ``dt`` (appendix).

    v+ = v + a dt, p+ = p + v+ dt, w+ = w + alpha dt, q+ = Exp(w+ dt) q: the paper's matrix Q with its factor
    corrected to 1/|w|, and the angular velocity in the world frame.
    """
    p, q, v, w = x[POSITION], x[QUATERNION], x[VELOCITY], x[ANGULAR_VELOCITY]
    out = np.empty(CAMERA_SIZE)
    p_next, v_next, w_next = out[POSITION], out[VELOCITY], out[ANGULAR_VELOCITY]
    turned = np.empty(3)
    for i in range(3):
        v_next[i] = v[i] + dt * u[i]
        p_next[i] = p[i] + dt * v_next[i]
        w_next[i] = w[i] + dt * u[3 + i]
        turned[i] = dt * w_next[i]
    copy_into(out[QUATERNION], rotate_left(turned, q))
    return out


@compiled
def transition_jacobian(angular_velocity: np.ndarray, dt: float) -> np.ndarray:
    """F_x (12, 12) of `transition` in the tangent, at the *new* angular velocity (3,) [rad/s].

    dtheta+ = Exp(w+ dt) dtheta + J_l(w+ dt) dt dw+, which follows from Exp((w + dw) dt) = Exp(J_l dw dt) Exp(w dt).
    """
    phi = np.array((dt * angular_velocity[0], dt * angular_velocity[1], dt * angular_velocity[2]))
    F_x, J_l = np.zeros((CAMERA_DIM, CAMERA_DIM)), so3_left_jacobian(phi)
    for i in range(CAMERA_DIM):
        F_x[i, i] = 1.0
    copy_block(so3_exp(phi), F_x[D_ROTATION, D_ROTATION])
    for i in range(3):
        F_x[D_POSITION.start + i, D_VELOCITY.start + i] = dt
        for j in range(3):
            F_x[D_ROTATION.start + i, D_ANGULAR.start + j] = dt * J_l[i, j]
    return F_x


@compiled
def process_covariance(motion: Record, F_x: np.ndarray, dt: float) -> np.ndarray:
    """Q (12, 12) = F_x Q_u F_x^T of ``dt`` seconds: the noise enters v and w, and reaches p and theta as they do."""
    F_u, out = F_x[:, D_VELOCITY.start :], np.zeros((CAMERA_DIM, CAMERA_DIM))
    F_Q = F_u.copy()
    for i in range(CAMERA_DIM):
        for j in range(3):
            F_Q[i, j] *= (dt * motion.filter_acceleration_std) ** 2
            F_Q[i, 3 + j] *= (dt * motion.filter_angular_acceleration_std) ** 2
    add_symmetric_product(F_Q, F_u, out)
    return out


@compiled
def open_loop(motion: Record, turn: float, frames: int) -> tuple[np.ndarray, np.ndarray]:
    """(F, Q), each (12, 12), of ``frames`` frames of turning about the vertical at ``turn`` [rad/s] unobserved."""
    F_x = transition_jacobian(np.array((0.0, turn, 0.0)), motion.dt)
    Q_1 = process_covariance(motion, F_x, motion.dt)
    F, Q = F_x.copy(), Q_1.copy()
    for _ in range(frames - 1):
        F = product(F_x, F)
        Q = congruence(F_x, Q)
        Q += Q_1
    return F, Q


# The controller -----------------------------------------------------------------------------------------------------


@compiled
def motion_shares(command: np.ndarray, out: np.ndarray) -> None:
    """Write into ``out`` (7,) what share of each motion is in ``command`` (>= 3,), of which 1 is a step [camera axes].

    Of one of the seven motions it is the one-hot vector; STAY is what is left to a full step.
    """
    length = 0.0
    for index in range(MOTION_COUNT - 1):
        out[index] = max(command[MOTION_AXIS[index]] * MOTION_SIGN[index], 0.0)
        length += out[index] * out[index]
    out[MOTION_COUNT - 1] = 1.0 - math.sqrt(length)


def nearest_motion(command: np.ndarray) -> Motion:
    """The motion that is most of a ``command`` (>= 3,)."""
    shares = np.empty(MOTION_COUNT)
    motion_shares(command, shares)
    return Motion(int(shares.argmax()))


def nearest_gaze(share: float) -> Gaze:
    """The gaze that is nearest to a ``share`` of the turn rate."""
    return Gaze(int(np.abs(np.subtract(GAZE_SHARE, share)).argmin()))


@compiled
def goal_of(motion: Record, camera: np.ndarray, index: int) -> np.ndarray:
    """The clipped goal (3,) of the motion with that ``index`` from the camera's estimate ``camera`` (>= 7)."""
    return goal_by(motion, camera, motion.step_length * COMMANDS[index, 0, :3])


@compiled
def goal_by(motion: Record, camera: np.ndarray, d: np.ndarray) -> np.ndarray:
    """The goal (3,) of the translation ``d`` (3,) [m], in camera axes, from the estimate ``camera`` (>= 7).

    It is moved to the nearest place that is ``goal_margin`` inside the room.
    """
    R_WC, reach = rotation_matrix(camera[QUATERNION]), motion.half - motion.goal_margin
    goal = np.empty(3)
    for i in range(3):
        goal[i] = camera[i] + R_WC[i, 0] * d[0] + R_WC[i, 1] * d[1] + R_WC[i, 2] * d[2]
    return np.minimum(np.maximum(goal, -reach), reach)


@compiled
def turn_of(motion: Record, gaze: int, time: float) -> float:
    """Reference of the turn rate about the vertical [rad/s]: RIGHT is negative, LEFT positive (Y is up)."""
    return turn_by(motion, GAZE_SHARE[gaze], time)


@compiled
def turn_by(motion: Record, share: float, time: float) -> float:
    """The same of a ``share`` in [-1, 1] of the turn rate, positive to the LEFT."""
    if motion.scripted_gaze_amplitude > 0.0:
        pulse = 2.0 * math.pi / motion.scripted_gaze_period
        return motion.scripted_gaze_amplitude * pulse * math.cos(pulse * time)
    return motion.turn_rate * share


@compiled
def turned_by(motion: Record, rate: float, turn: float, frames: int) -> tuple[float, float]:
    """(angle [rad], rate [rad/s]) after ``frames`` frames of the rate loop, from ``rate`` towards ``turn`` [rad/s].

    w_k = turn + (rate - turn) (1 - dt / tau)^k; the angle is dt times the sum of w_1 … w_n.
    """
    left = (rate - turn) * (1.0 - motion.dt / motion.rate_loop_time) ** frames
    late = (rate - turn - left) * (motion.rate_loop_time - motion.dt)
    return frames * motion.dt * turn + late, turn + left


@compiled
def minimum_jerk(s: float) -> float:
    """Share of the way at the share ``s`` of the time."""
    s = min(max(s, 0.0), 1.0)
    return s * s * s * (10.0 - 15.0 * s + 6.0 * s * s)


@compiled
def accelerations(
    motion: Record, x: np.ndarray, start: np.ndarray, goal: np.ndarray, elapsed: float, turn: float
) -> np.ndarray:
    """The commanded accelerations u (6,) [m/s^2, rad/s^2] at the estimated camera ``x`` (13,).

    Position: PD with feed-forward along a minimum-jerk reference from ``start`` to ``goal`` (3,), ``elapsed`` seconds
    after it began, critically damped. Its speed and acceleration are the differences of its places at the frames, which
    is how a camera moves whose accelerations are held: undisturbed, it follows to the end. Rotation: a rate loop on all
    axes, alpha = (w_ref - w) / rate_loop_time. Both are limited.
    """
    w_n, dt, T = motion.controller_frequency, motion.dt, motion.period
    place = minimum_jerk(elapsed / T)
    before, after = place - minimum_jerk((elapsed - dt) / T), minimum_jerk((elapsed + dt) / T) - place
    speed, push = before / dt, (after - before) / (dt * dt)
    p, v, w = x[POSITION], x[VELOCITY], x[ANGULAR_VELOCITY]
    u = np.empty(6)
    for i in range(3):
        step = goal[i] - start[i]
        u[i] = w_n * w_n * (start[i] + place * step - p[i]) + 2.0 * w_n * (speed * step - v[i]) + push * step
        w_ref = turn if i == 1 else 0.0
        u[3 + i] = (w_ref - w[i]) / motion.rate_loop_time
    _limit(u[:3], LARGEST_ACCELERATION)
    _limit(u[3:], LARGEST_ANGULAR_ACCELERATION)
    return u


@compiled
def _limit(u: np.ndarray, largest: float) -> None:
    """Shorten ``u`` (3,) to the length ``largest``."""
    length = math.sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
    if length > largest:
        for i in range(3):
            u[i] *= largest / length
