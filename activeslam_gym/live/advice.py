"""Where to move: the paper's section V. Seven candidate motions are scored in turn; the best is advised each second.

A policy of an environment can advise instead, a learned one too. What it wants of the gaze is left to the person.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from importlib.metadata import entry_points
from typing import Any, Protocol

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
PAPER = "paper"
"""The name of `CandidateScores` among the advisers."""
POLICIES = "activeslam_gym.policies"
"""The entry points by which packages offer policies: from a name, what binds that policy to an environment."""


class Adviser(Protocol):
    """Advises a motion once a second."""

    expected: ExpectedMap
    command: Motion
    """The present advice."""
    scores: np.ndarray
    """(7,) by which it was chosen, NaN where there are none."""
    advised: np.ndarray
    """(7,) how often each motion was advised."""

    def consider(self) -> bool:
        """After an image; True where there is a new command."""


MakeAdviser = Callable[[Scenario, ExpectedMap], Adviser]


def adviser_named(name: str) -> MakeAdviser:
    """The adviser of a ``name``: ``paper``, or a policy that an installed package offers.

    Raises:
        ValueError: there is none of that name; the message lists them.
    """
    return CandidateScores if name == PAPER else partial(PolicyAdviser, _policy_named(name))


def _policy_named(name: str) -> Callable[[Any], Any]:
    offers = [one.load()(name) for one in entry_points(group=POLICIES)]
    if not offers:
        raise ValueError(f"--adviser must be {PAPER!r}, since no installed package has policies, got {name!r}")
    return offers[0]


class PolicyAdviser:
    """Asks a policy once a second, as it would be asked in an environment. ``make`` binds it to one."""

    def __init__(self, make: Callable[[Any], Any], scenario: Scenario, expected: ExpectedMap) -> None:
        self.expected, self._frames = expected, max(2, round(PERIOD / scenario.frame_time))
        self._run = expected.outside_run(replace(scenario, frame_time=PERIOD / self._frames), PERIOD)
        self._policy, self._state = make(self._run), None
        self._phase, self._begin = 0, expected.log2_dets()[-1]
        self.command, self.scores = Motion.STAY, np.full(MOTION_COUNT, np.nan)
        self.advised = np.zeros(MOTION_COUNT, int)

    def consider(self) -> bool:
        """After an image: ask the policy where a second is over; True where there is a new command."""
        self._phase += 1
        if self._phase < self._frames:
            return False
        self._phase, gain = 0, 0.5 * (self._begin - self.expected.log2_dets()[-1])
        action, self._state = self._policy.predict(self.expected.observed_by(self._run, gain), self._state)
        self._run.decided(action)
        self.command = Motion(int(action[0]))
        self.advised[self.command] += 1
        return True


class CandidateScores:
    """Scores the motions of a camera in the hand, one an image, and advises the best at the end of each second.

    The candidates are scored in the last images of the second, so that their scores are fresh; where there are fewer
    images than motions, several share one.
    """

    def __init__(self, scenario: Scenario, expected: ExpectedMap) -> None:
        self.expected, self._motion = expected, motion_of(scenario, PERIOD)
        self._frames = max(2, round(PERIOD / scenario.frame_time))
        self._plans, self._criterion = motion_plans(self._frames), list(CRITERIA).index(CRITERION)
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
        score_plans(expected.camera, self._motion, expected.predicted_belief(), 0.0, plan, self._criterion, out)
        return float(out[0])


def best(scores: np.ndarray) -> Motion:
    """The motion with the highest of ``scores`` (7,); to stay, where none is better or a score is missing."""
    if np.isnan(scores).any() or scores.max() <= scores[Motion.STAY] + _TIE:
        return Motion.STAY
    return Motion(int(scores.argmax()))
