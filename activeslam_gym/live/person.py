"""A simulated person with a camera in the hand, who hears the advice and looks about as people do."""

import math

import numpy as np

from activeslam_gym.geometry import quaternion_exp, rotation_error
from activeslam_gym.kernels import Record
from activeslam_gym.motion import (
    ANGULAR_VELOCITY,
    MOTION_COUNT,
    POSITION,
    QUATERNION,
    VELOCITY,
    Motion,
    goal_of,
    minimum_jerk,
    transition,
)

FOLLOW, NEVER, STILL = "always", "never", "still"
"""Habits: to follow the advice; to move at random; to stay, and only look about."""
HABITS = (FOLLOW, NEVER, STILL)
_REACTION = 0.2
"""Time from hearing a command to moving [s]."""
_STIFFNESS = 6.0
"""Natural frequency of a hand's control [rad/s]; critically damped."""
_LOOK, _LOOK_PERIOD = math.radians(30.0), 20.0
"""Amplitude [rad] and period [s] of the gaze to either side."""
_SETTLING = 3.0
"""Time in which a person turns from looking at the target to looking about [s]."""
_DISTANCE = 0.4
"""Least distance of a person from boxes [m]."""


class Person:
    """Moves the true camera.

    The hand follows a smooth path of a second to its goal, and holds the camera level, with a tremor:
    accelerations of ``acceleration_std`` and ``angular_acceleration_std``, drawn in each frame. The goal of a command
    is in axes of the true camera, clipped into the room and kept away from ``boxes`` (B, 2, 3) [m].
    """

    def __init__(self, motion: Record, start: np.ndarray, boxes: np.ndarray, habit: str, rng: np.random.Generator):
        self.state = np.array(start, float)
        """(13,) the true camera."""
        self.habit = habit
        self._motion, self._boxes, self._rng = motion, boxes, rng
        self._from = self._to = self.state[POSITION].copy()
        self._time, self._begun = 0.0, -math.inf
        self._heard: list[tuple[float, Motion]] = []

    def hear(self, command: Motion) -> None:
        """A new command."""
        random = Motion(int(self._rng.integers(MOTION_COUNT)))  # always drawn: the tremor does not depend on the habit
        chosen = {FOLLOW: command, NEVER: random, STILL: Motion.STAY}[self.habit]
        self._heard.append((self._time + _REACTION, chosen))

    def move(self) -> np.ndarray:
        """One frame: the true camera (13,) after it."""
        motion, dt = self._motion, float(self._motion.dt)
        if self._heard and self._time >= self._heard[0][0] - 1e-9:
            self._set_out(self._heard.pop(0)[1])
        noise = self._rng.standard_normal((2, 3))
        a = self._pull(self.state, dt) + motion.acceleration_std * noise[0]
        alpha = self._turn(self.state) + motion.angular_acceleration_std * noise[1]
        self.state = transition(self.state, np.concatenate((a, alpha)), dt)
        self._time += dt
        return self.state

    def _set_out(self, command: Motion) -> None:
        """Begin the path to the goal of ``command``, or as far towards it as is free, in quarters."""
        self._begun, self._from = self._time, self._to
        way = goal_of(self._motion, np.concatenate((self._to, self.state[3:])), int(command)) - self._to
        places = (self._to + share * way for share in (1.0, 0.75, 0.5, 0.25))
        self._to = next((place for place in places if self._is_free(place)), self._to)

    def _is_free(self, place: np.ndarray) -> bool:
        gaps = np.maximum(np.maximum(self._boxes[:, 0] - place, place - self._boxes[:, 1]), 0.0)
        return bool((np.linalg.norm(gaps, axis=1) > _DISTANCE).all())

    def _pull(self, x: np.ndarray, dt: float) -> np.ndarray:
        """Acceleration (3,) along a minimum-jerk path of a second."""
        elapsed, period = self._time - self._begun, float(self._motion.period)
        share, before, after = (minimum_jerk((elapsed + shift) / period) for shift in (0.0, -dt, dt))
        way = self._to - self._from
        place, speed = self._from + share * way, (share - before) / dt * way
        push = (after - 2.0 * share + before) / dt**2 * way
        return _STIFFNESS**2 * (place - x[POSITION]) + 2.0 * _STIFFNESS * (speed - x[VELOCITY]) + push

    def _turn(self, x: np.ndarray) -> np.ndarray:
        """Angular acceleration (3,) towards a level camera with the person's gaze."""
        pulse, ease = 2.0 * math.pi / _LOOK_PERIOD, minimum_jerk(self._time / _SETTLING)
        yaw = ease * _LOOK * math.sin(pulse * self._time)
        rate = np.array((0.0, ease * _LOOK * pulse * math.cos(pulse * self._time), 0.0))
        error = rotation_error(quaternion_exp(np.array((0.0, yaw, 0.0))), x[QUATERNION])
        return _STIFFNESS**2 * error + 2.0 * _STIFFNESS * (rate - x[ANGULAR_VELOCITY])
