"""What a belief is worth: its entropies at a constant dimension, and what is expected and not found yet.

As in `ActiveSLAM-v0`: the room is assumed to hold N landmarks; one that nobody has found holds its prior, and is what
makes it worthwhile to go somewhere.
"""

import math

import numpy as np

from activeslam_gym.config import Scenario
from activeslam_gym.information.candidates import Prospect, prospect_of
from activeslam_gym.information.expectation import EXPECTED, find_counting, update_expectation, waiting_count
from activeslam_gym.information.foresight import SensorLimits
from activeslam_gym.motion import CAMERA_DIM, MOTION_COUNT
from activeslam_gym.vision.frontend import FrontEnd


class Knowledge:
    """Of the filter of ``front_end`` in a room of the ``scenario``; expected landmarks are drawn from ``seed``."""

    def __init__(self, scenario: Scenario, front_end: FrontEnd, seed: np.random.SeedSequence) -> None:
        self._front_end, self._filter = front_end, front_end.filter
        s = front_end.settings
        self._limits = SensorLimits(s.most_change, s.visible)
        self.camera = front_end.camera
        self._prior = np.array(scenario.landmark_prior_variance)
        self._expected = np.zeros(scenario.landmark_count, EXPECTED)
        room = np.array(scenario.room_size)
        places = np.random.default_rng(seed).random((scenario.landmark_count, 3)) - 0.5
        self._expected["point"] = places * room

    def update(self) -> None:
        """After a frame: what has been found is expected no more."""
        update_expectation(self._expected, self._prior, self._filter.arrays())

    def prospect(self) -> Prospect:
        """What an adviser plans with."""
        filter, free = self._filter, np.ones(MOTION_COUNT)
        first_seen, places = self._front_end.first_seen(filter.ids), (filter.fiducials, filter.boxes)
        return prospect_of(filter.arrays(), self._expected, self._prior, *places, free, self._limits, first_seen)

    def counting(self) -> np.ndarray:
        """Positions, in the filter's order, of the features that count: each has retired an expected landmark."""
        return np.flatnonzero(find_counting(self._expected, self._filter.arrays()))

    def log2_dets(self, covariance: np.ndarray) -> np.ndarray:
        """(3,) log2 |P| of camera (12), map (3 N) and total (12 + 3 N), of the joint ``covariance`` (12 + 3 n)^2.

        The paper's figure 5 (a). It mixes metres, radians and their rates. NaN where it is not positive definite.
        """
        rows = (CAMERA_DIM + 3 * self.counting()[:, None] + np.arange(3)).ravel()
        rest = waiting_count(self._expected) * math.log2(np.prod(self._prior))
        both = np.concatenate((np.arange(CAMERA_DIM), rows))
        parts = (np.arange(CAMERA_DIM), 0.0), (rows, rest), (both, rest)
        return np.array([_log2_det(covariance[np.ix_(part, part)]) + more for part, more in parts])


def _log2_det(P: np.ndarray) -> float:
    sign, log_det = np.linalg.slogdet(P)
    return log_det / math.log(2.0) if sign > 0 else math.nan
