"""The course of the live system: image by image, from a source to a state estimate, advice and a recording.

A recording is written image by image, so that no way of ending loses images. Its folder holds ``images/`` (PNG, by
number), ``times.txt`` (a list of them with their times, as a source) and ``states.jsonl`` (a state a line). Beside them
stand ``frames.csv`` and ``trajectory.tum``, which grow as those of `track` do, and ``map.csv``, which is written at the
end and on demand.
"""

import json
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from activeslam_gym.files import Lines, demand_writable
from activeslam_gym.live.advice import Adviser
from activeslam_gym.live.device import Device
from activeslam_gym.live.source import FOLLOW, GuidanceError, RecordedImages, RenderedRoom
from activeslam_gym.live.state import Standing, State, plain
from activeslam_gym.motion import CAMERA_SIZE, MOTION_COUNT, Motion
from activeslam_gym.vision.film import film_to, moment_of
from activeslam_gym.vision.frontend import FrameLog, FrontEnd
from activeslam_gym.vision.opencv import opencv
from activeslam_gym.vision.report import Agreement, TrackFiles
from activeslam_gym.vision.search import NOTHING

Source = RenderedRoom | RecordedImages | Device
_FEW = 4
"""Fewer matches hardly constrain the pose."""
_VAGUE = 0.5
"""The camera is lost when the deviation of its position along any axis is greater [m]."""
_PATIENCE = 1.0
"""Time with few matches after which the camera is lost [s]."""

WORDS = {
    Standing.WAITING: "Waiting for the target: {why}.",
    Standing.TRACKING: "Tracking: {matched} of {searched} searched features found.",
    Standing.UNSURE: "Unsure: only {matched} of {searched} searched features found. Move slowly.",
    Standing.LOST: "Lost: nothing that is known is in view. Go back to where you were, or restart.",
    Standing.OVER: "No image is left. Restart to see it again.",
}
"""Sentences for people."""
_CONTRADICTED = (
    "Unsure: the map contradicts the images. Something moved before the camera, or the hand was too quick. Restart."
)
_REPEATED = "Unsure: the camera repeats its last image."
_BEGUN = "The target is there; the map begins."
_NOTHING: dict[str, Any] = {
    "searched": NOTHING,
    "camera": np.eye(1, CAMERA_SIZE, 3)[0],
    "camera_covariance": np.zeros((3, 3)),
    "ids": np.zeros(0, int),
    "points": np.zeros((0, 3)),
    "covariances": np.zeros((0, 3, 3)),
    "mapped": np.zeros(0, bool),
    "fiducials": np.zeros((0, 3)),
}
"""The estimate before the target was seen."""


class Session:
    """A run: `step` processes an image, `restart` starts again.

    With a ``folder`` it is recorded there, with ``film`` as a film too; each restart has a folder of its own: 2, 3, ...

    Args:
        source: Of the images.
        seed: Of the expected landmarks.
        folder: Of the recording.
        film: Whether film.mp4 is made too.

    Raises:
        OSError: the folder cannot be written to, or holds a recording already.
    """

    def __init__(self, source: Source, seed: int = 0, folder: str | Path | None = None, film: bool = False) -> None:
        self.source, self._seed, self._film = source, seed, film
        self._home = self._folder = None if folder is None else Path(folder)
        self._recording: Recording | None = None  # made with the first tracked image: a failed start leaves nothing
        self._runs = 0  # that were recorded
        if self._folder is not None:
            check_folder(self._folder)
        self._reset()

    def _reset(self) -> None:
        self.front_end: FrontEnd | None = None
        self.adviser: Adviser | None = None
        self.log: FrameLog | None = None
        """Of the last image but the first."""
        self._agreement, self._repeats = Agreement(frame_time=self.source.scenario.frame_time), False
        self._frame, self._time, self._zero, self._good = 0, 0.0, 0.0, 0.0
        self._image = np.zeros((self.source.scenario.image_height, self.source.scenario.image_width), np.uint8)
        self._mapped: set[int] = set()

    def restart(self) -> State:
        """Finish the recording, and start again, with the source; the state before the first image."""
        self.close()
        self.source.restart()
        self._reset()
        if self._home is not None and self._recording is not None:
            self._recording, self._folder = None, self._home / str(self._runs + 1)
            check_folder(self._folder)
        return self._state(Standing.WAITING, time.thread_time(), GuidanceError("It starts again."))

    @property
    def recorded(self) -> bool:
        """Whether an image was recorded."""
        return self._runs > 0

    def save(self) -> str:
        """Write the map; the answer to the user."""
        if self._home is None:
            return "Your browser has the map. To keep images and trajectory too, start with --record DIR."
        if self._recording is None:
            return "Your browser has the map. Nothing is recorded yet."
        self._recording.save()
        return f"Saved in {self._recording.folder}."

    def close(self) -> None:
        """Finish the recording."""
        if self._recording is not None:
            self._recording.close()

    def step(self, rate: float = 0.0) -> State:
        """The state after the next image, at a ``rate`` of images [Hz]; the last one again, as OVER, where there is
        none. It is recorded, unless its image only waited for the target, or was refused, so that a replay starts as
        the run did.

        Raises:
            ValueError: an image cannot be read, or the first one does not show the target.
        """
        state, source = self._stepped(), self.source
        state.rate = rate
        if self._folder is not None and state.standing not in (Standing.WAITING, Standing.OVER):
            if self._recording is None:
                room = None if source.person is None else source.scenario.room_size
                self._recording = Recording(self._folder, 1.0 / source.scenario.frame_time, self._film, room)
                self._runs += 1
            assert self.front_end
            log = self.log or self.front_end.first_log(state.milliseconds)
            self._recording.add(state, log, source.original)
        return state

    def _stepped(self) -> State:
        began = time.thread_time()
        try:
            frame = self.source.next()
        except GuidanceError as guidance:
            return self._state(Standing.WAITING, began, guidance)
        if frame is None:
            return self._state(Standing.OVER, began)
        self._time, self._image = frame[0] - self._zero, frame[1]
        if self.front_end is None:
            try:
                self._begin(*frame)
            except ValueError as error:
                if not self.source.is_camera:
                    raise
                return self._state(Standing.WAITING, began, error)
        else:
            self._track(self.front_end)
        self._frame += 1
        return self._state(self._standing(), began)

    def _begin(self, at: float, image: np.ndarray) -> None:
        self.front_end = self.source.start(image)
        self._zero, self._time = at, 0.0
        seed, walls = np.random.SeedSequence((self._seed, 1)), self.source.person is not None
        self.adviser = Adviser(self.source.scenario, self.front_end, seed, walls)

    def _track(self, front_end: FrontEnd) -> None:
        assert self.adviser
        repeated = front_end.repeated
        log = front_end.step(self._image, self._time)
        self._repeats = front_end.repeated > repeated
        a_room = self.source.person is not None  # its front end keeps the features that it misses
        self.log = log if a_room else self._agreement.judged(log, front_end.strayed)
        if self.log.matched >= _FEW and not self.log.lost:
            self._good = self._time
        if self.adviser.consider(self._time) and self.source.person is not None:
            self.source.person.hear(self.adviser.command)

    def _standing(self) -> Standing:
        assert self.front_end
        log, variances = self.log, np.diag(self.front_end.filter.camera_covariance)[:3]
        if self._repeats:
            return Standing.UNSURE
        if self._time - self._good > _PATIENCE or variances.max() > _VAGUE**2:
            return Standing.LOST
        well = log is None or (not log.lost and log.matched >= max(_FEW, log.searched / 2))
        return Standing.TRACKING if well and self._agreement.holds else Standing.UNSURE

    def _state(self, standing: Standing, began: float, why: ValueError | None = None) -> State:
        log, person, adviser, front_end = self.log, self.source.person, self.adviser, self.front_end
        moment = vars(moment_of(front_end, self._image)) if front_end else {"image": self._image, **_NOTHING}
        begun = standing == Standing.TRACKING and log is None
        words = _BEGUN if begun else "{why}" if isinstance(why, GuidanceError) else WORDS[standing]
        if standing == Standing.UNSURE and (self._repeats or not self._agreement.holds):
            words = _REPEATED if self._repeats else _CONTRADICTED
        matched, searched = (log.matched, log.searched) if log else (0, 0)
        self._mapped.update(moment["ids"][moment["mapped"]].tolist())
        return State(
            **moment,
            frame=self._frame,
            time=self._time,
            standing=standing,
            words=words.format(matched=matched, searched=searched, why=why),
            command=adviser.command if adviser else Motion.STAY,
            scores=adviser.scores if adviser else np.full(MOTION_COUNT, np.nan),
            advised=adviser.advised.copy() if adviser else np.zeros(MOTION_COUNT, int),
            log2_dets=adviser.expected.log2_dets() if adviser else np.full(3, np.nan),
            landmarks=len(self._mapped),
            follows=None if person is None else person.habit == FOLLOW,
            truth=None if person is None else person.state.copy(),
            milliseconds=1e3 * (time.thread_time() - began),
        )


STATES, TIMES = "states.jsonl", "times.txt"
_FILES = (STATES, TIMES, "images", "trajectory.tum", "frames.csv", "map.csv", "film.mp4")
_FAST = 1
"""PNG's compression, of 0 … 9."""
PAUSE = 1.0
"""Longest time for which a film or a replay shows an image [s]."""


def check_folder(folder: Path) -> None:
    """Check that a recording can start in ``folder``, which need not exist.

    Raises:
        OSError: it holds a recording or results of `track` already, or cannot be written to.
    """
    demand_writable(folder)
    if there := [name for name in _FILES if (folder / name).exists()]:
        what = "a live recording" if STATES in there else there[0]
        raise OSError(f"{folder} holds {what} already; choose another folder")


class Recording:
    """Writes a run into ``folder``, which it makes, and with ``film`` film.mp4 of ``rate`` [Hz], which shows the images
    at their times and is there once it is closed; the ``room`` gives the scale of its map.

    Raises:
        OSError: it cannot be written to, or holds a recording already.
        ModuleNotFoundError: OpenCV is not installed.
    """

    def __init__(
        self, folder: Path, rate: float, film: bool = False, room: tuple[float, float, float] | None = None
    ) -> None:
        self.folder = folder
        self._cv2 = opencv()
        check_folder(self.folder)
        (self.folder / "images").mkdir(parents=True, exist_ok=True)
        self._states, self._times = Lines(self.folder / STATES), Lines(self.folder / TIMES)
        self._track = TrackFiles(self.folder, metric=True)
        self._last: State | None = None
        self._count, self._at_close = 0, ExitStack()
        self._film = self._at_close.enter_context(film_to(self.folder / "film.mp4", rate, room)) if film else None
        self._film_time, self._longest = 0.0, max(PAUSE, 1.0 / rate)

    def add(self, state: State, log: FrameLog, original: np.ndarray | None = None) -> None:
        """Write a state, its image, or the ``original`` (h, w) that was mapped to it, and the ``log``.

        Raises:
            OSError: the disk is full, or gone.
        """
        name = f"images/{self._count:06d}.png"
        path = self.folder / name
        image = state.image if original is None else original
        if not self._cv2.imwrite(str(path), image, [self._cv2.IMWRITE_PNG_COMPRESSION, _FAST]):
            raise OSError(f"{path} cannot be written")
        self._times.write(f"{float(state.time)!r} {name}\n")
        self._states.write(json.dumps(plain(state)) + "\n")
        self._track.add(state.time, state.camera, log)
        if self._film is not None:
            self._film_time += min(state.time - self._last.time, self._longest) if self._last else 0.0
            self._film(state, self._film_time)
        self._last = state
        self._count += 1

    def save(self) -> None:
        """Write the present map."""
        if self._last is not None:
            self._track.save(self._last.ids, self._last.points, self._last.stds)

    def close(self) -> None:
        """Write the map and finish."""
        self.save()
        self._states.close()
        self._times.close()
        self._track.close()
        self._at_close.close()
