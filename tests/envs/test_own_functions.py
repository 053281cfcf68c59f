"""Criteria and rewards of a user's own."""

import math
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from activeslam_gym import Gaze, Motion
from activeslam_gym.envs.reward import REWARDS
from activeslam_gym.kernels import compiled
from baselines import best
from baselines.greedy import Greedy
from examples.extend_estimator import NumpyEkf
from examples.extend_range_sensor import RangeSensor
from tests.support import moments

INFORMATION = "mutual_information"


def information(P: np.ndarray, sight: Any, pixel_var: float) -> float:
    """`mutual_information` in NumPy."""
    return 0.5 * (np.linalg.slogdet(sight.S)[1] / math.log(2.0) - len(sight.S) * math.log2(pixel_var))


ACTIONS = [(Motion.RIGHT, Gaze.LEFT)] * 12
RANGES = {"sensor": RangeSensor, "estimator": NumpyEkf, "association": "known"}


@pytest.mark.parametrize("scenario", ["paper", "corridor", "pixels", RANGES])
def test_a_criterion_of_one_s_own_scores_as_the_kernel_does(scenario: Any) -> None:
    """Under every kind of plan, with every sensor."""
    in_a_kernel = compiled(lambda P, sight, var: sight.S[0, 0])
    pixels = scenario == "pixels"
    if pixels:
        pytest.importorskip("cv2")
    env = gym.make("ActiveSLAMPixels-v0" if pixels else "ActiveSLAM-v0", scenario=scenario, gaze_period=0.25)
    moments(env, 3, ACTIONS[:8])
    inner, horizon = env.unwrapped, 2
    for scores in (inner.motion_scores, inner.gaze_scores, inner.joint_scores):
        np.testing.assert_allclose(scores(information), scores(INFORMATION), rtol=1e-9, atol=1e-9)
        assert np.isfinite(scores(in_a_kernel)).all()
    plans = np.tile(inner._joint_plans[[4, 9, 17]], (1, horizon))
    np.testing.assert_allclose(inner.scores(plans, information), inner.scores(plans, INFORMATION), rtol=1e-9)
    expected = Greedy(env, INFORMATION, INFORMATION).predict(np.zeros(3))[0]
    assert Greedy(env, information, information).predict(np.zeros(3))[0].tolist() == expected.tolist()


def fails(*_: Any) -> float:
    raise KeyError("gone")


WRONG = [
    (lambda *_: math.nan, "must return a finite number {where}, got nan"),
    (lambda *_: None, "must return a finite number {where}, got None"),
    (lambda *_: np.zeros(2), r"must return a finite number {where}, got array\(\[0., 0.\]\)"),
    (fails, "failed {where}: KeyError: 'gone'"),
]


@pytest.mark.parametrize(("wrong", "message"), WRONG)
def test_a_criterion_or_reward_that_gives_no_number_is_an_error_with_its_name(
    wrong: Callable[..., Any], message: str
) -> None:
    begun, name = False, f"{__name__}:(<lambda>|fails)"
    env = gym.make_vec("ActiveSLAM-v0", 2, gaze_period=0.25, reward=lambda e: wrong() if begun else 0.0)
    env.reset(seed=0)
    begun = True
    where = r"for \(motion, gaze, frames\) \(0, 2, 20\) of plan 0"
    with pytest.raises(ValueError, match=f"^criterion '{name}' {message.format(where=where)}"):
        env.unwrapped.motion_scores(wrong)
    with pytest.raises(
        ValueError, match=f"^reward '.*<lambda>' {message.format(where='after 1 steps of environment 0')}"
    ):
        env.step(np.zeros((2, 2), int))


def test_a_lost_filter_scores_nan_asks_no_criterion_of_one_s_own_and_best_stays() -> None:
    """The best of scores that are all NaN was FORWARD; NaN counts as worse than any number."""
    env = gym.make("ActiveSLAM-v0")
    env.reset(seed=0)
    env.unwrapped._run.estimate.covariance[:6, :6] = -np.eye(6)
    for criterion in (fails, INFORMATION):
        scores = env.unwrapped.motion_scores(criterion)
        assert np.isnan(scores).all() and best(scores) == Motion.STAY
    assert best(np.array([[np.nan] * 3, [np.nan, 0.0, -1.0]])).tolist() == [Gaze.STAY, Gaze.LEFT]


@pytest.mark.filterwarnings("error")
def test_a_reward_may_be_a_number_of_32_bits() -> None:
    env = gym.make("ActiveSLAM-v0", reward=lambda e: np.float32(e.log_score))
    env.reset(seed=0)
    assert math.isfinite(float(env.step(np.zeros(2, int))[1]))


def accuracy(e: Any) -> float:
    return -math.log2(1e-3 + e.position_error)


def test_a_reward_of_one_s_own_is_its_gain_and_has_its_name_in_info() -> None:
    """As an object, and by its name, with which the spec is JSON."""
    name = f"{__name__}:accuracy"
    _, rewards, infos = moments(gym.make("ActiveSLAM-v0", reward=accuracy), 3, ACTIONS)
    by_name = gym.make("ActiveSLAM-v0", reward=name)
    assert by_name.spec is not None and name in by_name.spec.to_json()
    np.testing.assert_array_equal(moments(by_name, 3, ACTIONS)[1], rewards)
    accuracies = [-math.log2(1e-3 + info["position_error"]) for info in infos]
    np.testing.assert_allclose(rewards, np.diff(accuracies), atol=1e-12)
    assert [info["reward_terms"][name] for info in infos] == [0.0, *rewards]
    assert list(infos[0]["reward_terms"]) == [*REWARDS, "lost_penalty", name]


def minus_entropy(e: Any) -> float:
    return -e.entropy


@pytest.mark.parametrize("penalty", [True, False])
def test_a_copy_of_a_reward_is_that_reward_to_the_bit(penalty: bool) -> None:
    """Through losses, the failure penalty and autoresets."""
    name = f"{__name__}:minus_entropy"
    limit = 0.02 if penalty else 0.5
    settings: dict[str, Any] = {"gaze_period": 0.25, "duration": 4.0, "lost_position_error": limit}
    actions = np.tile((Motion.RIGHT, Gaze.LEFT), (3, 1))
    batches = [gym.make_vec("ActiveSLAM-v0", 3, reward=reward, **settings) for reward in (minus_entropy, "entropy")]
    for env in batches:
        env.reset(seed=3)
    lost = 0
    for _ in range(40):
        (_, mine, *_, infos), (_, theirs, *_) = (env.step(actions) for env in batches)
        np.testing.assert_array_equal(mine, theirs)
        np.testing.assert_array_equal(infos["reward_terms"][name], infos["reward_terms"]["entropy"])
        assert infos["reward_terms"][f"_{name}"].all()
        lost += int((infos["reward_terms"]["lost_penalty"] < 0.0).sum())
    assert (lost > 0) == penalty
