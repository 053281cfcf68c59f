"""The sensor `corners`: the rooms of images, and the front end's rules, without an image."""

import dataclasses
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import activeslam_gym  # noqa: F401
from activeslam_gym.camera import camera_point, pixel_from_camera_point
from activeslam_gym.config import SCENARIOS
from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.vision.settings import SIGHTED

GALLERY = dataclasses.replace(SCENARIOS["gallery-pixels"], sensor="corners")
ACTIONS = [[1, 1]] * 8 + [[2, 1]] * 12 + [[0, 0]] * 8
SEED = 2**32 + 5


@pytest.fixture(scope="module")
def flown() -> Any:
    """An environment after 7 s, with the matches of each step's last frame: id, pixel, R, and the camera's truth."""
    env = gym.make("ActiveSLAM-v0", scenario=GALLERY, gaze_period=0.25)
    env.reset(seed=SEED)
    assert not len(env.unwrapped.snapshot().truth.landmarks)  # which features would follow
    run, corners = env.unwrapped._run, env.unwrapped._perceptions[0].corners
    frames, features = [], 0
    for action in ACTIONS:
        events = env.step(action)[4]["events"]
        features += events["initialised"] - events["deletions"]
        assert features == run.ekf.state.count
        found = run.detections[: int(run.episode.detection_count)].copy()
        memory = corners.memory[corners.memory["id"] > 0]
        frames.append((run.world.state.camera.copy(), found, memory, corners.points[memory["corner"]]))
    return env, frames


def test_the_room_is_that_of_images(flown: Any) -> None:
    env, _ = flown
    images = gym.make("ActiveSLAMPixels-v0", scenario="gallery-pixels", gaze_period=0.25)
    images.reset(seed=SEED)
    for ours, theirs in zip(env.unwrapped._run.world[1:], images.unwrapped._run.world[1:]):
        if ours.shape != env.unwrapped._run.world.landmarks.shape:  # those of the score, which moves with the map
            np.testing.assert_array_equal(ours, theirs)
    np.testing.assert_array_equal(env.observation_space.low, images.observation_space.low)


def test_a_match_is_the_pixel_of_its_corner_and_its_noise(flown: Any) -> None:
    squares = []
    for pose, found, memory, corners in flown[1]:
        for match, pixel, R in zip(found["match"], found["pixel"], found["R"]):
            own = np.flatnonzero(memory["id"] == match)
            if len(own):
                z = np.empty(2)
                p_C = camera_point(rotation_matrix(pose[3:7]), pose, corners[own[0]])
                assert pixel_from_camera_point(flown[0].unwrapped._run.models.true_lens, p_C, z)
                std = memory["std"][own[0]]
                assert any(np.allclose(R, (std * more) ** 2 * np.eye(2)) for more in (1.0, SIGHTED.probation))
                squares.append(((pixel - z) ** 2).sum() / std**2)
    mean, n = np.mean(squares), len(squares)
    assert n > 100 and abs(mean - 2.0) < 5.0 * 2.0 / np.sqrt(n)  # chi^2 of two degrees of freedom has a variance of 4


def test_the_target_is_found_with_a_bias_until_it_is_drawn_again() -> None:
    env = gym.make("ActiveSLAM-v0", scenario=GALLERY, gaze_period=0.05)
    env.reset(seed=SEED)
    run, corners, z = env.unwrapped._run, env.unwrapped._perceptions[0].corners, np.empty(2)
    errors: dict[bytes, list[np.ndarray]] = {}
    for _ in range(60):
        env.step([0, 2])
        pose = run.world.state.camera
        for one in run.detections[: int(run.episode.detection_count)]:
            if -4 <= one["match"] < 0:
                k = -1 - int(one["match"])
                p_C = camera_point(rotation_matrix(pose[3:7]), pose, run.world.fiducials[k])
                assert pixel_from_camera_point(run.models.true_lens, p_C, z)
                errors.setdefault(corners.drawn[k]["bias"].tobytes(), []).append(one["pixel"] - z)
    assert run.ekf.state.bias_dim == 8
    assert 4 <= len(errors) < 30
    biases = np.repeat([np.frombuffer(bias) for bias in errors], [len(found) for found in errors.values()], axis=0)
    share = np.sum(biases * np.concatenate(list(errors.values()))) / np.sum(biases**2)
    assert abs(share - 1.0) < 5.0 * 0.05 / np.sqrt(np.sum(biases**2)) < 0.8  # the noise is 0.05 px
    assert np.std([np.frombuffer(bias) for bias in errors]) == pytest.approx(SIGHTED.fiducial_bias_std, rel=0.6)
