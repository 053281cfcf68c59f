"""What might come: runs played ahead from what is believed, for policies that plan.

An imagined run begins with a copy of the belief, in a room drawn from it: the camera and the features stand where
N(mean, P) has them, and the landmarks that no feature stands for where none was found by looking. Its noise is its
own. Nothing of the truth enters: neither true places nor labels nor the stream of noise that the real run will meet.

It is the environment's own simulation, with two things made cheap: frames are longer, with as much noise in a second
(see `coarse`), and detections tell what they are of, so that no imagined match is wrong.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from activeslam_gym.camera import View, visible
from activeslam_gym.config import KNOWN, Scenario
from activeslam_gym.envs.episode import play
from activeslam_gym.envs.referee import NOBODY
from activeslam_gym.envs.simulation import Run, Setting, empty_runs, resolve
from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.information.expectation import WAITING
from activeslam_gym.kernels import row
from activeslam_gym.motion import POSITION, QUATERNION
from activeslam_gym.slam.belief import ANCHOR, POINT, RAY, Belief, positions_of
from activeslam_gym.slam.manifold import shift_mean
from activeslam_gym.threads import Workers
from activeslam_gym.world.room import uniform_points
from activeslam_gym.world.simulator import CLUTTER_LABEL

LONGEST_FRAME = 0.25
"""Imagined frames are at most so long [s]."""
LOOK_PERIOD = 0.25
"""Places where a landmark may be are looked at so often [s]."""
OVERLOOKED = 0.1
"""Chance that a landmark in view of one look gets no feature."""
WELL_INSIDE_PX = 20.0
"""A place is looked at so far inside the image [px]."""
PLACES = 600
"""Places in the room where a landmark may be."""
ROWS = 32
"""Runs played at a time."""


@dataclass(frozen=True)
class Outcome:
    """What imagined runs came to; R runs."""

    entropy: np.ndarray
    """(R,) of the belief at the end [bit]."""
    log_density: np.ndarray
    """(R,) log2 N(imagined truth | belief) at the end [bit]."""


class Imagination:
    """Imagined futures of environment ``i`` of ``env`` (a single one is its own 0th).

    Call `look` at every step, from the reset on; `draw` at the start of a motion period, then `play` plans in the rooms
    that were drawn. ``seed``: of everything that is drawn. ``threads`` share the runs (None: one for each core).
    """

    def __init__(self, env: Any, i: int = 0, seed: int = 0, threads: int | None = None) -> None:
        self._env, self._i = env, i
        self._setting = coarse(env.setting)
        self._seed, self._workers = seed, Workers(ROWS, threads)
        self._batch = empty_runs(self._setting.scenario, ROWS)
        self._rooms = empty_runs(self._setting.scenario, 0)
        self._places = np.zeros((0, 3))
        self._weights = np.zeros(0)
        self._looked_at = -math.inf
        self._rng = np.random.default_rng(seed)

    @property
    def periods(self) -> int:
        """Motion periods from the present to the end of the episode."""
        steps = int(self._env.setting.task.steps) - int(self._own().episode.steps)
        return -(-steps // int(self._env.steps_per_motion))

    def look(self) -> None:
        """Take note of what is in view now: where a landmark would have been found, there is hardly one."""
        run = self._own()
        time = int(run.episode.steps) * self._env.gaze_period
        if time == 0.0:
            self._begin()
        if time < self._looked_at + LOOK_PERIOD - 1e-9:
            return
        self._looked_at = time
        view, z = _present_view(run), np.empty(2)
        seen = np.array([visible(view, place, -WELL_INSIDE_PX, z) for place in self._places])
        self._weights[seen] *= OVERLOOKED
        self._weights /= self._weights.max()

    def draw(self, samples: int) -> None:
        """Draw ``samples`` rooms from the present belief.

        Raises:
            ValueError: a motion is under way; a plan begins with a motion of its own.
        """
        run = self._own()
        if int(run.episode.steps) % int(self._env.steps_per_motion):
            raise ValueError("a plan is imagined from the start of a motion period, and a motion is under way")
        self._rooms = empty_runs(self._setting.scenario, samples)
        _copy(row(self._env._runs.belief, [self._i] * samples), self._rooms.belief)
        for m in range(samples):
            self._imagine(run, row(self._rooms, m))

    def play(self, rooms: Sequence[int] | np.ndarray, plans: np.ndarray) -> Outcome:
        """Play ``plans`` (R, T, 2), an action for each motion period, each in that one of the ``rooms`` (R,) drawn."""
        rooms, entropy, density = np.asarray(rooms), np.empty(len(plans)), np.empty(len(plans))
        for start in range(0, len(plans), ROWS):
            part = slice(start, start + ROWS)
            end = self._play(rooms[part], plans[part])
            entropy[part], density[part] = end["entropy"], end["log_density"]
        return Outcome(entropy, density)

    def _play(self, rooms: np.ndarray, plans: np.ndarray) -> np.ndarray:
        """(R,) EVALUATION at the end of at most ROWS runs."""
        runs, count = row(self._batch, slice(0, len(plans))), len(plans)
        _copy(row(self._rooms, rooms), runs)
        runs.models[:] = self._setting.models
        workers = self._workers if count == ROWS else Workers(count, self._workers.threads)
        for period in range(plans.shape[1]):
            motions, gazes = plans[:, period, 0].astype(np.int64), plans[:, period, 1].astype(np.int64)
            workers.call(play, runs, motions, gazes)
        return runs.episode["evaluation"]

    def _own(self) -> Run:
        return row(self._env._runs, self._i)

    def _begin(self) -> None:
        """A new episode: a landmark may be anywhere."""
        self._rng = np.random.default_rng(self._seed)
        self._places = uniform_points(self._setting.scenario, PLACES, self._rng)
        self._weights = np.ones(PLACES)
        self._looked_at = -math.inf

    def _imagine(self, run: Run, room: Run) -> None:
        """Make ``room`` one of those in which the belief of ``run`` may be; the run's truth is not read."""
        stride = self._setting.models.motion.dt / self._env.setting.models.motion.dt
        self._place_things(run, room)
        _slow_clock(room.belief, round(stride))
        room.expected[:], room.viewpoint[:] = run.expected, run.viewpoint
        room.episode.views = run.episode.views
        room.episode.steps = int(run.episode.steps) // int(self._env.steps_per_motion)
        room.world.fiducials[:] = run.world.fiducials  # which are known
        if run.models.boxes_known:
            room.world.boxes[:] = run.world.boxes
        room.world.state.noise_key[:] = self._rng.integers(2**63)
        room.episode.redraw_key[:] = self._rng.integers(2**63)

    def _place_things(self, run: Run, room: Run) -> None:
        """Draw the true camera, and the landmarks: those of the features, oldest first, and the rest unseen."""
        camera, points = sampled(room.belief, 0.5 * np.array(self._setting.scenario.room_size), self._rng)
        N, K, n = len(room.world.landmarks), len(room.world.fiducials), len(points)
        room.world.state.camera[:] = camera
        room.world.landmarks[:n] = points[:N]
        for k in range(n):
            owner = room.owner[run.belief.feature[k].slot]
            owner.serial = run.belief.feature[k].serial
            owner.label, owner.landmark = (K + k, k) if k < N else (CLUTTER_LABEL, NOBODY)
        if n < N:
            chosen = self._rng.choice(PLACES, N - n, replace=False, p=self._weights / self._weights.sum())
            room.world.landmarks[n:] = self._places[chosen]


def sampled(belief: Belief, half: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A camera (13,) and a point (n, 3) for each feature, drawn from the belief and kept in the room ``half`` (3,)."""
    dim, n = int(belief.state.dim), int(belief.state.count)
    drawn = belief._replace(feature=belief.feature.copy(), state=belief.state.copy())
    for k in range(n):
        if drawn.feature[k].kind == RAY:
            depths, weights = belief.particles[drawn.feature[k].slot].T
            drawn.feature[k].depth = rng.choice(depths, p=weights / weights.sum())
    shift_mean(drawn, _normal(belief.covariance[:dim, :dim], rng))
    camera, points = drawn.state.camera.copy(), positions_of(drawn)
    from_ = np.where((drawn.feature["kind"][:n] == POINT)[:, None], camera[POSITION], drawn.feature["mean"][:n, ANCHOR])
    return camera, _kept_inside(from_, points, half)


def _normal(P: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A draw of N(0, P), of the nearest such P where it is not quite positive."""
    values, vectors = np.linalg.eigh(P)
    return vectors @ (np.sqrt(np.maximum(values, 0.0)) * rng.standard_normal(len(values)))


def _kept_inside(from_: np.ndarray, points: np.ndarray, half: np.ndarray) -> np.ndarray:
    """``points`` (n, 3) moved along their lines of sight ``from_`` (n, 3) into the room."""
    way = points - from_
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(way != 0.0, (np.copysign(half, way) - from_) / way, np.inf).min(axis=1, initial=1.0)
    return from_ + np.maximum(share, 0.0)[:, None] * way


def _slow_clock(belief: Belief, stride: int) -> None:
    """Count in frames that are ``stride`` times as long."""
    frame, feature = int(belief.state.frame), belief.feature[: int(belief.state.count)]
    belief.state.frame = frame // stride
    for name in ("born", "seen"):
        feature[name] = frame // stride + (feature[name] - frame) // stride
    feature["misses"] //= stride
    belief.track["hits"] //= stride


def _present_view(run: Run) -> View:
    """What the estimated camera sees, with what is known to hide things."""
    pose = run.belief.state.camera
    boxes = run.world.boxes if run.models.boxes_known else run.world.boxes[:0]
    return View(run.models.camera, pose, rotation_matrix(pose[QUATERNION]), boxes)


def _copy(source: Any, target: Any) -> None:
    """Copy all arrays of nested tuples."""
    for one, other in zip(source, target, strict=True):
        if isinstance(one, tuple):
            _copy(one, other)
        else:
            other[...] = one


# The model of the world ---------------------------------------------------------------------------------------------


def coarse(setting: Setting) -> Setting:
    """A setting that is cheaper to play: longer frames, one step for each motion period, detections that are labelled.

    A frame s times as long has 1/s the variance of image noise, and of the disturbance held over it, so that a second
    tells as much and disturbs as much. What is counted in frames is divided by s. The controller is as fast as such
    frames allow.
    """
    scenario, motion = setting.scenario, round(setting.motion_period / setting.scenario.frame_time)
    stride = max(s for s in range(1, motion + 1) if motion % s == 0 and (s == 1 or s * scenario.frame_time <= LONGEST_FRAME + 1e-9))
    periods = math.ceil(setting.duration / setting.motion_period - 1e-9)
    return resolve(
        _slowed(scenario, stride),
        gaze_period=setting.motion_period,
        motion_period=setting.motion_period,
        duration=periods * setting.motion_period,
        reward=setting.reward,
        lost_position_error=float(setting.task.lost_position_error),
        end_when_lost=False,
    )


def _slowed(scenario: Scenario, s: int) -> Scenario:
    """The scenario with frames ``s`` times as long; see `coarse`."""
    frame, root = s * scenario.frame_time, math.sqrt(s)
    linear, angular = scenario.filter_acceleration_stds
    return replace(
        scenario,
        frame_time=frame,
        pixel_std=scenario.pixel_std / root,
        acceleration_std=scenario.acceleration_std / root,
        angular_acceleration_std=scenario.angular_acceleration_std / root,
        filter_acceleration_std=linear / root,
        filter_angular_acceleration_std=angular / root,
        controller_frequency=min(scenario.controller_frequency, 0.8 / frame),
        rate_loop_time=max(scenario.rate_loop_time, 0.75 * frame),
        birth_detections=max(1, round(scenario.birth_detections / s)),
        maximum_misses=max(2, round(scenario.maximum_misses / s)),
        association=KNOWN,
        labelled_first_match=False,
    )
