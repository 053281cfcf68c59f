"""Registered scenes, sensors and estimators: the frame of a run, called from Python stage by stage.

A frame is control and true motion, measurement, estimation, and data association by the hidden labels. `episode.play`
runs the four in one kernel for the scene `boxes`, the sensor `points` and the estimator `ekf`. Here the middle two
belong to a `Perception`, and the others are the same kernels; a registered scene is asked between them.
"""

from typing import Any, Protocol

import numpy as np

from activeslam_gym.envs import simulation
from activeslam_gym.envs.episode import BEGIN, REST, appraise, observe, open_step, sense_clearance
from activeslam_gym.envs.referee import reconcile
from activeslam_gym.envs.simulation import (
    Run,
    Setting,
    Start,
    begin_motion,
    box_scenes,
    close_frame,
    complete,
    drive,
    judge,
    run_at,
)
from activeslam_gym.kernels import compiled, row
from activeslam_gym.motion import POSITION
from activeslam_gym.sensors.points import PointModel
from activeslam_gym.sensors.sensor import IMAGES, POINTS, SENSORS
from activeslam_gym.slam.estimate import put_estimate
from activeslam_gym.slam.estimator import EKF, ESTIMATORS, Measurements
from activeslam_gym.world.bodies import drop_hidden, narrow_clearance, push_out, reach_of_command
from activeslam_gym.world.scenes import Scene
from activeslam_gym.world.truth import truth_of


class Perception(Protocol):
    """The scene, the sensor and the estimator of one run."""

    scene: Scene | None
    """The registered scene; None: the boxes of the world's arrays."""

    def begin(self, runs: Run, i: int) -> None:
        """After a reset: write the prior into the estimate of run ``i``."""

    def frame(self, runs: Run, i: int, u: np.ndarray, contact: bool) -> None:
        """Measure and estimate, with the known accelerations ``u`` (6,); write detections, labels and the estimate, and
        which true landmark each landmark of the estimate stands for."""


def perception_of(setting: Setting, run: Run, start: Start, key: int) -> Perception:
    """The perception of a run that has just been reset from ``key`` to that ``start``."""
    seed = np.random.SeedSequence(key).spawn(5)[-1]  # the redraws use it, and not its children
    if setting.scenario.sensor == IMAGES:
        from activeslam_gym.envs.images import Eye

        return Eye(setting, run, seed)
    if setting.scenario.sensor == POINTS and setting.scenario.estimator == EKF:
        return PointPerception(start.scene)
    return PluggedPerception(setting, run, start, seed)


def is_compiled(setting: Setting) -> bool:
    """Whether whole steps run in one kernel."""
    scenario = setting.scenario
    return scenario.sensor == POINTS and scenario.estimator == EKF and not scenario.has_registered_scene


def play_rows(
    setting: Setting, runs: Run, perceptions: list[Any], phases: np.ndarray, commands: np.ndarray, start: int, stop: int
) -> None:
    """`episode.play`, with the scene, the sensor and the estimator of each run."""
    for i in range(start, stop):
        perception = perceptions[i]
        if phases[i] == REST:
            continue
        if phases[i] == BEGIN:
            perception.begin(runs, i)
            begin(runs, i)
        else:
            _open(perception.scene, runs, i, commands[i])
            for _ in range(int(setting.task.frames_per_step)):
                u, contact = _move(perception.scene, runs, i, commands[i, 3])
                perception.frame(runs, i, u, contact)
        finish(runs, i, phases[i] == BEGIN)
        if perception.scene is not None:
            run = row(runs, i)
            narrow_clearance(perception.scene, run.models.motion, run.world, run.episode.clearance)
        show(runs, i)


def _open(scene: Scene | None, runs: Run, i: int, command: np.ndarray) -> None:
    """Begin a step; its motion stops short of what the scene has in its way."""
    run, reach = row(runs, i), np.inf
    if scene is not None and int(run.episode.steps) % int(run.models.task.steps_per_motion) == 0:
        reach = reach_of_command(scene, run.models.motion, run.world, command)
    open_at(runs, i, command, reach)


def _move(scene: Scene | None, runs: Run, i: int, gaze: float) -> tuple[np.ndarray, bool]:
    """One frame of true motion; see `simulation.drive`."""
    run = row(runs, i)
    start = run.world.state.camera[POSITION].copy()
    u, contact = move(runs, i, gaze)
    if scene is not None:
        contacts = push_out(scene, run.models.motion, run.world, start)
        run.episode.events.wall_contacts += contacts
        contact = contact or contacts > 0
    return u, contact


def _sense(scene: Scene | None, runs: Run, i: int) -> bool:
    """The detections of the sensor `points`; whether their ids are the true ones."""
    labelled, run = sense(runs, i), row(runs, i)
    if scene is not None:
        detections = int(run.episode.detections)
        run.episode.detections = drop_hidden(scene, run.world, run.candidate, run.label, detections)
    return bool(labelled)


# The other stages ---------------------------------------------------------------------------------------------------


@compiled
def begin(runs: Run, i: int) -> None:
    """Run ``i``, which has just been reset, stays where it is."""
    begin_motion(run_at(runs, i, runs.estimate.covariance[i]), np.zeros(3), np.inf)


@compiled
def open_at(runs: Run, i: int, command: np.ndarray, reach: float) -> None:
    """`episode.open_step`."""
    open_step(run_at(runs, i, runs.estimate.covariance[i]), command, reach)


@compiled
def move(runs: Run, i: int, gaze: float) -> tuple[np.ndarray, bool]:
    """One frame of true motion of run ``i``; see `simulation.drive`."""
    return drive(run_at(runs, i, runs.estimate.covariance[i]), gaze)


@compiled
def sense(runs: Run, i: int) -> bool:
    """The detections of the sensor `points`; whether their ids are the true ones."""
    return simulation.sense(run_at(runs, i, runs.estimate.covariance[i]))


@compiled
def take_in(runs: Run, i: int, u: np.ndarray, contact: bool, labelled: bool) -> None:
    """The estimator `ekf`; see `simulation.take_in`."""
    run = run_at(runs, i, runs.estimate.covariance[i])
    ends = (run.world.state.frame + 1) % run.models.task.frames_per_step == 0
    simulation.take_in(run, u, contact, labelled, ends)


@compiled
def account(runs: Run, i: int) -> None:
    """After the estimator: the data association by the hidden labels."""
    run = run_at(runs, i, runs.estimate.covariance[i])
    reconcile(run.owner, run.estimate)
    judge(run)
    close_frame(run)


@compiled
def identify(runs: Run, i: int) -> None:
    """Give the detections their true ids, where the scenario does."""
    simulation.identify(run_at(runs, i, runs.estimate.covariance[i]))


@compiled
def finish(runs: Run, i: int, begins: bool) -> None:
    """After the frames of a step: what they were worth, and the range finders before the scene narrows them."""
    run = run_at(runs, i, runs.estimate.covariance[i])
    appraise(run, begins)
    sense_clearance(run)


@compiled
def show(runs: Run, i: int) -> None:
    """Write the observation."""
    observe(run_at(runs, i, runs.estimate.covariance[i]))


# Perceptions --------------------------------------------------------------------------------------------------------


class PointPerception:
    """The simulated points and the estimator `ekf`, in a registered ``scene``."""

    def __init__(self, scene: Scene | None) -> None:
        self.scene = scene

    def begin(self, runs: Run, i: int) -> None:
        """Write the prior."""
        complete(runs, i, i + 1)

    def frame(self, runs: Run, i: int, u: np.ndarray, contact: bool) -> None:
        """Measure and estimate."""
        take_in(runs, i, u, bool(contact), _sense(self.scene, runs, i))


class PluggedPerception:
    """A registered sensor, or the simulated points, with a registered estimator."""

    def __init__(self, setting: Setting, run: Run, start: Start, seed: np.random.SeedSequence) -> None:
        scenario, self.scene = setting.scenario, start.scene
        self._kind, self._name, self._dt = scenario.sensor, scenario.estimator, scenario.frame_time
        self._sensor = None if scenario.sensor == POINTS else SENSORS[scenario.sensor](scenario, seed)
        boxes = simulation.known_boxes(run).copy()
        self.model = PointModel(scenario, boxes) if self._sensor is None else self._sensor.model()
        self._estimator = ESTIMATORS[scenario.estimator](scenario, run.world.fiducials.copy(), self.model)
        self._estimator.reset(start.mean, start.covariance)

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
            _sense(self.scene, runs, i)
            return run.candidate["pixel"][: int(run.episode.detections)].copy()
        time = (int(run.world.state.frame) + 1) * self._dt
        truth = truth_of(run.world, self.scene or box_scenes(row(runs, slice(i, i + 1)))[0])
        values, labels = (np.asarray(part) for part in self._sensor.measure(truth, time))
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
