"""Sources of images: a rendered room with a simulated person, a recorded sequence, or a camera in the hand."""

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from activeslam_gym.camera import camera_of
from activeslam_gym.config import SCENARIOS, Scenario
from activeslam_gym.live.advice import PERIOD
from activeslam_gym.live.person import FOLLOW, Person
from activeslam_gym.motion import CAMERA_SIZE, motion_of
from activeslam_gym.slam.belief import SPARE_FEATURES
from activeslam_gym.slam.filter import Filter
from activeslam_gym.vision.calibration import Calibration
from activeslam_gym.vision.frontend import FrontEnd
from activeslam_gym.vision.other_lenses import lens_from
from activeslam_gym.vision.room.camera import RoomCamera, introduce_target
from activeslam_gym.vision.settings import FEATURES, SIGHTED
from activeslam_gym.vision.sources import CAMERA, Frame, images_of
from activeslam_gym.vision.target import read_target
from activeslam_gym.vision.track import HAND_HELD, start

ROOM = replace(
    SCENARIOS["hand-held"],
    name="live",
    landmark_count=36,  # with the spare places, a map of 49: "fewer than 50"
    fiducial_count=4,  # the corners of the target
    pixel_std=SCENARIOS["pixels"].pixel_std,
    scripted_gaze_amplitude=0.0,  # the filter does not know the person's gaze
)
"""The rendered room and what the filter assumes of a hand: 15 images a second, 4 m/s^2 and 6 rad/s^2, u unknown."""
HELD = replace(SIGHTED, trials=30, most_change=0.4)
"""The front end of the rendered room. A hand comes back to features that it left. So an occluded feature is kept for
two seconds, where `SIGHTED` at 15 images a second keeps it for half of one; and no feature is searched from another
side, where it would be missed and deleted. When the map is full, the features not seen for longest are deleted until as
many are in view as are wanted."""
_DESK = (3.0, 2.0, 3.0)
"""Size of the box of expected landmarks about the target of a real sequence [m]."""


class GuidanceError(ValueError):
    """A sentence for the person who holds the camera; the run goes on."""


def posed(calibration: Calibration, rate: float) -> tuple[dict[str, Any], Scenario]:
    """The fields by which the scenario before a target differs from that of `track`, and that scenario.

    Raises:
        ValueError: the ``rate`` [Hz] is not positive and finite.
    """
    if not 0.0 < rate < math.inf:
        raise ValueError(f"rate must be a positive number of images a second, got {rate!r}")
    slow = {"controller_frequency": min(5.8, 0.5 * rate), "rate_loop_time": max(0.1, 1.0 / rate)}
    size = {"landmark_count": FEATURES - SPARE_FEATURES, "room_size": _DESK}
    fields: dict[str, Any] = {**size, **slow}  # the slow ones are unused, but checked
    return fields, calibration.scenario(frame_time=1.0 / rate, **HAND_HELD, **fields)


class RenderedRoom:
    """The room of ``seed``, and a simulated `Person` with a ``habit``."""

    scenario, is_camera = ROOM, False

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


class RecordedImages:
    """A recorded sequence at its own ``rate``, or a live camera, as `images_of` reads it, before a known target."""

    person = None

    def __init__(
        self, images: str, calibration: str | Path, target: str | Path, rate: float, camera: str | None = None
    ) -> None:
        self.name, self.is_camera = images, images.startswith(CAMERA)
        """A live camera's images come at their own times, and at first may not show the target."""
        self._calibration, self._straighten = lens_from(calibration, camera)
        self._target, self._rate = read_target(target), rate
        self._images = self._opened()
        self._fields, self.scenario = posed(self._calibration, rate)

    def restart(self) -> None:
        """Start again. Raises ValueError: there is no image."""
        if not self.is_camera:
            self._images = self._opened()

    def _opened(self) -> Iterator[Frame]:
        return images_of(self.name, self._rate, size=self._calibration[:2]).frames

    def next(self) -> Frame | None:
        """The next image, or None. Raises ValueError: it cannot be read."""
        frame = next(self._images, None)
        if frame is not None:
            frame = self._straighten(frame)
            self._calibration.check_image(frame[1])
        return frame

    def start(self, image: np.ndarray) -> FrontEnd:
        """A front end that has seen the first ``image``. Raises ValueError: it does not show the target."""
        return start(image, self._calibration, self._target, self._rate, scenario_fields=self._fields)
