"""What might come: runs played ahead from what is believed, for policies that plan.

An imagined run begins with a copy of the belief, in a room drawn from it: the camera and the features stand where
N(mean, P) has them, and the landmarks that no feature stands for where a reset of the scenario might put them and none
was found by looking. Its noise is its own. Nothing of the truth enters: neither true places nor labels, nor the stream
of noise that the real run will meet, nor boxes that the belief does not know (others are drawn), nor what is wrong with
the calibration.

It is the environment's own simulation, made cheap by longer frames with as much noise in a second (see `slowed`). Its
detections are unlabelled, so that what is bad for the matching is bad in it too.
"""

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from activeslam_gym.camera import View, visible
from activeslam_gym.envs.context import TIME_LEFT, context_of, time_left
from activeslam_gym.envs.disproof import WELL_INSIDE_PX
from activeslam_gym.envs.episode import REST, STEP, play
from activeslam_gym.envs.referee import NOBODY
from activeslam_gym.envs.run import Run, known_boxes
from activeslam_gym.envs.simulation import empty_runs
from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.kernels import Record, row
from activeslam_gym.motion import COMMANDS, POSITION, QUATERNION
from activeslam_gym.slam.draws import count_in_longer_frames, drawn_from
from activeslam_gym.slam.estimate import taken_estimate
from activeslam_gym.slam.estimator import COMPILED
from activeslam_gym.threads import Workers, for_one_thread
from activeslam_gym.world.room import draw_room
from activeslam_gym.world.simulator import CLUTTER_LABEL

LONGEST_FRAME = 0.1  # imagined frames are at most so long [s]
LOOK_PERIOD = 0.25  # places where a landmark may be are looked at so often [s]
OVERLOOKED = 0.1  # chance that a landmark in view of a look gets no feature
PLACES = 600  # places in the room where a landmark may be; two for each landmark, where that is more
LEAST_CHANCE = 1e-9  # of a place, against all others
CLEAR = 0.1  # a box that is drawn is so far from the camera and from features, at least [m]
ROWS = 32  # runs played at a time


DECIDED = -1
"""In a plan: an action that a policy chooses when its time has come."""

Decide = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""A policy: observations (R, D) and contexts (R, C) -> actions (R, 2)."""


class Outcome(NamedTuple):
    """The ends of R imagined runs."""

    entropy: np.ndarray
    """(R,) of the belief [bit]."""
    log_density: np.ndarray
    """(R,) log2 N(imagined truth | belief) [bit]."""


@for_one_thread
class Imagination:
    """Imagined futures of environment ``i`` of ``env``; a single environment is its own 0th.

    Call `look` at every step from the reset on, `draw` at the start of a motion period, then `play` plans in the rooms
    that were drawn. ``seed``: of all draws, which differ in each episode. ``threads`` share the runs (None: one
    for each core).

    Raises:
        ValueError: the scenario's estimator is not compiled.
    """

    def __init__(self, env: Any, i: int = 0, seed: int = 0, threads: int | None = None) -> None:
        if env.scenario.estimator not in COMPILED:
            allowed = ", ".join(COMPILED)
            raise ValueError(f"imagined runs need scenario.estimator of {allowed}, got {env.scenario.estimator!r}")
        self._env, self._i, self._seed = env, i, seed
        self._batch = empty_runs(env.scenario, ROWS)
        self._workers = Workers(ROWS, threads, env._workers.alone)
        self._rooms = empty_runs(env.scenario, 0)
        self._rng = np.random.default_rng(seed)
        self._places, self._chances = np.zeros((0, 3)), np.zeros(0)
        self._looked_at = -math.inf

    @property
    def possible(self) -> bool:
        """Whether there is a belief to draw rooms from: one whose numbers are finite."""
        estimate = taken_estimate(self._own().estimate)
        return all(np.isfinite(part).all() for part in (estimate.camera, estimate.points, estimate.covariance))

    @property
    def periods(self) -> int:
        """Motion periods from the present to the end of the episode."""
        own = self._own()
        return math.ceil((own.models.task.steps - own.episode.steps) / own.models.task.steps_per_motion)

    def look(self) -> None:
        """Take note of what is in view now: where a landmark would have been found, there is hardly one."""
        run = self._own()
        time = int(run.episode.steps) * self._env.gaze_period
        if time == 0.0 or not len(self._places):
            self._begin(run)
        if time < self._looked_at + LOOK_PERIOD - 1e-9:
            return
        self._looked_at = time
        pose, z = run.estimate.state.camera, np.empty(2)
        view = View(run.models.camera, pose, rotation_matrix(pose[QUATERNION]), known_boxes(run))
        seen = np.array([visible(view, place, -WELL_INSIDE_PX, z) for place in self._places])
        self._chances[seen] *= OVERLOOKED
        self._chances = np.maximum(self._chances / self._chances.max(), LEAST_CHANCE)

    def draw(self, count: int) -> None:
        """Draw ``count`` rooms from the present belief.

        Raises:
            ValueError: a motion is under way, while plans begin with a motion of their own.
        """
        run = self._own()
        if run.episode.steps % run.models.task.steps_per_motion:
            raise ValueError("plans are imagined from the start of a motion period; a motion is under way")
        self.look()
        models, stride = slowed(run.models)
        self._rooms = empty_runs(self._env.scenario, count)
        self._rooms.models[:] = models
        self._rooms.candidate["R"] = models.camera.pixel_std**2 * np.eye(2)
        own = slice(self._i, self._i + 1)
        _copy(row(self._env._runs.ekf, own), self._rooms.ekf)
        _copy(row(self._env._runs.estimate, own), self._rooms.estimate)
        self._rooms.observation[:] = run.observation
        for m in range(count):
            self._furnish(run, row(self._rooms, m), stride)

    def play(self, rooms: Sequence[int] | np.ndarray, plans: np.ndarray, decide: Decide | None = None) -> Outcome:
        """Play ``plans`` (R, T, 2), an action for each motion period, each in that of the ``rooms`` (R,) drawn.

        Where an action of a plan is `DECIDED`, ``decide`` chooses one.
        """
        rooms, entropy, density = np.asarray(rooms), np.empty(len(plans)), np.empty(len(plans))
        for start in range(0, len(plans), ROWS):
            part = slice(start, start + ROWS)
            end = self._played(rooms[part], np.asarray(plans[part], np.int64), decide)
            entropy[part], density[part] = end["entropy"], end["log_density"]
        return Outcome(entropy, density)

    def decided(self, decide: Decide) -> np.ndarray:
        """(2,) what ``decide`` chooses at present."""
        return decide(self._own().observation[None], self._context())[0]

    def _played(self, rooms: np.ndarray, plans: np.ndarray, decide: Decide | None) -> np.ndarray:
        """(R,) EVALUATION at the end of at most ROWS runs."""
        at = np.arange(len(plans)) * ROWS // len(plans)  # spread over the threads
        _copy(self._rooms, self._batch, rooms, at)
        phases, commands = np.full(ROWS, REST), np.zeros((ROWS, 4))
        phases[at] = STEP
        contexts = np.tile(self._context(), (len(at), 1)) if decide else np.empty(0)
        for actions in plans.transpose(1, 0, 2):
            if decide and (actions == DECIDED).any():
                contexts[:, TIME_LEFT] = time_left(self._batch, self._env.duration)[at]
                actions = np.where(actions == DECIDED, decide(self._batch.observation[at], contexts), actions)
            commands[at] = COMMANDS[actions[:, 0], actions[:, 1]]
            self._workers.call(play, self._batch, phases, commands)
        return self._batch.episode["evaluation"][at]

    def _context(self) -> np.ndarray:
        """(1, C) the context of the environment; long frames have other noise than it says."""
        return context_of(row(self._env._runs, slice(self._i, self._i + 1)), self._env.duration)

    def _own(self) -> Run:
        return self._env._at(self._i)

    def _begin(self, run: Run) -> None:
        """Of a new episode: landmarks may be wherever a reset would put them in a room of this size."""
        self._rng = np.random.default_rng(self._seed)
        size = tuple((2.0 * run.models.motion.half).tolist())
        scenario = dataclasses.replace(self._env.scenario, varied=(), room_size=size)
        if scenario.boxes_known:
            boxes = tuple((tuple(low), tuple(high)) for low, high in known_boxes(run).tolist())
            scenario = dataclasses.replace(scenario, boxes=boxes, box_count=(0, 0), inner_walls=(0, 0))
        rooms = math.ceil(max(PLACES, 2 * len(run.expected)) / len(run.expected))
        self._drawn = [draw_room(scenario, self._rng) for _ in range(rooms)]
        self._places = np.concatenate([room.landmarks for room in self._drawn])
        self._chances = np.ones(len(self._places))
        self._looked_at = -math.inf

    def _furnish(self, run: Run, room: Run, stride: int) -> None:
        """Make ``room``, which has the belief of ``run``, one that may be; the run's truth is not read."""
        task = run.models.task
        room.expected[:], room.viewpoint[:], room.owner[:] = run.expected, run.viewpoint, run.owner
        room.episode.views, room.episode.steps = run.episode.views, run.episode.steps // task.steps_per_motion
        room.episode.redraw_key[:] = self._rng.integers(2**63)
        world = room.world
        world.state.noise_key[:] = self._rng.integers(2**63)
        world.fiducials[:] = run.world.fiducials  # which are known
        world.state.camera[:], points = drawn_from(room.ekf, run.models.motion.half, self._rng)
        N, K, n = len(world.landmarks), len(world.fiducials), len(points)
        own = min(n, N)  # the features are the first landmarks; further ones are of nothing, as some must be
        world.landmarks[:own] = points[:N]
        room.owner["label"][:n] = np.where(np.arange(n) < N, K + np.arange(n), CLUTTER_LABEL)
        room.owner["landmark"][:n] = np.where(np.arange(n) < N, np.arange(n), NOBODY)
        boxes, places, chances = known_boxes(run), self._places, self._chances
        if len(world.boxes) and not run.models.boxes_known:  # one room, whose landmarks are on its boxes
            each = chances.reshape(len(self._drawn), -1)
            index = self._rng.choice(len(each), p=each.sum(axis=1) / each.sum())
            boxes = _possible(self._drawn[index].boxes, run.models.camera, world.state.camera, points, world.fiducials)
            places, chances = self._drawn[index].landmarks, each[index]
        world.state.boxes = len(boxes)
        world.boxes[: len(boxes)] = boxes
        world.landmarks[own:] = self._rng.choice(places, N - own, replace=False, p=chances / chances.sum())
        count_in_longer_frames(room.ekf, stride)
        world.state.frame = run.world.state.frame // stride


def _possible(
    boxes: np.ndarray, camera: Record, pose: np.ndarray, features: np.ndarray, fiducials: np.ndarray
) -> np.ndarray:
    """Those of ``boxes`` (n, 2, 3) that hold neither the camera nor a feature, and hide nothing that is in its view."""
    points, z = np.vstack((pose[POSITION], features)), np.empty(2)
    view = View(camera, pose, rotation_matrix(pose[QUATERNION]), boxes[:0])
    seen = [point for point in np.vstack((features, fiducials)) if visible(view, point, 0.0, z)]
    kept = [
        not ((box[0] - CLEAR < points) & (points < box[1] + CLEAR)).all(axis=1).any()
        and all(visible(view._replace(boxes=box[None]), point, 0.0, z) for point in seen)
        for box in boxes
    ]
    return boxes[np.array(kept, bool)]


class Hindsight(Imagination):
    """Futures from the ground truth, without the noise to come: for bounds and evaluation, never for policies."""

    def _furnish(self, run: Run, room: Run, stride: int) -> None:
        super()._furnish(run, room, stride)
        room.world.state.camera[:], room.world.landmarks[:] = run.world.state.camera, run.world.landmarks
        room.world.boxes[:], room.world.state.boxes = run.world.boxes, run.world.state.boxes
        room.owner[:] = run.owner


def _copy(source: tuple, target: tuple, rows: Any = ..., at: Any = ...) -> None:
    """Copy those ``rows`` of all arrays of nested tuples to the rows ``at`` of the ``target``; `...` is all."""
    for one, other in zip(source, target, strict=True):
        if isinstance(one, tuple):
            _copy(one, other, rows, at)
        else:
            other[at] = one[rows]


def slowed(models: Record) -> tuple[Record, int]:
    """MODELS that are cheaper to play, and how many times as long their frames are, s.

    A step is a whole motion period. Frames are as long as `LONGEST_FRAME` and whole numbers allow; a long one has 1/s
    of the variance of the image noise, and of the disturbance held over it, so that a second tells and disturbs as
    much. What is counted in frames is divided by s. The controller is as fast as such frames allow. The true camera is
    the known one, and landmarks are seen from all sides.
    """
    task, motion = models.task, models.motion
    frames = int(task.frames_per_step * task.steps_per_motion)
    divisors = [s for s in range(1, frames + 1) if frames % s == 0 and s * motion.dt <= LONGEST_FRAME + 1e-9]
    s = max(divisors, default=1)
    out = models.copy()
    dt, root = s * float(motion.dt), math.sqrt(s)
    out.camera.pixel_std /= root
    out.true_camera, out.sensor.facing_cosine = out.camera, -1.0
    for name in ("acceleration_std", "angular_acceleration_std"):
        out.motion[name] /= root
        out.motion[f"filter_{name}"] /= root
    out.motion.dt = dt
    out.motion.controller_frequency = min(float(motion.controller_frequency), 0.8 / dt)
    out.motion.rate_loop_time = max(float(motion.rate_loop_time), 0.75 * dt)
    counts = out.filter.initialisation
    for name in ("birth_detections", "maximum_misses", "memory_frames", "ray_age_frames"):
        counts[name] = max(1, round(int(counts[name]) / s))
    out.filter.particles.maximum_misses = counts.maximum_misses
    out.filter.restart.limit = math.inf  # a truth that is drawn from the belief does not contradict it
    out.task.frames_per_step, out.task.steps_per_motion = frames // s, 1
    out.task.steps = math.ceil(task.steps / task.steps_per_motion)
    out.task.end_when_lost = False
    return out, s
