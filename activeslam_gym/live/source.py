"""Sources of images: a rendered room with a simulated person, a recorded sequence, or a camera in the hand."""

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter

from activeslam_gym.camera import camera_of, free_way
from activeslam_gym.config import SCENARIOS
from activeslam_gym.geometry import quaternion_exp, rotation_error
from activeslam_gym.kernels import Record
from activeslam_gym.live.advice import PERIOD, Adviser
from activeslam_gym.motion import (
    ANGULAR_VELOCITY,
    CAMERA_SIZE,
    MOTION_COUNT,
    POSITION,
    QUATERNION,
    Motion,
    accelerations,
    goal_of,
    minimum_jerk,
    motion_of,
    transition,
)
from activeslam_gym.slam.filter import Filter
from activeslam_gym.vision.calibration import Calibration
from activeslam_gym.vision.frontend import FrontEnd
from activeslam_gym.vision.other_lenses import Straighten, lens_from
from activeslam_gym.vision.room.camera import RoomCamera, introduce_target
from activeslam_gym.vision.settings import SIGHTED
from activeslam_gym.vision.sources import CAMERA, Frame, images_of
from activeslam_gym.vision.target import Target, read_target
from activeslam_gym.vision.track import scenario_of, start

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
        u = accelerations(motion, self.state, self._from, self._to, self._time - self._begun, 0.0)
        u[3:] = self._turn(self.state)
        tremor = np.repeat((motion.acceleration_std, motion.angular_acceleration_std), 3)
        self.state = transition(self.state, u + tremor * self._rng.standard_normal(6), dt)
        self._time += dt
        return self.state

    def _set_out(self, command: Motion) -> None:
        """Begin the path to the goal of ``command``, or as far towards it as is free."""
        self._begun, self._from = self._time, self._to
        way = goal_of(self._motion, np.concatenate((self._to, self.state[3:])), int(command)) - self._to
        self._to = self._to + free_way(self._boxes, _DISTANCE, self._to, way) * way

    def _turn(self, x: np.ndarray) -> np.ndarray:
        """Angular acceleration (3,) towards a level camera with the person's gaze."""
        pulse, ease = 2.0 * math.pi / _LOOK_PERIOD, minimum_jerk(self._time / _SETTLING)
        yaw = ease * _LOOK * math.sin(pulse * self._time)
        rate = np.array((0.0, ease * _LOOK * pulse * math.cos(pulse * self._time), 0.0))
        error = rotation_error(quaternion_exp(np.array((0.0, yaw, 0.0))), x[QUATERNION])
        return _STIFFNESS**2 * error + 2.0 * _STIFFNESS * (rate - x[ANGULAR_VELOCITY])


ROOM = replace(
    SCENARIOS["hand-held"],
    name="live",
    landmark_count=36,  # with the spare places, a map of 49: "fewer than 50"
    fiducial_count=4,  # the corners of the target
    pixel_std=SCENARIOS["pixels"].pixel_std,
    scripted_gaze_amplitude=0.0,  # the filter does not know the person's gaze
    controller_frequency=_STIFFNESS,
)
"""The rendered room and what the filter assumes of a hand: 15 images a second, 4 m/s^2 and 6 rad/s^2, u unknown."""
HELD = replace(SIGHTED, trials=30, most_change=0.4)
"""The front end of the rendered room. A hand comes back to features that it left. So an occluded feature is kept for
two seconds, where `SIGHTED` at 15 images a second keeps it for half of one; and no feature is searched from another
side, where it would be missed and deleted. When the map is full, features not seen for long make room."""
_DESK = (3.0, 2.0, 3.0)
"""Size of the box of expected landmarks about the target of a real sequence [m]."""


class GuidanceError(ValueError):
    """A sentence for the person who holds the camera; the run goes on."""


class RenderedRoom:
    """The room of ``seed``, and a simulated `Person` with a ``habit``."""

    scenario, is_camera, original = ROOM, False, None

    def __init__(self, seed: int, habit: str = FOLLOW) -> None:
        self.name, self._seed = f"rendered room {seed}", seed
        self._enter(habit)

    def _enter(self, habit: str) -> None:
        room, first, hand = np.random.SeedSequence(self._seed).spawn(3)
        self.camera = RoomCamera(ROOM, camera_of(ROOM), room)
        state = np.eye(1, CAMERA_SIZE, 3)[0]
        state[:3] = np.array(ROOM.position_std) * np.random.default_rng(first).standard_normal(3)
        boxes, rng = self.camera.scene.boxes, np.random.default_rng(hand)
        self.person, self._frame = Person(motion_of(ROOM, PERIOD), state, boxes, habit, rng), -1

    def restart(self) -> None:
        """Start again; the person keeps the habit."""
        self._enter(self.person.habit)

    def next(self) -> Frame | None:
        """The next image."""
        self._frame += 1
        state = self.person.move() if self._frame else self.person.state
        return self._frame * ROOM.frame_time, self.camera.photograph(state, self._frame)

    def start(self, image: np.ndarray) -> FrontEnd:
        """A front end at the room's target."""
        front_end = FrontEnd(Filter(ROOM, fiducials=self.camera.fiducials), HELD)
        introduce_target(front_end, self.camera.fiducials)
        return front_end


class RealCamera:
    """A camera before a known ``target``, of about ``rate`` images a second [Hz]; ``straighten`` maps its images to
    those of the ``calibration``.

    Raises:
        ValueError: the rate is not positive and finite.
    """

    person = None

    def __init__(self, calibration: Calibration, straighten: Straighten, target: Target, rate: float) -> None:
        if not 0.0 < rate < math.inf:
            raise ValueError(f"rate must be a positive number of images a second, got {rate!r}")
        self._straighten, self._target, self._rate = straighten, target, rate
        self.original: np.ndarray | None = None
        """(h, w) uint8 the last image, before it was mapped."""
        self._see_through(calibration)

    def _warm_up(self) -> None:
        """Compile what two seconds of tracking need: with a minute between the first two images the camera is lost."""
        texture = gaussian_filter(np.random.default_rng(0).normal(128.0, 400.0, self._calibration[1::-1]), 3.0)
        image = np.clip(texture, 0.0, 255.0).astype(np.uint8)
        front_end = FrontEnd(Filter(self.scenario))
        front_end.start(image, 0.0, np.zeros(0, np.int64), np.zeros((0, 2)))
        adviser = Adviser(self.scenario, front_end, np.random.SeedSequence(0), False)
        for k in range(1, round(2.0 * self._rate) + 1):
            front_end.step(np.roll(image, k, axis=1), k / self._rate)
            adviser.consider(k / self._rate)

    def _see_through(self, calibration: Calibration) -> None:
        """The lens is that of a ``calibration``."""
        self._calibration = calibration
        self.scenario = scenario_of(calibration, True, self._rate, room_size=_DESK)

    def _mapped(self, frame: Frame) -> Frame:
        """The frame as the calibration's lens sees it. Raises ValueError: it is of another size."""
        self.original, frame = frame[1], self._straighten(frame)
        self._calibration.check_image(frame[1])
        return frame

    def start(self, image: np.ndarray) -> FrontEnd:
        """A front end that has seen the first ``image``. Raises ValueError: it does not show the target."""
        return start(image, self._calibration, self._target, self.scenario)


class RecordedImages(RealCamera):
    """A recorded sequence at its own ``rate``, or a live camera, as `images_of` reads it, before a known target."""

    def __init__(
        self, images: str, calibration: str | Path, target: str | Path, rate: float, camera: str | None = None
    ) -> None:
        self.name, self.is_camera = images, images.startswith(CAMERA)
        """A live camera's images come at their own times, and at first may not show the target."""
        lens, straighten = lens_from(calibration, camera)
        super().__init__(lens, straighten, read_target(target, straighten.pixels), rate)
        self._images: Iterator[Frame] | None = self._opened()
        if self.is_camera:
            self.next()  # is it there, and of this size? What it takes from now on is too old to begin with
            self._images = None
            self._warm_up()

    def restart(self) -> None:
        """Start again. Raises ValueError: there is no image."""
        if not self.is_camera:
            self._images = self._opened()

    def _opened(self) -> Iterator[Frame]:
        return images_of(self.name, self._rate, size=self._calibration[:2]).frames

    def next(self) -> Frame | None:
        """The next image, or None. Raises ValueError: it cannot be read."""
        self._images = self._images or self._opened()
        frame = next(self._images, None)
        return None if frame is None else self._mapped(frame)
