"""A moment of a run, as a painter needs it."""

from dataclasses import dataclass, replace

import gymnasium
import numpy as np

from activeslam_gym.config import Scenario
from activeslam_gym.envs.perception import Perception
from activeslam_gym.envs.public import PublicBelief, public_belief
from activeslam_gym.envs.runs import Runs
from activeslam_gym.information.entropy import WAITING
from activeslam_gym.motion import Gaze, Motion, nearest_gaze, nearest_motion
from activeslam_gym.sensors.sensor import TEXTURED
from activeslam_gym.world.scenes import Scene
from activeslam_gym.world.simulator import boxes_of
from activeslam_gym.world.truth import Truth, truth_of

_PLAN_POINTS = 3000  # of which the upright ones draw the floor plan of a foreign scene


@dataclass(frozen=True)
class Snapshot:
    """Everything that a picture of one moment needs."""

    scenario: Scenario
    time: float
    duration: float
    motion: Motion
    gaze: Gaze
    belief: PublicBelief
    truth: Truth
    """With the boxes that there are; in rooms with textures, with those landmarks that a feature follows."""
    room_size: np.ndarray
    """(3,) [m]."""
    floor_plan: np.ndarray
    """(n, 3) where the bodies of a foreign scene stand, on its floor [m]."""
    expected_landmarks: np.ndarray
    """(k, 3) expected and not yet retired [m]."""
    detections: np.ndarray
    """(d, 2) [px]."""
    predicted: np.ndarray
    """(m, 2) [px]."""
    predicted_covariance: np.ndarray
    """(m, 2, 2) [px^2]."""
    true_trajectory: np.ndarray
    """(T, 3) [m]; T = 0 where no history is kept."""
    estimated_trajectory: np.ndarray
    """(T, 3) [m]."""
    times: np.ndarray
    """(T,) [s]."""
    entropy: np.ndarray
    """(T,) [bit]."""
    landmark_times: np.ndarray
    """(j,) times at which the number of mapped landmarks rose [s]."""
    image: np.ndarray | None = None
    """(H, W) uint8 what the camera sees, where there is an image."""


def _floor_plan(scene: Scene | None) -> np.ndarray:
    """Feet of points on the upright surfaces of the ``scene``."""
    if scene is None:
        return np.zeros((0, 3))
    points, normals = scene.sample(_PLAN_POINTS, np.random.default_rng(0))
    plan = points[np.abs(normals[:, 1]) < 0.5]
    plan[:, 1] = scene.bounds[0, 1]
    return plan


def snapshot_of(runs: Runs, i: int) -> Snapshot:
    """The present moment of run ``i``.

    Raises:
        gymnasium.error.ResetNeeded: it has not begun.
    """
    if not runs._runs.episode["begun"][i]:
        raise gymnasium.error.ResetNeeded("there is nothing to show before the first reset()")
    run, perception, scenario = runs._at(i), runs._perceptions[i], runs.scenario
    truth, episode, waiting = truth_of(run.world), run.episode, run.expected["feature"] == WAITING
    image = getattr(perception, "image", None)
    landmarks = truth.landmarks[~waiting] if scenario.sensor in TEXTURED else truth.landmarks
    past = np.reshape(runs._past[i], (-1, 9))
    times, most_mapped = past[:, 0], np.maximum.accumulate(past[:, 2])
    sight = (perception or Perception()).predicted(run)
    own = 2 * np.arange(len(sight.point))[:, None, None] + np.arange(2)
    return Snapshot(
        scenario=scenario,
        time=int(episode.steps) * runs.gaze_period,
        duration=runs.duration,
        motion=nearest_motion(episode.control.command),
        gaze=nearest_gaze(runs._commands[i, 3]),
        belief=public_belief(run),
        truth=replace(truth, landmarks=landmarks, boxes=boxes_of(run.world).copy()),
        room_size=2.0 * run.models.motion.half,
        floor_plan=_floor_plan(getattr(perception, "scene", None)),
        expected_landmarks=run.expected["point"][waiting],
        detections=run.detections["pixel"][: episode.detection_count].copy(),
        predicted=sight.point["z_hat"].copy(),
        predicted_covariance=sight.S[np.swapaxes(own, 1, 2), own],
        true_trajectory=past[:, 3:6],
        estimated_trajectory=past[:, 6:],
        times=times,
        entropy=past[:, 1],
        landmark_times=np.repeat(times, np.diff(most_mapped, prepend=0.0).astype(int)),
        image=image,
    )
