"""Where to move: the paper's section V. Seven candidate motions are scored in turn; the best is advised each second."""

import numpy as np

from activeslam_gym.config import Scenario
from activeslam_gym.information.candidates import motion_plans, score_plans
from activeslam_gym.information.criteria import CRITERIA
from activeslam_gym.live.expected import ExpectedMap
from activeslam_gym.motion import MOTION_COUNT, Motion, motion_of

PERIOD = 1.0
"""Time of a command [s]."""
CRITERION = "mutual_information_position_map"
"""It leaves out gaze and velocities, which are the person's (section V)."""
_TIE = 1e-6
"""To stay is advised unless a motion scores higher by more [bit]."""


class Adviser:
    """Scores the motions of a camera in the hand, one an image, and advises the best at the end of each second.

    The candidates are scored in the last images of the second, so that their scores are fresh; where there are fewer
    images than motions, several share one.
    """

    def __init__(self, scenario: Scenario, expected: ExpectedMap) -> None:
        self.expected, self._motion = expected, motion_of(scenario, PERIOD)
        self._frames = max(2, round(PERIOD / scenario.frame_time))
        self._plans, self._criterion = motion_plans(self._frames), CRITERIA.number(CRITERION)
        slots = min(self._frames - 1, MOTION_COUNT)
        self._turn = self._frames - slots + np.arange(MOTION_COUNT) * slots // MOTION_COUNT
        self._phase, self._pending = 0, np.full(MOTION_COUNT, np.nan)
        self.command = Motion.STAY
        """The present advice."""
        self.scores = np.full(MOTION_COUNT, np.nan)
        """(7,) [bit] by which it was chosen."""
        self.advised = np.zeros(MOTION_COUNT, int)
        """(7,) how often each motion was advised."""

    def consider(self) -> bool:
        """After an image: score the motions whose turn it is; True where there is a new command."""
        self._phase += 1
        if self._phase < self._frames:
            for motion in np.flatnonzero(self._turn == self._phase).tolist():
                self._pending[motion] = self.score(motion)
            return False
        self._phase, self.scores = 0, self._pending.copy()
        self.command = best(self.scores)
        self.advised[self.command] += 1
        return True

    def score(self, motion: int) -> float:
        """Mutual information of ``motion`` [bit]; NaN where the covariance is not positive definite."""
        out, plan, expected = np.empty(1), self._plans[motion : motion + 1], self.expected
        score_plans(expected.camera, self._motion, expected.prospect(), 0.0, plan, self._criterion, out)
        return float(out[0])


def best(scores: np.ndarray) -> Motion:
    """The motion with the highest of ``scores`` (7,); to stay, where none is better or a score is missing."""
    if np.isnan(scores).any() or scores.max() <= scores[Motion.STAY] + _TIE:
        return Motion.STAY
    return Motion(int(scores.argmax()))
