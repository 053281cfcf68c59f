"""What policies and referees read of an environment; the same names for one and for a batch."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np

from activeslam_gym.batching import row
from activeslam_gym.config import Scenario
from activeslam_gym.envs import planning, readout
from activeslam_gym.envs.setting import Setting
from activeslam_gym.envs.step import STEPS, Run, play
from activeslam_gym.envs.views import PublicBelief, PublicBeliefs, Truth
from activeslam_gym.envs.workers import Workers
from activeslam_gym.information import Prospect
from activeslam_gym.slam.belief import DIM


class Reads:
    """B runs and what may be read of them: a batch has a leading axis B, a single environment (B = 1) none."""

    def __init__(self, setting: Setting, runs: Run, workers: Workers) -> None:
        self.setting = setting
        self._runs = runs
        self._workers = workers

    def _given(self, batch: np.ndarray) -> Any:
        """``batch`` (B, ...) as readers get it."""
        raise NotImplementedError

    def _play(self, motions: np.ndarray, gazes: np.ndarray) -> None:
        """One step of every run: ``motions`` (B,) and ``gazes`` (B,) as `step.play` takes them."""
        self._workers.call(play, self.setting.models, self.setting.task, self._runs, motions, gazes)

    def _begun_runs(self) -> Run:
        """The runs; raises gymnasium.error.ResetNeeded before the first reset."""
        if not self._runs.simulation.belief.size[:, DIM].all():
            raise gymnasium.error.ResetNeeded("there is nothing to score before the first reset()")
        return self._runs

    # Constants ------------------------------------------------------------------------------------------------------

    @property
    def scenario(self) -> Scenario:
        """The scenario."""
        return self.setting.scenario

    @property
    def gaze_period(self) -> float:
        """Time of a step [s]."""
        return self.setting.gaze_period

    @property
    def motion_period(self) -> float:
        """Time of a translation [s]."""
        return self.setting.motion_period

    @property
    def duration(self) -> float:
        """Time of an episode [s]."""
        return self.setting.duration

    @property
    def steps_per_motion(self) -> int:
        """Steps in a motion period."""
        return self.setting.task.steps_per_motion

    # For policies ---------------------------------------------------------------------------------------------------

    @property
    def motion_phase(self) -> Any:
        """Steps since the present motion period began; the next step's motion is read where this is 0."""
        return self._given(self._runs.step.status[:, STEPS] % self.steps_per_motion)

    @property
    def time(self) -> Any:
        """Time since the reset [s]."""
        return self._given(self._runs.step.status[:, STEPS] * self.gaze_period)

    def motion_scores(self, criterion: str = "mutual_information") -> np.ndarray:
        """(7,) what each motion would teach at its clipped goal, gaze STAY; see `information`.

        The covariance is propagated over the motion period from the present estimate, and one set of measurements is
        taken there. In bits for mutual information.

        Raises:
            ValueError: there is no such criterion.
            gymnasium.error.ResetNeeded: no run has begun.
        """
        return self._given(planning.motion_scores(self.setting, self._workers, self._begun_runs(), criterion))

    def gaze_scores(self, criterion: str = "fisher_trace") -> np.ndarray:
        """(3,) what each turn would teach after one gaze period at the present position.

        Raises:
            ValueError: there is no such criterion.
            gymnasium.error.ResetNeeded: no run has begun.
        """
        return self._given(planning.gaze_scores(self.setting, self._workers, self._begun_runs(), criterion))

    def joint_scores(self, criterion: str = "mutual_information") -> np.ndarray:
        """(7, 3) what each motion would teach with each gaze held for its whole period.

        Raises:
            ValueError: there is no such criterion.
            gymnasium.error.ResetNeeded: no run has begun.
        """
        return self._given(planning.joint_scores(self.setting, self._workers, self._begun_runs(), criterion))

    def motion_score(self, motion: int, criterion: str = "mutual_information") -> Any:
        """What one motion would teach; see `motion_scores`.

        Raises:
            ValueError: there is no such criterion or motion.
            gymnasium.error.ResetNeeded: no run has begun.
        """
        return self._given(planning.motion_score(self.setting, self._workers, self._begun_runs(), motion, criterion))

    def lookahead_scores(self, horizon: int = 2) -> np.ndarray:
        """(7,) mutual information [bit] of each motion and the best that may follow it, ``horizon`` motions in all.

        Raises:
            ValueError: ``horizon`` is not 1, 2, 3 or 4 (there are 7^horizon poses).
            gymnasium.error.ResetNeeded: no run has begun.
        """
        return self._given(planning.lookahead_scores(self.setting, self._workers, self._begun_runs(), horizon))

    # For referees ---------------------------------------------------------------------------------------------------

    @property
    def landmark_errors(self) -> np.ndarray:
        """(L,) distance of each true landmark from its mapped feature [m]; NaN where it is not mapped."""
        return self._given(readout.landmark_distances(self._runs))


class SingleReads(Reads):
    """Of one run: a batch of one, or one row of a larger batch, of which it shows the present state."""

    def __init__(self, setting: Setting, runs: Run, workers: Workers) -> None:
        super().__init__(setting, runs, workers)
        self._run = row(runs, 0)

    def __setstate__(self, state: dict[str, Any]) -> None:
        """A copy's or a pickle's row is a view of its own runs."""
        self.__dict__.update(state)
        self._run = row(self._runs, 0)

    def _given(self, batch: np.ndarray) -> Any:
        return batch[0] if batch.ndim > 1 else batch[0].item()

    @property
    def belief(self) -> PublicBelief:
        """The belief, with every feature as a point; read-only."""
        return readout.public_belief(self._run)

    @property
    def prospect(self) -> Prospect:
        """What the criteria score: the belief without rays, and the landmarks that are expected and not found yet.

        A copy, in the form that the functions of `information` take, for policies with a criterion of their own.
        """
        prospect = planning.prospect(self._run.simulation)
        return prospect._replace(fiducials=prospect.fiducials.copy())

    @property
    def truth(self) -> Truth:
        """What really is; for referees, never for policies."""
        return readout.truth_of(self._run)

    def nees(self) -> dict[str, float]:
        """NEES per degree of freedom of ``position``, ``orientation``, ``landmarks`` (mean of the mapped, or NaN)."""
        return readout.nees_per_dof(self._run)


class BatchReads(Reads):
    """Of a batch."""

    def _given(self, batch: np.ndarray) -> Any:
        return batch

    def run(self, i: int) -> SingleReads:
        """What a single environment lets read, of environment ``i`` and its present state at the time of reading.

        Raises:
            ValueError: there is no such environment.
        """
        count = len(self._runs.step.status)
        if i not in range(count):
            raise ValueError(f"i must be in 0 … {count - 1}, got {i!r}")
        return SingleReads(self.setting, row(self._runs, slice(i, i + 1)), Workers(1))

    @property
    def belief(self) -> PublicBeliefs:
        """The beliefs, with every feature as a point; read-only."""
        return readout.public_beliefs(self._runs)

    @property
    def truth(self) -> Truth:
        """What really is; for referees, never for policies."""
        return readout.truth_of(self._runs)

    def nees(self) -> dict[str, np.ndarray]:
        """(B,) NEES per degree of freedom of ``position``, ``orientation``, ``landmarks``; see `SingleReads.nees`."""
        each = [readout.nees_per_dof(row(self._runs, i)) for i in range(len(self._runs.step.status))]
        return {name: np.array([one[name] for one in each]) for name in each[0]}
