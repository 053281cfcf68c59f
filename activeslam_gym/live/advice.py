"""Where to move: the paper's section V. One of seven motions is evaluated an image, the best is told once a second."""

import numpy as np

from activeslam_gym.config import Scenario
from activeslam_gym.information.candidates import motion_plans, score_plans
from activeslam_gym.information.criteria import CRITERIA
from activeslam_gym.live.knowledge import Knowledge
from activeslam_gym.motion import MOTION_COUNT, Motion, motion_of

PERIOD = 1.0
"""Time of a command [s]."""
CRITERION = "mutual_information_position_map"
"""What is known of the gaze and of velocities is not the adviser's business (section V)."""
_TIE = 1e-6
"""A motion that is not better than to stay by more is not worth it [bit]."""


class Adviser:
    """Scores the motions of a camera in the hand, one an image, and tells the best when a second is over.

    Candidates take the last images of the second, so that their scores are fresh; where there are fewer images than
    motions, several share one.
    """

    def __init__(self, scenario: Scenario, knowledge: Knowledge) -> None:
        self._knowledge = knowledge
        self._motion = motion_of(scenario, PERIOD)
        self.frames = max(2, round(PERIOD / scenario.frame_time))
        """Images between two commands."""
        self._plans = motion_plans(self.frames)
        slots = min(self.frames - 1, MOTION_COUNT)
        self._turn = self.frames - slots + np.arange(MOTION_COUNT) * slots // MOTION_COUNT
        self._criterion = CRITERIA.number(CRITERION)
        self._pending = np.full(MOTION_COUNT, np.nan)
        self._phase = 0
        self.command = Motion.STAY
        """What is advised now."""
        self.scores = np.full(MOTION_COUNT, np.nan)
        """(7,) [bit] by which it was chosen."""
        self.told = np.zeros(MOTION_COUNT, int)
        """(7,) how often each motion was advised."""

    def consider(self) -> bool:
        """After an image: evaluate whose turn it is. Whether a new command has been told."""
        self._phase += 1
        if self._phase < self.frames:
            for motion in np.flatnonzero(self._turn == self._phase).tolist():
                self._pending[motion] = self.score(motion)
            return False
        self._phase = 0
        self.scores, self._pending = self._pending, np.full(MOTION_COUNT, np.nan)
        self.command = best(self.scores)
        self.told[self.command] += 1
        return True

    def score(self, motion: int) -> float:
        """What ``motion`` would teach of position and map [bit]; NaN where the belief is not positive definite."""
        out, plan = np.empty(1), self._plans[motion : motion + 1]
        knowledge = self._knowledge
        score_plans(knowledge.camera, self._motion, knowledge.prospect(), 0.0, plan, self._criterion, out)
        return float(out[0])


def best(scores: np.ndarray) -> Motion:
    """The motion with the highest of ``scores`` (7,); to stay, where none is better or a score is missing."""
    if np.isnan(scores).any() or scores.max() <= scores[Motion.STAY] + _TIE:
        return Motion.STAY
    return Motion(int(scores.argmax()))
