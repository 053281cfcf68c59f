"""Registered scenes, sensors and estimators: the frame of a run, called from Python stage by stage.

A frame is control and true motion, measurement, estimation, and data association by the hidden labels. `episode.play`
runs the four in one kernel for the scene `boxes`, the sensor `points` and the compiled estimators. Here the middle two
belong to a `Perception`, and the others are the same kernels; a registered scene is asked between them.
"""

from typing import Any, Protocol

import numpy as np

from activeslam_gym.envs.episode import BEGIN, REST, appraise, observe, open_step
from activeslam_gym.envs.run import Run, known_boxes, present
from activeslam_gym.envs.setting import Setting
from activeslam_gym.envs.simulation import Start, account, begin_motion, box_scene, drive, identify, sense, take_in
from activeslam_gym.kernels import row
from activeslam_gym.motion import POSITION
from activeslam_gym.sensors.points import PointModel
from activeslam_gym.sensors.sensor import CORNERS, IMAGES, POINTS, SENSORS
from activeslam_gym.slam.estimate import put_estimate
from activeslam_gym.slam.estimator import COMPILED, ESTIMATORS, Measurements
from activeslam_gym.world.bodies import drop_hidden, narrow_clearance, push_out, reach_of_command
from activeslam_gym.world.scenes import Scene
from activeslam_gym.world.truth import truth_of


class Perception(Protocol):
    """The scene, the sensor and the estimator of one run."""

    scene: Scene | None
    """The registered scene; None: the boxes of the world's arrays."""

    def begin(self, run: Run) -> None:
        """After a reset: write the prior into the estimate."""

    def frame(self, run: Run, u: np.ndarray, contact: bool) -> None:
        """Measure and estimate, with the known accelerations ``u`` (6,).

        Writes detections, labels, the estimate, and the true landmark of each landmark of the estimate.
        """


def perception_of(setting: Setting, run: Run, start: Start, key: int) -> Perception:
    """The perception of a run that has just been reset from ``key`` to that ``start``."""
    seed = np.random.SeedSequence(key).spawn(5)[-1]  # the redraws use it, and not its children
    if setting.scenario.sensor == IMAGES:
        from activeslam_gym.envs.images import Eye

        return Eye(setting, run, start.mean[:7], seed)
    if setting.scenario.sensor == CORNERS:
        from activeslam_gym.envs.corners import Glance

        return Glance(setting, run, start.mean[:7], seed)
    if setting.scenario.sensor == POINTS and setting.scenario.estimator in COMPILED:
        return PointPerception(start.scene)
    return PluggedPerception(setting, run, start, seed)


def is_compiled(setting: Setting) -> bool:
    """Whether whole steps run in one kernel."""
    scenario = setting.scenario
    return scenario.sensor == POINTS and scenario.estimator in COMPILED and not scenario.has_registered_scene


def play_rows(
    runs: Run, perceptions: list[Any], phases: np.ndarray, commands: np.ndarray, start: int, stop: int
) -> None:
    """`episode.play`, with the scene, the sensor and the estimator of each run."""
    for i in range(start, stop):
        if phases[i] == REST:
            continue
        run, perception = row(runs, i), perceptions[i]
        scene, motion, task = perception.scene, run.models.motion, run.models.task
        if phases[i] == BEGIN:
            perception.begin(run)
            begin_motion(run, commands[i], np.inf)
        else:
            reads = scene is not None and run.episode.steps % task.steps_per_motion == 0
            reach = reach_of_command(scene, motion, run.world, commands[i]) if reads else np.inf
            open_step(run, commands[i], reach)
            for _ in range(int(task.frames_per_step)):
                perception.frame(run, *_move(scene, run, commands[i, 3]))
        appraise(run, bool(phases[i] == BEGIN))
        if scene is not None:
            narrow_clearance(scene, motion, run.world, run.episode.clearance)
        observe(run)


def _move(scene: Scene | None, run: Run, gaze: float) -> tuple[np.ndarray, bool]:
    """One frame of true motion; see `simulation.drive`."""
    start = run.world.state.camera[POSITION].copy()
    u, contact = drive(run, gaze)
    if scene is not None:
        contacts = push_out(scene, run.models.motion, run.world, start)
        run.episode.events.wall_contacts += contacts
        contact = contact or contacts > 0
    return u, bool(contact)


def _sense(scene: Scene | None, run: Run) -> bool:
    """The detections of the sensor `points`; whether their ids are the true ones."""
    labelled = bool(sense(run))
    if scene is not None:
        detections = int(run.episode.detections)
        run.episode.detections = drop_hidden(scene, run.world, run.candidate, run.label, detections)
    return labelled


class PointPerception:
    """The simulated points and a compiled estimator, in a registered ``scene``."""

    def __init__(self, scene: Scene | None) -> None:
        self.scene = scene

    def begin(self, run: Run) -> None:
        """Write the prior."""
        present(run)

    def frame(self, run: Run, u: np.ndarray, contact: bool) -> None:
        """Measure and estimate."""
        ends = (run.world.state.frame + 1) % run.models.task.frames_per_step == 0
        take_in(run, u, contact, _sense(self.scene, run), bool(ends))


class PluggedPerception:
    """A registered sensor, or the simulated points, with a registered estimator."""

    def __init__(self, setting: Setting, run: Run, start: Start, seed: np.random.SeedSequence) -> None:
        scenario, self.scene = setting.scenario, start.scene
        self._kind, self._name, self._dt = scenario.sensor, scenario.estimator, scenario.frame_time
        self._sensor = None if scenario.sensor == POINTS else SENSORS[scenario.sensor](scenario, seed)
        boxes = known_boxes(run).copy()
        self.model = PointModel(scenario, boxes) if self._sensor is None else self._sensor.model()
        self._estimator = ESTIMATORS[scenario.estimator](scenario, run.world.fiducials.copy(), self.model)
        self._estimator.reset(start.mean, start.covariance)

    def begin(self, run: Run) -> None:
        """Write the prior."""
        self._put_estimate(run)

    def frame(self, run: Run, u: np.ndarray, contact: bool) -> None:
        """Measure and estimate."""
        values = self._measured(run)
        self._estimator.predict(u, self._dt, contact)
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
        account(run)

    def _put_estimate(self, run: Run) -> None:
        """Write the estimator's estimate into the run; a ValueError names the estimator where it is none."""
        try:
            estimate = self._estimator.estimate()
            put_estimate(estimate, run.estimate)
        except (AttributeError, ValueError) as error:
            raise ValueError(f"estimate() of the estimator {self._name!r}: {error}") from error
        for name in ("camera", "points", "covariance"):
            if not np.isfinite(getattr(estimate, name)).all():
                raise ValueError(f"estimate() of the estimator {self._name!r} must have a finite {name}")

    def _measured(self, run: Run) -> np.ndarray:
        """(M, d) the measurements; writes their pixels, labels and, where the scenario gives them, ids."""
        if self._sensor is None:
            _sense(self.scene, run)
            return run.candidate["pixel"][: int(run.episode.detections)].copy()
        time = (int(run.world.state.frame) + 1) * self._dt
        truth = truth_of(run.world, self.scene or box_scene(run))
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
        identify(run)
        return values
