"""Sensors and estimators that are not the compiled pair: the frame of a run, called from Python stage by stage.

A frame is control and true motion, measurement, estimation, and data association by the hidden labels. `episode.play`
runs the four in one kernel for the sensor `points` and the estimator `ekf`. Here the middle two belong to a
`Perception`, and the others are the same kernels.
"""

from typing import Any, Protocol

import numpy as np

from activeslam_gym.envs import simulation
from activeslam_gym.envs.episode import BEGIN, REST, conclude, open_step
from activeslam_gym.envs.referee import reconcile
from activeslam_gym.envs.simulation import Run, Setting, begin_motion, close_frame, drive, judge, run_at
from activeslam_gym.kernels import compiled, row
from activeslam_gym.sensors.points import PointModel
from activeslam_gym.sensors.sensor import IMAGES, POINTS, SENSORS
from activeslam_gym.slam.estimate import put_estimate
from activeslam_gym.slam.estimator import EKF, ESTIMATORS, Measurements
from activeslam_gym.world.truth import truth_of


class Perception(Protocol):
    """The sensor and the estimator of one run."""

    def begin(self, runs: Run, i: int) -> None:
        """After a reset: write the prior into the estimate of run ``i``."""

    def frame(self, runs: Run, i: int, u: np.ndarray, contact: bool) -> None:
        """Measure and estimate, with the known accelerations ``u`` (6,); write detections, labels and the estimate, and
        which true landmark each landmark of the estimate stands for."""


def perception_of(setting: Setting, run: Run, prior: tuple[np.ndarray, np.ndarray], key: int) -> Perception:
    """The perception of a run that has just been reset from ``key`` with that ``prior`` of the camera."""
    seed = np.random.SeedSequence(key).spawn(5)[-1]  # the redraws use it, and not its children
    if setting.scenario.sensor == IMAGES:
        from activeslam_gym.envs.images import Eye

        return Eye(setting, run, seed)
    return PluggedPerception(setting, run, prior, seed)


def is_compiled(setting: Setting) -> bool:
    """Whether whole steps run in one kernel."""
    return setting.scenario.sensor == POINTS and setting.scenario.estimator == EKF


def play_rows(
    setting: Setting, runs: Run, perceptions: list[Any], phases: np.ndarray, commands: np.ndarray, start: int, stop: int
) -> None:
    """`episode.play`, with the sensor and the estimator of each run."""
    for i in range(start, stop):
        perception = perceptions[i]
        if phases[i] == BEGIN:
            perception.begin(runs, i)
            begin(runs, i)
        elif phases[i] != REST:
            for frame in range(int(setting.task.frames_per_step)):
                u, contact = move(runs, i, commands[i], frame == 0)
                perception.frame(runs, i, u, contact)
            finish(runs, i)


# The other stages ---------------------------------------------------------------------------------------------------


@compiled
def begin(runs: Run, i: int) -> None:
    """Evaluate run ``i``, which has just been reset."""
    run = run_at(runs, i)
    begin_motion(run, np.zeros(3))
    conclude(run, True)


@compiled
def move(runs: Run, i: int, command: np.ndarray, opens: bool) -> tuple[np.ndarray, bool]:
    """One frame of true motion of run ``i`` under ``command`` (4,); see `simulation.drive`.

    ``opens``: it is the first of a step.
    """
    run = run_at(runs, i)
    if opens:
        open_step(run, command)
    return drive(run, command[3])


@compiled
def sense(runs: Run, i: int) -> None:
    """The detections of the sensor `points`."""
    simulation.sense(run_at(runs, i))


@compiled
def account(runs: Run, i: int) -> None:
    """After the estimator: the data association by the hidden labels."""
    run = run_at(runs, i)
    reconcile(run.owner, run.estimate)
    judge(run)
    close_frame(run)


@compiled
def identify(runs: Run, i: int) -> None:
    """Give the detections their true ids, where the scenario does."""
    simulation.identify(run_at(runs, i))


@compiled
def finish(runs: Run, i: int) -> None:
    """After the frames of a step."""
    conclude(run_at(runs, i), False)


# A registered sensor or estimator -----------------------------------------------------------------------------------


class PluggedPerception:
    """A registered sensor, or the simulated points, with a registered estimator."""

    def __init__(
        self, setting: Setting, run: Run, prior: tuple[np.ndarray, np.ndarray], seed: np.random.SeedSequence
    ) -> None:
        scenario = setting.scenario
        self._kind, self._name, self._dt = scenario.sensor, scenario.estimator, scenario.frame_time
        self._sensor = None if scenario.sensor == POINTS else SENSORS[scenario.sensor](scenario, seed)
        boxes = simulation.known_boxes(run).copy()
        self.model = PointModel(scenario, boxes) if self._sensor is None else self._sensor.model()
        self._estimator = ESTIMATORS[scenario.estimator](scenario, run.world.fiducials.copy(), self.model)
        self._estimator.reset(*prior)

    def begin(self, runs: Run, i: int) -> None:
        """Write the prior."""
        self._put_estimate(row(runs, i))

    def frame(self, runs: Run, i: int, u: np.ndarray, contact: bool) -> None:
        """Measure and estimate."""
        run, values = row(runs, i), self._measured(runs, i)
        self._estimator.predict(u, self._dt, bool(contact))
        noise = np.broadcast_to(self.model.noise, (len(values), *np.shape(self.model.noise)))
        found = run.candidate[: len(values)]
        matched = np.asarray(self._estimator.update(Measurements(values, noise, found["id"].copy())))
        if matched.shape != (len(values),) or matched.dtype.kind not in "iu":
            raise ValueError(
                f"update() of the estimator {self._name!r} must return ({len(values)},) whole numbers, got {matched!r}"
            )
        found["match"] = matched
        before = set(run.owner["id"].tolist()) - {0}
        self._put_estimate(run)
        after = set(run.estimate.landmark["id"][: int(run.estimate.state.count)].tolist())
        run.episode.events.births += len(after - before)
        run.episode.events.deletions += len(before - after)
        account(runs, i)

    def _put_estimate(self, run: Run) -> None:
        """Write the estimator's estimate into the run.

        Raises:
            ValueError: it is none, or not finite; the message names the estimator.
        """
        try:
            estimate = self._estimator.estimate()
            put_estimate(estimate, run.estimate)
        except (AttributeError, ValueError) as error:
            raise ValueError(f"estimate() of the estimator {self._name!r}: {error}") from error
        for name in ("camera", "points", "covariance"):
            if not np.isfinite(getattr(estimate, name)).all():
                raise ValueError(f"estimate() of the estimator {self._name!r} must have a finite {name}")

    def _measured(self, runs: Run, i: int) -> np.ndarray:
        """(M, d) the measurements; writes their pixels, labels and, where the scenario gives them, ids."""
        run = row(runs, i)
        if self._sensor is None:
            sense(runs, i)
            return run.candidate["pixel"][: int(run.episode.detections)].copy()
        time = (int(run.world.state.frame) + 1) * self._dt
        values, labels = (np.asarray(part) for part in self._sensor.measure(truth_of(run.world), time))
        size, room = len(self.model.noise), len(run.candidate)
        if values.shape != (len(labels), size) or not np.isfinite(values).all() or len(labels) > room:
            raise ValueError(
                f"measure() of the sensor {self._kind!r} must return (M, {size}) finite values, M at most {room}, "
                f"and (M,) labels, got {values!r} and {labels!r}"
            )
        run.episode.detections = len(values)
        run.candidate["pixel"][: len(values)], run.label[: len(values)] = values[:, :2], labels
        run.candidate["R"][: len(values)] = np.asarray(self.model.noise)[:2, :2]
        identify(runs, i)
        return values
