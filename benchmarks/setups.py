"""What the parts measure on: an environment in the middle of a sweep, and a map whose size is chosen."""

from typing import Any

import gymnasium
import numpy as np

from activeslam_gym import Gaze, Motion, Scenario
from activeslam_gym.envs.run import Run
from activeslam_gym.envs.setting import resolve
from activeslam_gym.envs.simulation import empty_runs, reset_run
from activeslam_gym.kernels import row
from activeslam_gym.motion import CAMERA_DIM
from activeslam_gym.slam.belief import POINT, Belief, start_of
from activeslam_gym.slam.map import append_feature

WARM_UP = 20.0
"""The sweep goes on for so long before anything is timed [s]: most of the room is then mapped."""
SEEN = 8
"""Features in the image of a map of a chosen size."""


def sweep_action(step: int, steps_per_motion: int) -> tuple[int, int]:
    """The action of `baselines.Sweep`: RIGHT and LEFT in turn, always turning LEFT."""
    return (Motion.LEFT if step // steps_per_motion % 2 else Motion.RIGHT), Gaze.LEFT


def swept(seed: int, **arguments: Any) -> tuple[gymnasium.Env, int]:
    """An environment after `WARM_UP` of sweep from ``seed`` (the next one if that is lost) and its steps so far."""
    env = gymnasium.make("ActiveSLAM-v0", **arguments)
    inner: Any = env.unwrapped
    count = round(WARM_UP / inner.gaze_period)
    actions = [np.array(sweep_action(step, inner.steps_per_motion)) for step in range(count)]
    env.reset(seed=seed)
    while any(env.step(action)[2] for action in actions):  # stops at the first that loses it
        seed += 1
        env.reset(seed=seed)
    return env, count


def restore(live: Any, saved: Any) -> None:
    """Copy the arrays of ``saved``, a nested named tuple, into those of ``live``."""
    for one, other in zip(live, saved, strict=True):
        if isinstance(one, tuple):
            restore(one, other)
        else:
            np.copyto(one, other)


def copied(tree: Any) -> Any:
    """A deep copy of a nested named tuple of arrays."""
    return type(tree)(*(copied(x) if isinstance(x, tuple) else x.copy() for x in tree))


def map_scenario(landmarks: int) -> Scenario:
    """The default scenario without fiducials and with as many landmarks."""
    return Scenario(landmark_count=landmarks, fiducial_count=0)


def points_around(landmarks: int, rng: np.random.Generator) -> np.ndarray:
    """Points (landmarks, 3) [m]: the first `SEEN` spread over the image from the origin, the rest behind it."""
    across, up = np.meshgrid(np.linspace(-0.9, 0.9, SEEN // 2), (-0.5, 0.5))
    ahead = np.stack((across.ravel(), up.ravel(), np.full(SEEN, 2.2)), axis=1) + 0.05 * rng.standard_normal((SEEN, 3))
    behind = rng.uniform((-2.5, -0.9, -2.5), (2.5, 0.9, -0.5), (landmarks - SEEN, 3))
    return np.concatenate((ahead, behind))


def fill_with_points(belief: Belief, points: np.ndarray, rng: np.random.Generator) -> None:
    """Give ``belief``, which has no feature, the mean ``points`` and a covariance of about 1 cm, all correlated."""
    for y in points:
        mean = np.concatenate((y, np.zeros(3)))
        append_feature(belief, POINT, mean, np.zeros((3, CAMERA_DIM)), np.eye(3))
    dim = int(belief.state.dim)
    A = 0.01 * rng.standard_normal((dim, 3 * dim)) / np.sqrt(3 * dim)
    P = A @ A.T
    belief.covariance[:dim, :dim] = 0.5 * (P + P.T)


def mapped_runs(landmarks: int, seed: int = 0) -> Run:
    """A batch of one run, at rest at the origin: every landmark is mapped as a POINT and `SEEN` are in view."""
    rng, scenario = np.random.default_rng(seed), map_scenario(landmarks)
    setting = resolve(scenario, None, 1.0, 35.0, "entropy", 0.5)
    runs = empty_runs(scenario, 1)
    reset_run(setting, runs, 0, seed)
    run, points = row(runs, 0), points_around(landmarks, rng)
    run.world.state.camera[:] = start_of(scenario)[0]
    run.world.landmarks[:] = points
    fill_with_points(run.ekf, points, rng)
    return runs
