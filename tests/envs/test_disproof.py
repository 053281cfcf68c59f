"""Negative information: what was looked at and not found is expected elsewhere, and nothing else changes."""

import gymnasium as gym
import numpy as np

from activeslam_gym.camera import View, visible
from activeslam_gym.config import Scenario
from activeslam_gym.envs.disproof import WELL_INSIDE_PX, disprove
from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.information.entropy import EXPECTED, WAITING
from activeslam_gym.world.furniture import inside_any
from tests.support import CAMERA, NO_BOXES, simulation_of

BEHIND = ((-3.0, -1.0, -3.0), (3.0, 1.0, -1.0))
HALF, POSE = np.array([3.0, 1.0, 3.0]), np.array([0.0, 0, 0, 1, 0, 0, 0])


def inside(pose: np.ndarray, y: np.ndarray) -> bool:
    return visible(View(CAMERA, pose, rotation_matrix(pose[3:7]), NO_BOXES), y, -WELL_INSIDE_PX, np.empty(2))


def expectation(*points: tuple[float, float, float]) -> np.ndarray:
    expected = np.zeros(len(points), EXPECTED)
    expected["point"] = points
    return expected


def look(expected: np.ndarray, poses: list[np.ndarray], probability: float = 1.0) -> int:
    """Frames from ``poses``, of which 5 make a look; the number of viewpoints."""
    run = simulation_of(gym.make("ActiveSLAM-v0", scenario={"landmark_count": len(expected), "boxes": (BEHIND,)}))
    run.world.boxes[0], run.world.state.boxes, run.models.boxes_known = BEHIND, 1, True
    run.models.lens, run.models.motion.half, run.models.on_surfaces = CAMERA, HALF, False
    run.models.filter.initialisation.new_feature_detections = 3
    run.models.filter.association.detection_probability, run.episode.redraw_key[:] = probability, 7
    run.expected[:] = expected
    for pose in poses:
        run.estimate.state.camera[:7] = pose
        disprove(run)
    expected[:] = run.expected
    return int(run.episode.views)


def test_a_look_from_one_place_counts_once() -> None:
    """With a chance of nothing every look is in vain, and there is one for each of the two viewpoints."""
    expected = expectation((0.0, 0.0, 2.0))
    beside = POSE + np.array([0.5, 0, 0, 0, 0, 0, 0])
    assert look(expected, [POSE] * 30 + [beside] * 30, probability=0.0) == 2
    assert expected["redraws"][0] == 2 and expected["point"][0].tolist() == [0.0, 0.0, 2.0]


def test_new_places_are_outside_of_all_viewpoints_and_of_known_boxes() -> None:
    rng, poses = np.random.default_rng(0), []
    for angle in (0.0, 0.8, 1.6):
        poses += [np.array([0.0, 0, 0, np.cos(angle / 2), 0, np.sin(angle / 2), 0])] * 12
    expected = expectation(*rng.uniform(-HALF, HALF, (60, 3)))
    assert look(expected, poses) == 3
    moved = expected["point"][expected["redraws"] > 0]
    assert len(moved) > 10 and not any(inside(pose, y) for pose in poses[::12] for y in moved)
    assert not inside_any(moved, np.array([BEHIND])).any()


def test_only_expected_points_move() -> None:
    """The same actions in the same room: entropy, log score and map are those of the paper's reading."""
    told, redraws = [], []
    for negative in (False, True):
        env = gym.make("ActiveSLAM-v0", scenario=Scenario(negative_information=negative), gaze_period=0.25)
        infos, expected = [env.reset(seed=2)[1]], simulation_of(env).expected
        before = expected["point"].copy()
        for step in range(40):
            infos.append(env.step((2 + step // 4 % 2, 1))[-1])
        told.append([(info["entropy"], info["log_score"], info["landmarks_mapped"]) for info in infos])
        redraws.append(expected["redraws"].sum())
        assert (np.any(expected["point"] != before, axis=1) == (expected["redraws"] > 0)).all()
    assert told[0] == told[1] and redraws[0] == 0 and redraws[1] > 3
    waiting = expected[expected["feature"] == WAITING]
    assert sum(inside(simulation_of(env).estimate.state.camera, y) for y in waiting["point"]) <= 1
