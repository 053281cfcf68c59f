"""Masks, wrappers and the render size: what clients ask of an environment beyond its observation."""

import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from activeslam_gym import Gaze, Motion, observation_layout
from activeslam_gym.wrappers import TokenObservation, TokenVectorObservation

NAMES = ("ActiveSLAM-v0", "ActiveSLAMDiscrete-v0")


def indices(mask: np.ndarray) -> list[int]:
    return np.flatnonzero(mask).tolist()


@pytest.mark.parametrize("name", NAMES)
def test_a_mask_leaves_all_motions_where_one_is_read_and_the_one_under_way_elsewhere(name: str) -> None:
    """Of a single environment and of each in a batch."""
    one, envs = gym.make(name, gaze_period=0.25).unwrapped, gym.make_vec(name, num_envs=3, gaze_period=0.25)
    pair = (Motion.UP, Gaze.LEFT)
    action = np.array(pair if name == NAMES[0] else 3 * Motion.UP + Gaze.LEFT)
    under_way = [Motion.UP, 7, 8, 9] if name == NAMES[0] else [3 * Motion.UP + gaze for gaze in Gaze]
    one.reset(seed=0)
    envs.reset(seed=0)
    for step in range(5):
        masks = envs.unwrapped.action_masks()
        assert [indices(mask) for mask in masks] == [indices(one.action_masks())] * 3
        assert indices(masks[0]) == (under_way if step % 4 else [*range(masks.shape[1])])
        one.step(action)
        envs.step(np.stack([action] * 3))


def test_a_motion_that_is_masked_makes_no_difference() -> None:
    """The law behind the mask: between periods any motion leads to the same observation."""
    observations = []
    for other in (Motion.DOWN, Motion.UP):
        env = gym.make("ActiveSLAM-v0")
        env.reset(seed=3)
        env.step((Motion.UP, Gaze.LEFT))
        observations.append([env.step((other, Gaze.LEFT))[0] for _ in range(3)])
    np.testing.assert_array_equal(*observations)


def test_stable_baselines_asks_each_environment_for_its_mask() -> None:
    pytest.importorskip("stable_baselines3")
    from agents.sb3_vec_env import ActiveSLAMVecEnv

    env = ActiveSLAMVecEnv(2)
    env.reset()
    env.step(np.array([[Motion.LEFT, 0], [Motion.DOWN, 0]]))
    masks = np.stack(env.env_method("action_masks"))
    assert [indices(mask) for mask in masks] == [[Motion.LEFT, 7, 8, 9], [Motion.DOWN, 7, 8, 9]]
    assert indices(env.env_method("action_masks", indices=[1])[0]) == [Motion.DOWN, 7, 8, 9]


def test_the_observation_in_parts_is_the_flat_one() -> None:
    flat = gym.make("ActiveSLAM-v0")
    layout, observation = observation_layout(flat), flat.reset(seed=0)[0]
    parts = TokenObservation(gym.make("ActiveSLAM-v0"))
    given = parts.reset(seed=0)[0]
    assert parts.observation_space.contains(given)
    np.testing.assert_array_equal(np.concatenate((given["global"], given["tokens"].ravel())), observation)
    tokens = observation[layout.tokens].reshape(layout.token_shape)
    np.testing.assert_array_equal(given["present"], np.abs(tokens).any(axis=1))
    assert 0 < given["present"].sum() < len(tokens)
    assert parts.observation_space.contains(parts.step(parts.action_space.sample())[0])
    assert gym.make(parts.spec.to_json() and parts.spec).observation_space == parts.observation_space


def test_a_batch_in_parts_has_a_leading_axis() -> None:
    envs = TokenVectorObservation(gym.make_vec("ActiveSLAM-v0", num_envs=2))
    observations = envs.reset(seed=0)[0]
    assert envs.observation_space.contains(observations)
    single = TokenObservation(gym.make("ActiveSLAM-v0")).reset(seed=1)[0]
    for name, part in single.items():
        np.testing.assert_array_equal(observations[name][1], part)
    assert envs.observation_space.contains(envs.step(envs.action_space.sample())[0])


@pytest.mark.usefixtures("no_screen")
@pytest.mark.parametrize("name", NAMES)
def test_gymnasiums_own_checker_passes_without_a_screen(name: str) -> None:
    """`human` is among the render modes: it warns, and goes on without a window."""
    env = gym.make(name, gaze_period=0.25, duration=1.0)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        check_env(env.unwrapped)
    assert any("needs a screen and none was found" in str(warning.message) for warning in caught)


def test_a_picture_has_the_size_that_was_asked_for() -> None:
    pytest.importorskip("matplotlib")
    env = gym.make("ActiveSLAM-v0", render_mode="rgb_array", render_size=(480, 300))
    env.reset(seed=0)
    assert env.render().shape == (300, 480, 3)
    envs = gym.make_vec("ActiveSLAM-v0", num_envs=2, render_mode="rgb_array", render_size=(128, 96))
    envs.reset(seed=0)
    assert [picture.shape for picture in envs.render()] == [(96, 128, 3)] * 2


def test_a_size_of_a_picture_is_checked() -> None:
    for size in (None, 5, "ab", (640,), (640, 480, 3), (0, 480), (640, -1), (1e3, 480), (640, 10**9)):
        for make in (gym.make, gym.make_vec):
            with pytest.raises(ValueError, match="render_size must be"):
                make("ActiveSLAM-v0", render_size=size)
