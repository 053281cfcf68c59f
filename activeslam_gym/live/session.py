"""One run of the live system: image by image, from a source to what is known and what is advised."""

import time
from typing import Any

import numpy as np

from activeslam_gym.live.advice import Adviser
from activeslam_gym.live.knowledge import Knowledge
from activeslam_gym.live.source import Source, habit_of, tell
from activeslam_gym.live.state import LOST, OVER, TRACKING, UNSURE, WAITING, State
from activeslam_gym.motion import CAMERA_DIM, CAMERA_SIZE, MOTION_COUNT, Motion
from activeslam_gym.vision.frontend import FrameLog, FrontEnd

_FEW = 4
"""Fewer matches than that tell little of the pose."""
_VAGUE = 0.5
"""A camera that is less sure of its place along any axis is lost [m]."""
_PATIENCE = 1.0
"""Time with few matches after which the camera is lost [s]."""
_MAPPED = 0.3
"""A feature is mapped when the deviation of its depth over its depth is under this, as in the scenarios."""

WORDS = {
    WAITING: "Waiting for the target: {why}.",
    TRACKING: "Tracking: {matched} of {searched} searched features found.",
    UNSURE: "Unsure: only {matched} of {searched} searched features found. Move slowly.",
    LOST: "Lost: nothing that is known is in view. Go back to where you were, or restart.",
    OVER: "No image is left. Restart to see it again.",
}
"""Sentences for people."""
_BEGUN = "The target is there; the map begins."


class Session:
    """A run: `step` takes an image, `restart` begins anew.

    Args:
        source: Where images come from.
        seed: Of the landmarks that are expected.
    """

    def __init__(self, source: Source, seed: int = 0) -> None:
        self.source, self._seed = source, seed
        self._forget()

    def _forget(self) -> None:
        self.front_end: FrontEnd | None = None
        self.adviser: Adviser | None = None
        self.knowledge: Knowledge | None = None
        self.marked = 0
        """Id of the feature that the user has marked, or 0."""
        self._frame, self._time, self._zero = 0, 0.0, 0.0
        self._image = np.zeros((self.source.scenario.image_height, self.source.scenario.image_width), np.uint8)
        self.log: FrameLog | None = None
        """Of the last image but the first."""
        self._good = 0.0
        self._known: set[int] = set()

    def restart(self) -> None:
        """Begin anew, with the source."""
        self.source.restart()
        self._forget()

    def step(self) -> State:
        """Take the next image; what is known after it. Where there is none, the last state is told again, as OVER.

        Raises:
            ValueError: an image cannot be read, or the first one does not show the target.
        """
        began = time.process_time()
        frame = self.source.next()
        if frame is None:
            return self._state(OVER, began)
        self._time, self._image = frame[0] - self._zero, frame[1]
        if self.front_end is None:
            try:
                self._begin(*frame)
            except ValueError as error:
                if not self.source.patient:
                    raise
                return self._state(WAITING, began, str(error))
        else:
            self._track()
        self._frame += 1
        return self._state(self._standing(), began)

    def _begin(self, at: float, image: np.ndarray) -> None:
        source = self.source
        self.front_end = source.start(image)
        seed = np.random.SeedSequence((self._seed, 1))
        self._zero, self._time, self._good = at, 0.0, 0.0
        self.knowledge = Knowledge(source.scenario, self.front_end, seed)
        self.adviser = Adviser(source.scenario, self.knowledge)

    def _track(self) -> None:
        assert self.front_end and self.knowledge and self.adviser
        self.log = self.front_end.step(self._image, self._time)
        self.knowledge.update()
        if self.log.matched >= _FEW:
            self._good = self._time
        if self.adviser.consider():
            tell(self.source, self.adviser.command)

    def _standing(self) -> str:
        assert self.front_end
        vague = np.diag(self.front_end.filter.camera_covariance)[:3].max() > _VAGUE**2
        if self._time - self._good > _PATIENCE or vague:
            return LOST
        log = self.log
        return TRACKING if log is None or log.matched >= max(_FEW, log.searched / 2) else UNSURE

    # What is known ----------------------------------------------------------------------------------------------------

    def _state(self, standing: str, began: float, why: str = "") -> State:
        log, person, adviser = self.log, self.source.person, self.adviser
        matched, searched = (log.matched, log.searched) if log else (0, 0)
        words = WORDS[standing].format(matched=matched, searched=searched, why=why)
        shared: dict[str, Any] = {
            "frame": self._frame,
            "time": self._time,
            "image": self._image,
            "standing": standing,
            "words": _BEGUN if standing == TRACKING and log is None else words,
            "births": log.births if log else 0,
            "command": int(adviser.command) if adviser else int(Motion.STAY),
            "scores": adviser.scores.copy() if adviser else np.full(MOTION_COUNT, np.nan),
            "told": adviser.told.copy() if adviser else np.zeros(MOTION_COUNT, int),
            "follows": habit_of(self.source),
            "truth": None if person is None else person.state.copy(),
            "marked": self.marked,
        }
        map = self._map() if self.front_end else _nothing()
        return State(**shared, **map, landmarks=len(self._known), milliseconds=1e3 * (time.process_time() - began))

    def _map(self) -> dict[str, Any]:
        """The parts of a state that are of the belief."""
        assert self.front_end and self.knowledge
        filter, searched = self.front_end.filter, self.front_end.searched
        points, P = filter.points()
        at = CAMERA_DIM + 3 * np.arange(len(points))[:, None, None] + np.arange(3)
        covariances, camera = P[np.swapaxes(at, 1, 2), at], filter.mean
        mapped = _depth_ratios(points - camera[:3], covariances) < _MAPPED
        self._known.update(filter.ids[mapped].tolist())
        return {
            "camera": camera,
            "camera_covariance": P[:3, :3].copy(),
            "ids": filter.ids,
            "points": points,
            "covariances": covariances,
            "mapped": mapped,
            "fiducials": filter.fiducials,
            "searched": searched.id,
            "pixels": searched.pixel,
            "ellipses": searched.covariance,
            "outcomes": searched.outcome,
            "log2_dets": self.knowledge.log2_dets(P),
        }


def _nothing() -> dict[str, Any]:
    """The parts of a state that are of the belief, before there is one."""
    camera = np.zeros(CAMERA_SIZE)
    camera[3] = 1.0
    none, whole = np.zeros((0, 3)), np.zeros(0, int)
    return {
        "camera": camera,
        "camera_covariance": np.zeros((3, 3)),
        "ids": whole,
        "points": none,
        "covariances": np.zeros((0, 3, 3)),
        "mapped": np.zeros(0, bool),
        "fiducials": none,
        "searched": whole,
        "pixels": np.zeros((0, 2)),
        "ellipses": np.zeros((0, 2, 2)),
        "outcomes": whole,
        "log2_dets": np.full(3, np.nan),
    }


def _depth_ratios(sights: np.ndarray, covariances: np.ndarray) -> np.ndarray:
    """(n,) deviation of the depth over the depth, of points at ``sights`` (n, 3) from the camera."""
    squares = np.maximum(np.sum(sights**2, axis=1), 1e-12)
    along = np.einsum("ni,nij,nj->n", sights, covariances, sights) / squares
    return np.sqrt(np.maximum(along, 0.0) / squares)
