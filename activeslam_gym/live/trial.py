"""A live run without a page, evaluated against the ground truth: rendered room, simulated person; for studies."""

from typing import NamedTuple

import numpy as np

from activeslam_gym.live.advice import points_anywhere
from activeslam_gym.live.session import Session
from activeslam_gym.live.source import ROOM, RenderedRoom
from activeslam_gym.live.state import State
from activeslam_gym.metrics import LOST_POSITION_ERROR, UNSOUND_LOG_SCORE, is_lost, log2_density
from activeslam_gym.vision.room.camera import FollowedPoints


class Second(NamedTuple):
    """Measures at a command, once a second; metres, seconds, bits, and NaN where there is nothing to measure."""

    time: float
    log2_det_total: float
    """log2 |P| of camera and map."""
    log_score: float
    """log2 N(truth | estimate) of camera and N landmarks, less that of the first image; see `Evaluator`."""
    position_error: float
    lost: bool
    """At this or an earlier command, see `metrics.is_lost`."""


def trial(seed: int, habit: str, seconds: float) -> list[Second]:
    """The run of a person with a ``habit`` (`source.HABITS`) in the rendered room of ``seed``, second by second."""
    room = RenderedRoom(seed, habit)
    session, evaluator = Session(room, seed), Evaluator(room, seed)
    out, period = [], max(2, round(1.0 / ROOM.frame_time))
    for k in range(round(seconds / ROOM.frame_time) + 1):
        evaluator.add(session, session.step())
        if k and k % period == 0:
            out.append(evaluator.second())
    return out


class Evaluator:
    """Compares a run with the ground truth, as the environments with images do.

    The true landmarks of the N slots of the log score: the scene point that the slot's feature
    follows; of a slot without one, a random point of the room, drawn from ``seed``.
    """

    def __init__(self, room: RenderedRoom, seed: int) -> None:
        self._spare = points_anywhere(room.scenario, np.random.SeedSequence((seed, 2)))
        self._followed = FollowedPoints(room.camera)
        self._lost = False
        self._first_density: float | None = None

    def add(self, session: Session, state: State) -> None:
        """Take in an image."""
        assert session.front_end and session.adviser and state.truth is not None
        self._expected, self._state, self._truth = session.adviser.expected, state, state.truth
        if session.log is not None:
            self._followed.look(self._truth, state.image, session.front_end.candidates)
        if self._first_density is None:
            self._first_density = self._log2_density()

    def second(self) -> Second:
        """Measures of the second that ends here."""
        state, density = self._state, self._log2_density()
        assert self._first_density is not None
        distance = float(np.linalg.norm(state.camera[:3] - self._truth[:3]))
        self._lost = self._lost or is_lost(density is not None, distance, LOST_POSITION_ERROR)
        score = UNSOUND_LOG_SCORE if density is None else density - self._first_density
        return Second(state.time, float(state.log2_dets[2]), score, distance, self._lost)

    def _log2_density(self) -> float | None:
        """log2 N(truth | estimate) [bit], or None where the covariance is not positive definite."""
        state, (of_landmark, U) = self._state, self._expected.factored()
        if U is None:
            return None
        landmarks, standing = self._spare.copy(), of_landmark >= 0
        landmarks[standing] = self._followed.of(state.ids)[of_landmark[standing]]
        variances = self._expected.landmark_var
        return float(log2_density(self._truth, landmarks, state.camera, state.points, variances, of_landmark, U))
