"""A moment of a run, as a painter needs it."""

from dataclasses import dataclass

import gymnasium
import numpy as np

from activeslam_gym.config import Scenario
from activeslam_gym.envs.public import public_belief
from activeslam_gym.envs.run import known_boxes
from activeslam_gym.envs.runs import Runs
from activeslam_gym.information.entropy import WAITING
from activeslam_gym.kernels import uncompiled
from activeslam_gym.motion import Gaze, Motion, nearest_gaze, nearest_motion
from activeslam_gym.slam.estimate import COMPILED
from activeslam_gym.slam.sight import sight_of_belief
from activeslam_gym.world.scenes import Scene
from activeslam_gym.world.simulator import boxes_of
from activeslam_gym.world.truth import truth_of

_PLACES, _LEVEL_RAYS = 40, 180  # of the rays that draw the floor plan of a foreign scene


@dataclass(frozen=True)
class Snapshot:
    """Everything that a picture of one moment needs."""

    scenario: Scenario
    time: float
    duration: float
    motion: Motion
    gaze: Gaze
    room_size: np.ndarray
    """(3,) [m]."""
    boxes: np.ndarray
    """(B, 2, 3) lowest and highest corner of each [m]."""
    floor_plan: np.ndarray
    """(n, 3) where the bodies of a foreign scene stand, on its floor [m]."""
    true_position: np.ndarray
    true_quaternion: np.ndarray
    true_landmarks: np.ndarray
    fiducials: np.ndarray
    position: np.ndarray
    quaternion: np.ndarray
    covariance: np.ndarray
    landmarks: np.ndarray
    mapped: np.ndarray
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
    image_size: np.ndarray
    """(2,) width and height [px]."""
    image: np.ndarray | None = None
    """(H, W) uint8 what the camera sees, where there is an image."""


def _floor_plan(scene: Scene | None, position: np.ndarray) -> np.ndarray:
    """What level rays meet, from the camera's ``position`` and, where the ``scene`` knows some, from other places."""
    if scene is None:
        return np.zeros((0, 3))
    start, rng = getattr(scene, "start", None), np.random.default_rng(0)
    places = np.array([position, *([start(rng) for _ in range(_PLACES)] if start else [])])
    turns = np.linspace(0.0, 2.0 * np.pi, _LEVEL_RAYS, endpoint=False)
    ways = np.stack((np.sin(turns), np.zeros_like(turns), np.cos(turns)), axis=1)
    origins, ways = np.repeat(places, len(ways), axis=0), np.tile(ways, (len(places), 1))
    farthest = float(np.ptp(scene.bounds, axis=0).max())
    free = scene.clearance(origins, ways, farthest)
    met = (origins + free[:, None] * ways)[free < farthest]
    met[:, 1] = scene.bounds[0, 1]
    return met


def snapshot_of(runs: Runs, i: int) -> Snapshot:
    """The present moment of run ``i``.

    With images it has the last one, and of the truth those scene points that features stand for.

    Raises:
        gymnasium.error.ResetNeeded: it has not begun.
    """
    if not runs._runs.episode["begun"][i]:
        raise gymnasium.error.ResetNeeded("there is nothing to show before the first reset()")
    run, perception, scenario = runs._at(i), runs._perceptions[i], runs.scenario
    belief, truth, episode = public_belief(run), truth_of(run.world), run.episode
    image = getattr(perception, "image", None)
    points = sight_of_belief(run.models.lens, run.ekf, run.world.fiducials, uncompiled(known_boxes)(run))
    drawn = len(points.point) if scenario.estimator in COMPILED else 0  # another estimator's predictions are its own
    own = 2 * np.arange(drawn)[:, None, None] + np.arange(2)
    return Snapshot(
        scenario=scenario,
        time=int(episode.steps) * runs.gaze_period,
        duration=runs.duration,
        motion=nearest_motion(episode.control.command),
        gaze=nearest_gaze(runs._commands[i, 3]),
        room_size=2.0 * run.models.motion.half,
        boxes=boxes_of(run.world).copy(),
        floor_plan=_floor_plan(getattr(perception, "scene", None), truth.position),
        true_position=truth.position,
        true_quaternion=truth.quaternion,
        true_landmarks=truth.landmarks if image is None else truth.landmarks[run.expected["feature"] != WAITING],
        fiducials=truth.fiducials,
        position=belief.position,
        quaternion=belief.quaternion,
        covariance=belief.covariance,
        landmarks=belief.landmarks,
        mapped=belief.mapped,
        expected_landmarks=run.expected["point"][run.expected["feature"] == WAITING],
        detections=run.detections["pixel"][: episode.detection_count].copy(),
        predicted=points.point["z_hat"][:drawn].copy(),
        predicted_covariance=points.S[np.swapaxes(own, 1, 2), own],
        **runs._histories[i].arrays(),
        image_size=np.array([scenario.image_width, scenario.image_height], float),
        image=image,
    )
