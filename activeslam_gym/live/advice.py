"""Where to move: the paper's section V. Seven candidate motions are scored in turn; the best is advised each second.

A room holds N landmarks, as in `ActiveSLAM-v0`. Features stand for some; each of the others holds its prior and makes
exploration worthwhile, and entropies have a constant dimension.
"""

import numpy as np

from activeslam_gym.config import Scenario
from activeslam_gym.information.candidates import (
    OPEN_LOOP,
    PredictedBelief,
    SensorLimits,
    motion_plans,
    predicted_belief_of,
    score_plans,
)
from activeslam_gym.information.criteria import CRITERIA
from activeslam_gym.information.entropy import EXPECTED, WAITING, gathered, log2_dets, update_expectation
from activeslam_gym.kernels import record
from activeslam_gym.linalg import cholesky_in_place
from activeslam_gym.motion import MOTION_COUNT, Motion, motion_of
from activeslam_gym.vision.frontend import FrontEnd
from activeslam_gym.vision.settings import SIGHTED

_PARTS = ("camera", "pose", "map", "total")
_MOST_CHANGE = SIGHTED.most_change
"""Change of a view up to which any template can be drawn [rad]: beyond it, some are too narrow or of another size."""


def points_anywhere(scenario: Scenario, seed: np.random.SeedSequence) -> np.ndarray:
    """(N, 3) a point for each landmark of the ``scenario``, uniform in its room [m]."""
    return (np.random.default_rng(seed).random((scenario.landmark_count, 3)) - 0.5) * np.array(scenario.room_size)


class ExpectedMap:
    """The N landmarks of a ``scenario`` and the features of ``front_end`` that stand for them; drawn from ``seed``."""

    def __init__(self, scenario: Scenario, front_end: FrontEnd, seed: np.random.SeedSequence) -> None:
        self._front_end, self._filter, self.camera = front_end, front_end.filter, front_end.camera
        self._limits = SensorLimits(min(front_end.settings.most_change, _MOST_CHANGE), front_end.settings.visible)
        self.landmark_var = np.array(scenario.landmark_prior_variance)
        """(3,) of a landmark without a feature, each axis [m^2]."""
        self._expected = np.zeros(scenario.landmark_count, EXPECTED)
        self._expected["point"] = points_anywhere(scenario, seed)

    def update(self) -> None:
        """Assign landmarks to features, after a frame."""
        update_expectation(self._expected, self.landmark_var, self._front_end.estimate())

    def predicted_belief(self) -> PredictedBelief:
        """The input of a planner."""
        filter, clearance = self._filter, np.full(MOTION_COUNT, np.inf)
        first_seen, places = self._front_end.first_seen(filter.ids), (filter.fiducials, filter.boxes)
        own = self._front_end.estimate(), self._expected, self.landmark_var
        return predicted_belief_of(*own, *places, clearance, self._limits, first_seen)

    def factored(self) -> tuple[np.ndarray, np.ndarray | None]:
        """Position k (N,) of each landmark's feature, or -1; and a factor U of the covariance of those and the camera.

        U begins with the features in the landmarks' order. It is None where the covariance is not positive definite.
        """
        features = self._expected["feature"]
        of_landmark = np.where(features == WAITING, -1, np.searchsorted(self._filter.ids, features))
        U = gathered(self._front_end.estimate().covariance, of_landmark[of_landmark >= 0], of_landmark[:0])
        return of_landmark, U if cholesky_in_place(U) else None

    def log2_dets(self) -> np.ndarray:
        """(3,) log2 |P| of camera (12), map (3 N) and total (12 + 3 N): the paper's figure 5 (a).

        It mixes metres, radians and their rates. NaN where the covariance is not positive definite.
        """
        of_landmark, U = self.factored()
        if U is None:
            return np.full(3, np.nan)
        out = np.zeros(1, record(**{f"log2_det_{part}": "f8" for part in _PARTS}))[0]
        counting = of_landmark[of_landmark >= 0]
        waiting, covariance = len(of_landmark) - len(counting), self._front_end.estimate().covariance
        log2_dets(self.landmark_var, waiting, covariance, U, counting, len(counting), out)
        return np.array([out[f"log2_det_{part}"] for part in ("camera", "map", "total")])


PERIOD = 1.0
"""Time of a command [s]."""
CRITERION = "mutual_information_position_map"
"""It leaves out gaze and velocities, which are the person's (section V)."""
_TIE = 1e-6
"""To stay is advised unless a motion scores higher by more [bit]."""


class Adviser:
    """Scores the motions of a camera in the hand, one an image, and advises the best at the end of each second.

    The candidates are scored in the last images of the second, so that their scores are fresh; where there are fewer
    images than motions, or images are missing, several share one. Motions end inside the walls of the scenario's room,
    if it has ``walls``.
    """

    def __init__(self, scenario: Scenario, front_end: FrontEnd, seed: np.random.SeedSequence, walls: bool) -> None:
        self.expected, self._motion = ExpectedMap(scenario, front_end, seed), motion_of(scenario, PERIOD)
        if not walls:
            self._motion.half[:] = np.inf
        self._frames = max(2, round(PERIOD / scenario.frame_time))
        self._plans, self._criterion = motion_plans(self._frames), list(CRITERIA).index(CRITERION)
        self._open_loops = np.zeros(1, OPEN_LOOP)  # all motions' alike
        slots = min(self._frames - 1, MOTION_COUNT)
        self._turn = self._frames - slots + np.arange(MOTION_COUNT) * slots // MOTION_COUNT
        self._frame_time, self._begun = scenario.frame_time, 0.0
        self._phase, self._pending = 0, np.full(MOTION_COUNT, np.nan)
        self.command = Motion.STAY
        """The present advice."""
        self.scores = np.full(MOTION_COUNT, np.nan)
        """(7,) [bit] by which it was chosen."""
        self.advised = np.zeros(MOTION_COUNT, int)
        """(7,) how often each motion was advised."""

    def consider(self, time: float) -> bool:
        """After an image, ``time`` [s] after the first: score the motions whose turn it is; True at a new command."""
        self.expected.update()
        before, self._phase = self._phase, round((time - self._begun) / self._frame_time)
        for motion in np.flatnonzero((self._turn > before) & (self._turn <= self._phase)).tolist():
            self._pending[motion] = self._score(motion)
        if self._phase < self._frames:
            return False
        self._phase, self._begun, self.scores = 0, time, self._pending.copy()
        self.command = best(self.scores)
        self.advised[self.command] += 1
        return True

    def _score(self, motion: int) -> float:
        """Mutual information of ``motion`` [bit]; NaN where the covariance is not positive definite."""
        out, plan, lens = np.empty(1), self._plans[motion : motion + 1], self.expected.camera
        belief = self.expected.predicted_belief()
        score_plans(lens, self._motion, belief, 0.0, plan, self._criterion, self._open_loops, out)
        return float(out[0])


def best(scores: np.ndarray) -> Motion:
    """The motion with the highest of ``scores`` (7,); to stay, where none is better or a score is missing."""
    if np.isnan(scores).any() or scores.max() <= scores[Motion.STAY] + _TIE:
        return Motion.STAY
    return Motion(int(scores.argmax()))
