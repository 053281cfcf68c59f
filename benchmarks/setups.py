"""Timings of calls and of a sweep, and a map of a chosen size to measure on."""

from collections.abc import Callable
from copy import deepcopy
from functools import partial
from timeit import repeat, timeit
from typing import Any

import numpy as np

from activeslam_gym import Gaze, Motion, Scenario
from activeslam_gym.camera import pixel_from_camera_point
from activeslam_gym.envs.reset import empty_runs, reset_run
from activeslam_gym.envs.run import Run, run_at
from activeslam_gym.envs.setting import resolve
from activeslam_gym.envs.step import estimate, judge, measure, read_command, simulate
from activeslam_gym.kernels import compiled, row
from activeslam_gym.motion import CAMERA_DIM
from activeslam_gym.slam.belief import POINT, start_of
from activeslam_gym.slam.map import append_feature

Call = Callable[[], Any]
WARM_UP, END = 20, 34
"""The sweep goes on for so long before anything is timed [s]: most of the room is then mapped. When it ends [s]."""
SEEN = 8  # features in the image of a map of a chosen size


def repeated(call: Call, repeats: int, at_least: float) -> np.ndarray:
    """Times (repeats,) of one ``call`` [s], each the mean of a loop of about ``at_least`` [s], after one call."""
    call()
    number = max(1, int(at_least / max(timeit(call, number=1), 1e-9)))
    return np.array(repeat(call, number=number, repeat=repeats)) / number


def sweep(env: Any, period: float, begin: int, end: int) -> np.ndarray:
    """Times (end - begin,) [s] that the seconds ``begin`` … ``end`` of `baselines.Sweep` take in an environment.

    RIGHT and LEFT in turn, always turning LEFT; ``period``: of the gaze [s].
    """

    def second(number: int) -> None:
        action = np.array(np.broadcast_to((Motion.LEFT if number % 2 else Motion.RIGHT, Gaze.LEFT), shape))
        for _ in range(round(1.0 / period)):
            env.step(action)

    shape = env.action_space.shape
    return np.array([timeit(partial(second, number), number=1) for number in range(begin, end)])


def restoring(live: Any) -> Call:
    """A function that gives the arrays of ``live``, a nested named tuple, their present values back."""

    def restore(live: Any, saved: Any) -> None:
        for one, other in zip(live, saved, strict=True):
            if isinstance(one, tuple):
                restore(one, other)
            else:
                np.copyto(one, other)

    return partial(restore, live, deepcopy(live))


def mapped_runs(landmarks: int) -> Run:
    """A batch of one run, at rest at the origin: every landmark is mapped as a POINT, and `SEEN` are in view.

    The means are the true points, with a standard deviation of about 1 cm, all correlated. The candidates are the
    predicted measurements, with their ids.
    """
    rng, scenario = np.random.default_rng(landmarks), Scenario(landmark_count=landmarks, fiducial_count=0)
    runs = empty_runs(scenario, 1)
    reset_run(resolve(scenario, None, 1.0, 35.0, "entropy", 0.5), runs, 0, 0)
    run, points = row(runs, 0), points_around(landmarks, rng)
    run.world.state.camera[:] = start_of(scenario)[0]
    run.world.landmarks[:] = points
    for y in points:
        append_feature(run.ekf, POINT, np.append(y, np.zeros(3)), np.zeros((3, CAMERA_DIM)), np.eye(3))
    dim = int(run.ekf.state.dim)
    A = 0.01 * rng.standard_normal((dim, 3 * dim)) / np.sqrt(3 * dim)
    run.ekf.covariance[:dim, :dim] = A @ A.T
    run.episode.detection_count = SEEN
    run.detections["id"][:SEEN] = run.ekf.feature["id"][:SEEN]
    for y, pixel in zip(points, run.detections["pixel"][:SEEN]):
        pixel_from_camera_point(runs.models[0].lens, y, pixel)
    return runs


def points_around(landmarks: int, rng: np.random.Generator) -> np.ndarray:
    """Points (landmarks, 3) [m]: the first `SEEN` spread over the image from the origin, the rest behind it."""
    across, up = np.meshgrid(np.linspace(-0.9, 0.9, SEEN // 2), (-0.5, 0.5))
    ahead = np.stack((across.ravel(), up.ravel(), np.full(SEEN, 2.2)), axis=1) + 0.05 * rng.standard_normal((SEEN, 3))
    behind = rng.uniform((-2.5, -0.9, -2.5), (2.5, 0.9, -0.5), (landmarks - SEEN, 3))
    return np.concatenate((ahead, behind))


@compiled
def whole_frames(runs: Run, command: np.ndarray, frames: int) -> None:
    """Begin a motion of the first of ``runs``, and go on for so many frames, as a step does, without their evaluation.

    ``command`` (4,) as in `motion.COMMANDS`.
    """
    run = run_at(runs, 0, runs.estimate.covariance[0])
    read_command(run, command, np.inf)
    for frame in range(frames):
        u, contact = simulate(run, command[3])
        estimate(run, u, contact, measure(run), frame == frames - 1)
        judge(run)


def demand_matches(runs: Run, landmarks: int) -> None:
    """Raise RuntimeError where the last frame matched other than `SEEN` candidates, or the map has changed its size."""
    run = row(runs, 0)
    matched = int((run.detections["match"][: run.episode.detection_count] > 0).sum())
    if matched != SEEN or run.ekf.state.count != landmarks:
        raise RuntimeError(f"{matched} of {SEEN} points were matched, {run.ekf.state.count} features")
