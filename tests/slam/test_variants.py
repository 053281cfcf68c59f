"""The compiled estimators: which keep what no camera can measure, and that a batch of each is the single."""

import gymnasium as gym
import numpy as np
import pytest

import baselines
from activeslam_gym.config import TRAINING_SEED
from activeslam_gym.evaluation import play
from activeslam_gym.slam.belief import INVARIANT, INVERSE_DEPTH, PLAIN, POINT, Belief
from activeslam_gym.slam.estimate import COMPILED
from activeslam_gym.slam.kalman import shift_mean, update_covariance
from tests.support import PAPER, dense_H, joint_covariance, random_belief, sight_of, turn_of_everything

SHIFT = 0.03


def belief_of(variant: int) -> Belief:
    """Some features."""
    belief = random_belief(PAPER, [POINT, INVERSE_DEPTH, INVERSE_DEPTH, POINT], np.random.default_rng(0))
    belief.state.variant = variant
    return belief


def test_a_turn_of_camera_and_map_is_not_measured_and_stays_as_uncertain_as_it_was() -> None:
    belief = belief_of(INVARIANT)
    dim, N = belief.state.dim, turn_of_everything(belief)
    np.testing.assert_allclose(dense_H(sight_of(belief)) @ N, 0.0, atol=1e-9)
    belief.covariance[:dim, :dim] = N @ N.T
    delta = SHIFT * np.random.default_rng(1).standard_normal(dim)
    delta[3:6] = 0.0
    shift_mean(belief, delta)
    update_covariance(belief, np.zeros((0, dim)), delta)
    N = turn_of_everything(belief)
    np.testing.assert_allclose(joint_covariance(belief), N @ N.T, atol=1e-12)
    np.testing.assert_allclose(dense_H(sight_of(belief)) @ N, 0.0, atol=1e-9)


def test_the_plain_filter_keeps_the_covariance_and_so_measures_a_turn() -> None:
    belief = belief_of(PLAIN)
    before, N = joint_covariance(belief), turn_of_everything(belief)
    delta = SHIFT * np.random.default_rng(1).standard_normal(len(before))
    shift_mean(belief, delta)
    update_covariance(belief, np.zeros((0, len(delta))), delta)
    np.testing.assert_allclose(joint_covariance(belief), before, rtol=1e-14)
    assert np.abs(dense_H(sight_of(belief)) @ N).max() > 1.0


@pytest.mark.parametrize("name", COMPILED[1:])
def test_a_batch_is_the_single_to_the_bit(name: str) -> None:
    seeds = [TRAINING_SEED, TRAINING_SEED + 1]
    given = {"scenario": {"estimator": name}, "duration": 3.0, "end_when_lost": False}
    many = gym.make_vec("ActiveSLAM-v0", num_envs=2, num_threads=1, autoreset_mode="DISABLED", **given)
    batch = play(many, baselines.make("sweep", many), seeds)
    one = gym.make("ActiveSLAM-v0", **given)
    single = play(one, baselines.make("sweep", one), seeds[1:])[0]
    np.testing.assert_array_equal(batch[1].log_score, single.log_score)
    assert single.landmarks_mapped[-1] > 0
