"""A live run without a page, judged against the truth: for studies. A rendered room and a simulated person."""

import math
from typing import NamedTuple

import numpy as np

from activeslam_gym.live.session import Session
from activeslam_gym.live.source import ROOM, RenderedRoom
from activeslam_gym.live.state import State
from activeslam_gym.metrics import LOST_POSITION_ERROR, camera_error
from activeslam_gym.motion import CAMERA_DIM
from activeslam_gym.vision.frontend import MATCHED

CLOSURE_GAP = 5.0
"""A loop closes when something known is matched again after so long without a match [s]. The paper names no number."""


class Second(NamedTuple):
    """How it stands when a command is told."""

    time: float
    """[s]"""
    command: int
    """The `Motion` that is told now."""
    log2_dets: np.ndarray
    """(3,) log2 |P| of camera, map and total."""
    log_score: float
    """log2 N(truth | belief) of camera and N landmarks; one that nobody has found scores by the prior [bit]."""
    position_error: float
    """[m]"""
    position_nees: float
    """Per degree of freedom."""
    landmark_rmse: float
    """Of those well placed, against the scene points of their birth pixels [m]; NaN without any."""
    features: int
    mapped: int
    """Well placed."""
    births: int
    """In the last second."""
    closures: int
    """Of loops, in the last second."""
    matched: float
    """Share of the searched, in the last second; NaN if nothing was."""
    lost: bool
    """Now or at an earlier command: the position error is over `LOST_POSITION_ERROR`."""
    milliseconds: float
    """Of an image, in the last second: the mean."""


def trial(seed: int, habit: str, seconds: float) -> list[Second]:
    """The run of a person of that ``habit`` (`person.HABITS`) in the rendered room of ``seed``, second by second."""
    room = RenderedRoom(seed, habit)
    session, referee = Session(room, seed), Referee(room)
    told: list[Second] = []
    period = max(2, round(1.0 / ROOM.frame_time))
    for k in range(round(seconds / ROOM.frame_time) + 1):
        referee.look(session, session.step())
        if k and k % period == 0:
            told.append(referee.second())
    return told


class Referee:
    """Sees the truth, and counts within a second."""

    def __init__(self, room: RenderedRoom) -> None:
        self._room = room
        self._points: dict[int, np.ndarray] = {}
        self._last: dict[int, float] = {}
        self._lost = False
        self._begin()

    def _begin(self) -> None:
        self._births = self._closures = self._matched = self._searched = self._images = 0
        self._milliseconds = 0.0

    def look(self, session: Session, state: State) -> None:
        """After an image."""
        assert session.front_end and state.truth is not None
        self._session, self._state = session, state
        if state.births:
            for one in session.front_end.candidates[-state.births :]:
                self._points[int(one["match"])] = self._room.camera.point(state.truth, one["pixel"])
        matched = state.searched[state.outcomes == MATCHED]
        for id in matched.tolist():
            self._closures += state.time - self._last.get(id, state.time) >= CLOSURE_GAP
            self._last[id] = state.time
        self._births += state.births
        self._matched, self._searched = self._matched + len(matched), self._searched + len(state.searched)
        self._milliseconds, self._images = self._milliseconds + state.milliseconds, self._images + 1

    def second(self) -> Second:
        """What the last second came to; the next begins."""
        state, truth = self._state, self._state.truth
        assert truth is not None
        error = state.camera[:3] - truth[:3]
        distance = float(np.linalg.norm(error))
        self._lost = self._lost or not distance <= LOST_POSITION_ERROR
        there = np.array([self._points[id] for id in state.ids.tolist()]).reshape(-1, 3)
        squares = np.sum((state.points - there)[state.mapped] ** 2, axis=1)
        out = Second(
            time=state.time,
            command=state.command,
            log2_dets=state.log2_dets,
            log_score=self._log_score(there, truth),
            position_error=distance,
            position_nees=float(error @ np.linalg.solve(state.camera_covariance, error)) / 3.0,
            landmark_rmse=math.sqrt(squares.mean()) if len(squares) else math.nan,
            features=len(state.ids),
            mapped=int(state.mapped.sum()),
            births=self._births,
            closures=self._closures,
            matched=self._matched / self._searched if self._searched else math.nan,
            lost=self._lost,
            milliseconds=self._milliseconds / max(self._images, 1),
        )
        self._begin()
        return out

    def _log_score(self, there: np.ndarray, truth: np.ndarray) -> float:
        """See `Second`. ``there`` (n, 3) is where the features really are.

        A point anywhere in the room has under the prior, a Gaussian of the same moments, an expected square of 3.
        """
        session, state = self._session, self._state
        assert session.front_end and session.knowledge
        points, P = session.front_end.filter.points()
        counting = session.knowledge.counting()
        rows = np.concatenate((np.arange(CAMERA_DIM), (CAMERA_DIM + 3 * counting[:, None] + np.arange(3)).ravel()))
        error = np.concatenate((camera_error(truth, state.camera), (there - points)[counting].ravel()))
        P = P[np.ix_(rows, rows)]
        square = float(error @ np.linalg.solve(P, error))
        waiting = ROOM.landmark_count - len(counting)
        size, log2_det = len(rows) + 3 * waiting, float(state.log2_dets[2])
        return -0.5 * (size * math.log2(2.0 * math.pi) + log2_det + (square + 3.0 * waiting) / math.log(2.0))
