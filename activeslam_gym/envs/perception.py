"""The step in Python, in which foreign scenes, sensors and estimators run: the reference of the compiled `step.step`.

A `Perception` is the sensor and the estimator of a run; the rest are the functions of which the kernel is made.
"""

import numpy as np

from activeslam_gym.envs.reset import Start, box_scene
from activeslam_gym.envs.run import Run, known_boxes, write_whole_estimate
from activeslam_gym.envs.step import (
    BEGIN,
    REST,
    estimate_and_judge,
    evaluate_and_observe,
    identify,
    judge,
    measure,
    read_command,
    sense_clearance,
    simulate,
)
from activeslam_gym.kernels import row, uncompiled
from activeslam_gym.motion import CAMERA_DIM, POSITION, QUATERNION
from activeslam_gym.registry import array_of, asked, name_of, part_of
from activeslam_gym.sensors.points import PointSensor
from activeslam_gym.sensors.sensor import OWN_SENSORS, POINTS, measured, noise_of, seen_by
from activeslam_gym.slam.detection import REJECTED
from activeslam_gym.slam.ekf import ESTIMATORS, Ekf
from activeslam_gym.slam.estimate import Estimate, Measurements, put_estimate
from activeslam_gym.slam.sight import PREDICTED, Sight, sight_of_belief, sight_with
from activeslam_gym.world.bodies import drop_hidden, narrow_clearance, push_out, reach_of_command
from activeslam_gym.world.scenes import Scene
from activeslam_gym.world.truth import truth_of

_ROUNDING = 1e-5  # of what estimators and sensors answer, which may be in single precision


class Perception:
    """The scene, the sensor and the estimator of one run."""

    scene: Scene | None = None
    """The foreign scene; None: the boxes of the world's arrays."""

    def begin(self, run: Run) -> None:
        """After a reset: write the prior into the estimate."""
        write_whole_estimate(run)

    def step(self, run: Run, command: np.ndarray) -> None:
        """`step.step` with these parts."""
        scene, task, reach = self.scene, run.models.task, np.inf
        if scene is not None and run.episode.steps % task.steps_per_motion == 0:
            reach = reach_of_command(scene, run.models.motion, run.world, command)
        read_command(run, command, reach)
        for _ in range(int(task.frames_per_step)):
            u, contact = simulate_in(scene, run, command[3])
            self.frame(run, u, contact)
        run.episode.steps += 1
        sense_clearance_in(scene, run)
        evaluate_and_observe(run, False)

    def frame(self, run: Run, u: np.ndarray, contact: bool) -> None:
        """After the camera has moved under the known accelerations ``u`` (6,): measure, estimate and judge."""
        raise NotImplementedError

    def predicted(self, run: Run) -> Sight:
        """The filter's predicted measurements at its present estimate."""
        return sight_of_belief(run.models.lens, run.ekf, run.world.fiducials, uncompiled(known_boxes)(run))


def step_runs_in_python(
    runs: Run, perceptions: np.ndarray, orders: np.ndarray, commands: np.ndarray, start: int, stop: int
) -> None:
    """`step.step_runs`, with the scene, the sensor and the estimator of each run; a ValueError names the frame."""
    for i in range(start, stop):
        try:
            if orders[i] == BEGIN:
                begin(row(runs, i), perceptions[i])
            elif orders[i] != REST:
                perceptions[i].step(row(runs, i), commands[i])
        except ValueError as error:
            where = f"in frame {int(runs.world.state[i].frame)} of environment {i}"
            raise ValueError(f"{error} ({where})") from error.__cause__


def begin(run: Run, parts: Perception) -> None:
    """`step.begin` with the ``parts`` of a run."""
    parts.begin(run)
    sense_clearance_in(parts.scene, run)
    evaluate_and_observe(run, True)


def simulate_in(scene: Scene | None, run: Run, gaze: float) -> tuple[np.ndarray, bool]:
    """`step.simulate` in a foreign ``scene``, whose bodies stop the camera."""
    start = run.world.state.camera[POSITION].copy()
    u, contact = simulate(run, gaze)
    if scene is not None:
        contacts = push_out(scene, run.models.motion, run.world, start)
        run.episode.events.wall_contacts += contacts
        contact = contact or contacts > 0
    return u, bool(contact)


def measure_in(scene: Scene | None, run: Run) -> bool:
    """`step.measure` in a foreign ``scene``, whose bodies hide points."""
    labelled = bool(measure(run))
    if scene is not None:
        detections = int(run.episode.detection_count)
        run.episode.detection_count = drop_hidden(scene, run.world, run.detections, run.label, detections)
    return labelled


def sense_clearance_in(scene: Scene | None, run: Run) -> None:
    """`step.sense_clearance` in a foreign ``scene``."""
    if run.models.motion.bodies:
        sense_clearance(run)
    if scene is not None:
        narrow_clearance(scene, run.models.motion, run.world, run.episode.clearance)


class PointPerception(Perception):
    """The simulated points and a compiled estimator, in a foreign ``scene``."""

    def __init__(self, scene: Scene | None) -> None:
        self.scene = scene

    def frame(self, run: Run, u: np.ndarray, contact: bool) -> None:
        """Measure what the scene does not hide, and run the compiled filter."""
        ends = (run.world.state.frame + 1) % run.models.task.frames_per_step == 0
        estimate_and_judge(run, u, contact, measure_in(self.scene, run), bool(ends))


class PythonPerception(Perception):
    """A foreign sensor, or the simulated points, with any estimator. What they answer is checked here."""

    def __init__(self, run: Run, start: Start, seed: np.random.SeedSequence) -> None:
        scenario, self.scene = start.scenario, start.scene
        self._sensed = f"the sensor {name_of(scenario.sensor)!r}"
        self._name = f"the estimator {name_of(scenario.estimator)!r}"
        boxes, fiducials = uncompiled(known_boxes)(run).copy(), run.world.fiducials.copy()
        self._dt = scenario.frame_time
        self._simulated = scenario.sensor == POINTS
        make_sensor = PointSensor if self._simulated else part_of("scenario.sensor", scenario.sensor, OWN_SENSORS)
        self.sensor = asked(self._sensed, make_sensor, scenario, seed)
        if hasattr(self.sensor, "boxes"):
            self.sensor.boxes = boxes
        self._noise = noise_of(self._sensed, self.sensor)
        make = part_of("scenario.estimator", scenario.estimator, ESTIMATORS)
        self._estimator = asked(self._name, make, scenario, fiducials, self.sensor)
        asked(f"reset() of {self._name}", lambda: self._estimator.reset(start.mean, start.covariance))

    def begin(self, run: Run) -> None:
        """Write the prior."""
        self._put_estimate(run, np.zeros(0, int))

    def frame(self, run: Run, u: np.ndarray, contact: bool) -> None:
        """Ask the sensor and the estimator, and judge."""
        values, of = self._measured(run), self._name
        asked(f"predict() of {of}", lambda: self._estimator.predict(u, self._dt, contact))
        found = run.detections[: len(values)]
        noise = np.broadcast_to(self._noise, (len(values), *self._noise.shape))
        measurements = Measurements(values, noise, found["id"].copy())
        matched = asked(f"update() of {of}", lambda: self._estimator.update(measurements))
        found["match"] = array_of(f"what update() of {of} returns", matched, (len(values),), int)
        events = run.episode.events
        if isinstance(self._estimator, Ekf):  # which counts what another one does not
            for name in ("conversions", "restarts", "rejected_matches"):
                events[name] += self._estimator.counts[name]
                self._estimator.counts[name] = 0
        else:
            events.rejected_matches += np.count_nonzero(found["match"] == REJECTED)
        self._put_estimate(run, found["match"])
        if run.models.negative_information and not self._simulated:
            seen = seen_by(self._sensed, self.sensor, run.estimate.state.camera, run.expected["point"])
            run.expected["hidden"] = ~seen
        judge(run)

    def predicted(self, run: Run) -> Sight:
        """Those of the built-in filter, by the sensor; none of another estimator, whose predictions are its own."""
        if isinstance(self._estimator, Ekf):
            return self._estimator.predicted()
        return sight_with(np.zeros(0, PREDICTED), np.eye(CAMERA_DIM), CAMERA_DIM)

    def _put_estimate(self, run: Run, matched: np.ndarray) -> None:
        """Write the estimator's estimate into the run. Every id must be of a fiducial or of a landmark of it, and every
        new landmark of a measurement that it was ``matched`` to."""
        before, what, K = set(run.owner["id"].tolist()) - {0}, f"estimate() of {self._name}", len(run.world.fiducials)
        estimate = asked(what, lambda: self._estimator.estimate())
        if not isinstance(estimate, Estimate):
            raise ValueError(f"{what} must return an Estimate, got {estimate!r:.300}")
        asked(what, put_estimate, estimate, run.estimate)
        for name in ("camera", "points", "covariance"):
            if not np.isfinite(getattr(estimate, name)).all():
                raise ValueError(f"{what} must have a finite {name}")
        P, size = estimate.covariance, np.sqrt(np.abs(np.diag(estimate.covariance)))
        if abs(np.linalg.norm(estimate.camera[QUATERNION]) - 1.0) > _ROUNDING:
            raise ValueError(f"{what} must have a quaternion of length 1, got {estimate.camera[QUATERNION]}")
        if (np.abs(P - P.T) > _ROUNDING * np.outer(size, size)).any():
            raise ValueError(f"{what} must have a symmetric covariance")
        after, given = set(estimate.ids.tolist()), set(matched.tolist())
        if nothing := given - before - after - set(range(-K, 1)) - {REJECTED}:
            raise ValueError(f"update() of {self._name} returned ids of no landmark and no fiducial: {sorted(nothing)}")
        if unmatched := after - before - given:
            raise ValueError(f"{what} has new landmarks, but update() returned none of their ids: {sorted(unmatched)}")
        run.episode.events.initialised += len(after - before)
        run.episode.events.deletions += len(before - after)

    def _measured(self, run: Run) -> np.ndarray:
        """(M, d) the measurements; writes their pixels, labels and, where the scenario gives them, ids."""
        if self._simulated:
            measure_in(self.scene, run)
            return run.detections["pixel"][: int(run.episode.detection_count)].copy()
        time, truth = (int(run.world.state.frame) + 1) * self._dt, truth_of(run.world, self.scene or box_scene(run))
        values, labels = measured(self._sensed, self.sensor, truth, time, len(self._noise))
        if len(values) > (room := len(run.detections)):
            raise ValueError(f"measure() of {self._sensed} must return at most {room} values, got {len(values)}")
        run.episode.detection_count = len(values)
        run.detections["pixel"][: len(values)], run.label[: len(values)] = values[:, :2], labels
        run.detections["R"][: len(values)] = self._noise[:2, :2]
        uncompiled(identify)(run)
        return values
