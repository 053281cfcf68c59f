"""The scores of candidate actions: what each plan would teach, by the predicted belief of each run.

`Scores` is the part of an environment that policies call. A score is of `information.candidates.score_plans`, in one
kernel for all runs; by the criterion `net_information` it is of `information.net.net_of_plans`, and with a sensor or a
criterion of a user's own, in Python, of `information.foreign.score_plans_with`.
"""

from functools import partial

import gymnasium
import numpy as np

from activeslam_gym.config import MOST_HELD_FRAMES
from activeslam_gym.envs.observation import FARTHEST_CLEARANCE
from activeslam_gym.envs.run import Run, known_boxes, run_at, write_whole_estimate
from activeslam_gym.envs.runs import Runs
from activeslam_gym.envs.setting import Setting
from activeslam_gym.information import candidates
from activeslam_gym.information.candidates import PredictedBelief, SensorLimits, predicted_belief_of, score_plans
from activeslam_gym.information.criteria import CRITERIA, NET, Criterion
from activeslam_gym.information.foreign import score_plans_with, sight_by
from activeslam_gym.information.net import Forecast, net_of_plans
from activeslam_gym.kernels import compiled, row, uncompiled
from activeslam_gym.motion import GAZE_COUNT, MOTION_COUNT
from activeslam_gym.registry import FOREIGN, asked, name_of, number_of
from activeslam_gym.sensors.sensor import OWN_SENSORS, seen_by
from activeslam_gym.threads import Workers

_LONGEST_HORIZON = 4
_SENSOR_NAMES = tuple(OWN_SENSORS)  # which a part that is no string is none of, whether it has a hash or not


@compiled
def predicted_belief(run: Run) -> PredictedBelief:
    """The predicted belief of a run."""
    if not run.estimate.state.whole:
        write_whole_estimate(run)
    fiducials, clearance = run.world.fiducials, np.full(MOTION_COUNT, np.inf)  # fiducials are known
    if run.models.motion.bodies:
        for index in range(MOTION_COUNT):
            if run.episode.clearance[index] < FARTHEST_CLEARANCE:
                clearance[index] = run.episode.clearance[index]
    models, boxes, first_seen = run.models, known_boxes(run), run.first_seen[: run.estimate.state.count]
    var, limits = models.landmark_var, SensorLimits(models.greatest_change, models.wanted)
    return predicted_belief_of(run.estimate, run.expected, var, fiducials, boxes, clearance, limits, first_seen)


@compiled
def score_runs(
    runs: Run,
    plans: np.ndarray,
    gaze_period: float,
    criterion: int,
    known: np.ndarray,
    out: np.ndarray,
    start: int,
    stop: int,
) -> None:
    """Write the scores of ``plans`` (A, L) for the runs ``start`` … ``stop - 1`` into their rows of ``out``; each has
    its row of ``known`` OPEN_LOOP."""
    for i in range(start, stop):
        run = run_at(runs, i, runs.estimate.covariance[i])
        models, time = run.models, run.episode.steps * gaze_period
        score_plans(models.lens, models.motion, predicted_belief(run), time, plans, criterion, known[i], out[i])


@compiled
def frames_left(run: Run) -> int:
    """Frames to the end of the episode."""
    return (run.models.task.steps - run.episode.steps) * run.models.task.frames_per_step


@compiled
def net_of_runs(runs: Run, plans: np.ndarray, gaze_period: float, out: np.ndarray, start: int, stop: int) -> None:
    """Write the `Forecast` of ``plans`` (A, L) for the runs ``start`` … ``stop - 1``, till they end, into (2, B, A)."""
    for i in range(start, stop):
        run = run_at(runs, i, runs.estimate.covariance[i])
        models, time, left = run.models, run.episode.steps * gaze_period, frames_left(run)
        net_of_plans(models.lens, models.motion, predicted_belief(run), time, left, plans, out[0, i], out[1, i])


class Scores(Runs):
    """The scores of candidate actions; a batch has a leading axis B, a single environment none."""

    def __init__(self, setting: Setting, runs: Run, workers: Workers) -> None:
        super().__init__(setting, runs, workers)
        step, held = int(setting.task.frames_per_step), (self.scenario.gaze_horizon or 0.0) / self.scenario.frame_time
        self._open_loops = np.zeros((len(runs.episode), candidates.MOST_OPEN_LOOPS), candidates.OPEN_LOOP)
        self._motion_frames = step * self.steps_per_motion
        self._motion_plans = candidates.motion_plans(self._motion_frames)
        self._gaze_plans = candidates.gaze_plans(max(step, min(round(held), MOST_HELD_FRAMES)))
        self._joint_plans = candidates.joint_plans(self._motion_frames)

    def motion_scores(self, criterion: str | Criterion = "mutual_information") -> np.ndarray:
        """(7,) what each motion would teach at its clipped goal, gaze STAY; see `information`.

        The covariance is propagated over the motion period from the present estimate, and one set of measurements is
        taken there. In bits for mutual information.

        Raises:
            ValueError: there is no such criterion.
            gymnasium.error.ResetNeeded: no run has begun.
        """
        return self._scores(self._motion_plans, criterion)

    def gaze_scores(self, criterion: str | Criterion = "fisher_trace") -> np.ndarray:
        """(3,) what each turn would teach at the present position; raises as `motion_scores`.

        After one gaze period, or the scenario's ``gaze_horizon``.
        """
        return self._scores(self._gaze_plans, criterion)

    def joint_scores(self, criterion: str | Criterion = "mutual_information") -> np.ndarray:
        """(7, 3) what each motion would teach with each gaze held for its period; raises as `motion_scores`."""
        scores = self._scores(self._joint_plans, criterion)
        return np.swapaxes(scores.reshape(*scores.shape[:-1], GAZE_COUNT, MOTION_COUNT), -1, -2)

    def lookahead_scores(self, horizon: int = 2) -> np.ndarray:
        """(7,) mutual information [bit] of each motion and the best that may follow it, ``horizon`` motions in all.

        Raises:
            ValueError: ``horizon`` is not 1, 2, 3 or 4 (there are 7^horizon sequences).
            gymnasium.error.ResetNeeded: no run has begun.
        """
        if horizon not in range(1, _LONGEST_HORIZON + 1):
            raise ValueError(f"horizon must be a whole number in 1 … {_LONGEST_HORIZON}, got {horizon!r}")
        scores = self._scores(candidates.sequence_plans(self._motion_frames, int(horizon)), "mutual_information")
        return scores.reshape(*scores.shape[:-1], MOTION_COUNT, -1).max(axis=-1)

    def scores(self, plans: np.ndarray, criterion: str | Criterion = "mutual_information") -> np.ndarray:
        """(A,) what each of ``plans`` (A, L) of `information.candidates.ACTION` would teach.

        Raises:
            ValueError: there is no such criterion, motion or gaze, or ``plans`` is no such array; or a foreign
                criterion returns anything but a finite number.
            gymnasium.error.ResetNeeded: no run has begun.
        """
        return self._scores(candidates.checked_plans(plans), criterion)

    def forecast(self, plans: np.ndarray) -> Forecast:
        """(A,) net information [bit] of each of ``plans`` (A, L), and its greatest position deviation [m].

        With measurements on the way; raises as `scores`. The deviation of a foreign sensor is that of the joint
        covariance; with the package's own sensors, errors of features count as independent noise (`net_of_plans`).
        """
        return Forecast(*map(self._given, self._evaluated(candidates.checked_plans(plans), "net_information")))

    def _scores(self, plans: np.ndarray, criterion: str | Criterion) -> np.ndarray:
        return self._given(self._evaluated(plans, criterion)[0])

    def _evaluated(self, plans: np.ndarray, criterion: str | Criterion) -> np.ndarray:
        """(2, B, A) scores of ``plans``, and `Forecast.position_std`, which `score_runs` leaves at 0."""
        number = number_of("criterion", criterion, CRITERIA)
        out, own_sensor = np.zeros((2, len(self._runs.episode), len(plans))), self.scenario.sensor in _SENSOR_NAMES
        if not self._runs.episode["begun"].all():
            raise gymnasium.error.ResetNeeded("there is nothing to score before the first reset()")
        if number == NET and own_sensor:
            self._workers.call(net_of_runs, self._runs, plans, self.gaze_period, out)
        elif number != FOREIGN and own_sensor:
            self._workers.call(score_runs, self._runs, plans, self.gaze_period, number, self._open_loops, out[0])
        else:
            for i in range(out.shape[1]):
                out[:, i] = self._evaluated_in_python(i, plans, criterion)
        return out

    def _evaluated_in_python(self, i: int, plans: np.ndarray, criterion: str | Criterion) -> np.ndarray:
        """(2, A) what `_evaluated` gives run ``i``, with a foreign sensor or by a foreign criterion."""
        run = row(self._runs, i)
        given, lens, time = predicted_belief(run), run.models.lens, int(run.episode.steps) * self.gaze_period
        var, net = float(lens.pixel_std**2), criterion == "net_information"
        if self.scenario.sensor in _SENSOR_NAMES:
            given = candidates.without_present(lens, given) if net else given
            look = partial(candidates.sight_after, lens, given)
        else:
            sensor, what = self._perceptions[i].sensor, f"the sensor {name_of(self.scenario.sensor)!r}"
            if net:
                given = candidates.without_present(lens, given, seen_by(what, sensor, given.camera, given.points))
            where = f" in frame {int(run.world.state.frame)} of environment {i}"
            look = partial(asked, what, partial(sight_by, sensor, given, var), where=where)
        frames = int(uncompiled(frames_left)(run))
        return score_plans_with(look, run.models.motion, given, time, plans, criterion, var, frames)
