"""One run of the live system: image by image, from a source to a state estimate and advice."""

import time

import numpy as np

from activeslam_gym.live.advice import Adviser, CandidateScores, MakeAdviser
from activeslam_gym.live.device import Device
from activeslam_gym.live.expected import ExpectedMap
from activeslam_gym.live.person import FOLLOW
from activeslam_gym.live.source import GuidanceError, RecordedImages, RenderedRoom
from activeslam_gym.live.state import Standing, State
from activeslam_gym.motion import CAMERA_DIM, CAMERA_SIZE, MOTION_COUNT, Motion
from activeslam_gym.slam.estimate import Estimate, taken_estimate
from activeslam_gym.vision.film import point_covariances
from activeslam_gym.vision.frontend import FrontEnd
from activeslam_gym.vision.outcome import FrameLog, Searched

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
_BEGUN = "The target is there; the map begins."
_NO_IDS, _NO_POINTS = np.zeros(0, int), np.zeros((0, 3))
_NO_ESTIMATE = Estimate(
    np.eye(1, CAMERA_SIZE, 3)[0], _NO_IDS, _NO_POINTS, np.zeros((CAMERA_DIM, CAMERA_DIM)), _NO_IDS > 0, _NO_IDS > 0
)
_NO_SEARCH = Searched(_NO_IDS, _NO_POINTS[:, :2], np.zeros((0, 2, 2)), _NO_IDS)


class Session:
    """A run: `step` processes an image, `restart` starts again.

    Args:
        source: Of the images.
        seed: Of the expected landmarks.
        adviser: Makes what advises; see `advice.adviser_named`.
    """

    def __init__(self, source: Source, seed: int = 0, adviser: MakeAdviser = CandidateScores) -> None:
        self.source, self._seed, self._make_adviser = source, seed, adviser
        self._reset()

    def _reset(self) -> None:
        self.front_end: FrontEnd | None = None
        self.adviser: Adviser | None = None
        self.expected: ExpectedMap | None = None
        self.log: FrameLog | None = None
        """Of the last image but the first."""
        self._frame, self._time, self._zero, self._good = 0, 0.0, 0.0, 0.0
        self._image = np.zeros((self.source.scenario.image_height, self.source.scenario.image_width), np.uint8)
        self._mapped: set[int] = set()

    def restart(self) -> None:
        """Start again, with the source."""
        self.source.restart()
        self._reset()

    def step(self) -> State:
        """The state after the next image; the last one again, as OVER, where there is none.

        Raises:
            ValueError: an image cannot be read, or the first one does not show the target.
        """
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
        seed = np.random.SeedSequence((self._seed, 1))
        self.expected = ExpectedMap(self.source.scenario, self.front_end, seed)
        self.adviser = self._make_adviser(self.source.scenario, self.expected)

    def _track(self, front_end: FrontEnd) -> None:
        assert self.expected and self.adviser
        self.log = front_end.step(self._image, self._time)
        self.expected.update()
        if self.log.matched >= _FEW:
            self._good = self._time
        if self.adviser.consider() and self.source.person is not None:
            self.source.person.hear(self.adviser.command)

    def _standing(self) -> Standing:
        assert self.front_end
        log, variances = self.log, np.diag(self.front_end.filter.camera_covariance)[:3]
        if self._time - self._good > _PATIENCE or variances.max() > _VAGUE**2:
            return Standing.LOST
        well = log is None or log.matched >= max(_FEW, log.searched / 2)
        return Standing.TRACKING if well else Standing.UNSURE

    def _state(self, standing: Standing, began: float, why: ValueError | None = None) -> State:
        log, person, adviser, front_end = self.log, self.source.person, self.adviser, self.front_end
        estimate = taken_estimate(front_end.estimate()) if front_end else _NO_ESTIMATE
        search = front_end.searched if front_end else _NO_SEARCH
        begun = standing == Standing.TRACKING and log is None
        words = _BEGUN if begun else "{why}" if isinstance(why, GuidanceError) else WORDS[standing]
        matched, searched = (log.matched, log.searched) if log else (0, 0)
        P = estimate.covariance
        self._mapped.update(estimate.ids[estimate.mapped].tolist())
        return State(
            frame=self._frame,
            time=self._time,
            image=self._image,
            standing=standing,
            words=words.format(matched=matched, searched=searched, why=why),
            camera=estimate.camera,
            camera_covariance=P[:3, :3],
            ids=estimate.ids,
            points=estimate.points,
            covariances=point_covariances(P),
            mapped=estimate.mapped,
            fiducials=front_end.filter.fiducials if front_end else _NO_POINTS,
            searched=search.id,
            pixels=search.pixel,
            ellipses=search.covariance,
            outcomes=search.outcome,
            command=adviser.command if adviser else Motion.STAY,
            scores=adviser.scores if adviser else np.full(MOTION_COUNT, np.nan),
            advised=adviser.advised.copy() if adviser else np.zeros(MOTION_COUNT, int),
            log2_dets=self.expected.log2_dets() if self.expected else np.full(3, np.nan),
            landmarks=len(self._mapped),
            initialised=log.initialised if log else 0,
            follows=None if person is None else person.habit == FOLLOW,
            truth=None if person is None else person.state.copy(),
            milliseconds=1e3 * (time.thread_time() - began),
        )
