"""Masks of actions."""

import gymnasium as gym
import numpy as np
import pytest

from activeslam_gym import Gaze, Motion

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
