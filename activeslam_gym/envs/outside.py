"""What policies read where there is no environment: a run whose estimates come from outside."""

from typing import Any

import numpy as np

from activeslam_gym.config import Scenario
from activeslam_gym.envs.actions import PAIRS
from activeslam_gym.envs.identity import match_to_truth
from activeslam_gym.envs.observation import observation_space, observe
from activeslam_gym.envs.public import SingleReads
from activeslam_gym.envs.setting import resolve
from activeslam_gym.envs.simulation import empty_runs
from activeslam_gym.information.sensor_limits import SensorLimits
from activeslam_gym.kernels import row
from activeslam_gym.metrics import LOST_POSITION_ERROR
from activeslam_gym.motion import COMMANDS
from activeslam_gym.slam.estimate import EstimateArrays
from activeslam_gym.threads import Workers


class OutsideRun(SingleReads):
    """Stands in for an environment of the ``scenario`` before a policy: it has no truth and no step.

    A policy is bound to it as to an environment, and decides once a ``period`` [s]. As such a run has no end, at least
    half of an episode always seems to be left.

    Args:
        scenario: Its sensor may be any.
        period: Time between decisions [s].
        limits: Those of the sensor.
    """

    def __init__(self, scenario: Scenario, period: float, limits: SensorLimits) -> None:
        duration = period * max(2, round(scenario.duration / period))
        setting = resolve(scenario, period, period, duration, "entropy", LOST_POSITION_ERROR)
        runs = empty_runs(setting.scenario, 1)
        runs = runs._replace(first_seen=np.zeros((*runs.owner.shape, 3)))
        super().__init__(setting, runs, Workers(1))
        runs.models[0] = setting.models
        runs.models["greatest_change"], runs.models["wanted"] = limits
        runs.episode["begun"] = True
        self.observation_space, self.action_space = observation_space(setting.layout), PAIRS.space()
        self._decisions = 0

    @property
    def unwrapped(self) -> "OutsideRun":
        """Itself."""
        return self

    def observed(
        self,
        estimate: EstimateArrays,
        first_seen: np.ndarray,
        expected: np.ndarray,
        fiducials: np.ndarray,
        gain: float,
    ) -> np.ndarray:
        """Take in the present state; the observation (D,).

        Args:
            estimate: Of n landmarks.
            first_seen: (n, 3) where the camera was when each of them was initialised [m].
            expected: (N,) EXPECTED landmarks.
            fiducials: (K, 3) [m], as many as the scenario has.
            gain: Entropy removed so far [bit].
        """
        runs, run, n = self._runs, row(self._runs, 0), int(estimate.state.count)
        runs.estimate.state[0] = np.asarray(estimate.state)
        size = len(estimate.covariance)
        run.estimate.landmark[:n], run.estimate.covariance[:size, :size] = estimate.landmark[:n], estimate.covariance
        run.estimate.state.whole = True
        run.first_seen[:n], run.expected[:], run.world.fiducials[:] = first_seen, expected, fiducials
        match_to_truth(run.owner, run.estimate)
        run.episode.steps = min(self._decisions, int(self.setting.task.steps) // 2)
        run.episode.gain = gain
        observe(run)
        return run.observation.copy()

    def decided(self, action: Any) -> None:
        """The ``action`` (motion, gaze) is under way."""
        self._decisions += 1
        self._runs.episode["control"]["command"][0] = COMMANDS[int(action[0]), int(action[1]), :3]
