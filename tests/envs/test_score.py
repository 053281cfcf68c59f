"""What a run is scored by: the price of a loss, whose each feature is, and the labels that may be given."""

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from activeslam_gym.config import Scenario
from activeslam_gym.envs.evaluation import LOSS, features_of_landmarks, judge_matches, match_to_truth
from activeslam_gym.envs.reward import REWARDS
from activeslam_gym.envs.run import NO_OWNER, OWNER
from activeslam_gym.metrics import UNSOUND_LOG_SCORE
from activeslam_gym.slam.belief import POINT
from activeslam_gym.slam.detection import REJECTED
from activeslam_gym.slam.filter import detections_of
from activeslam_gym.world.simulator import CLUTTER_LABEL
from tests.support import PAPER, estimate_of, random_belief, simulation_of

K = 2


def made(**arguments: Any) -> gym.Env:
    """An environment in which half of the runs are lost within seconds."""
    return gym.make("ActiveSLAM-v0", duration=5.0, lost_position_error=0.06, **arguments)


def lost_run(env: gym.Env, seed: int = 0) -> tuple[list[float], list[dict[str, Any]], list[bool]]:
    """Rewards, infos and ends of the first run of RIGHT and LEFT that is lost before its last second."""
    while True:
        rewards, infos, ends = [], [env.reset(seed=seed)[1]], []
        for step in range(20):
            _, reward, terminated, truncated, info = env.step((2 + step // 4 % 2, 1))
            rewards, infos, ends = [*rewards, float(reward)], [*infos, info], [*ends, terminated]
            if terminated or truncated:
                break
        if any(info["lost"] for info in infos[4:16]) and not any(info["lost"] for info in infos[:4]):
            return rewards, infos, ends
        seed += 1


@pytest.mark.parametrize("reward", REWARDS)
def test_a_loss_makes_the_return_negative_by_its_price(reward: str) -> None:
    rewards, infos, ends = lost_run(made(reward=reward))
    gained = sum(info["reward_terms"][reward] for info in infos)
    assert ends[-1] and infos[-1]["lost"] and infos[-1]["lost_at_end"]
    assert sum(rewards) == pytest.approx(min(gained, 0.0) - LOSS)
    assert infos[-1]["reward_terms"]["lost_penalty"] == pytest.approx(-max(gained, 0.0) - LOSS)


def test_a_lost_run_may_go_on_and_pays_once() -> None:
    (ended, short, _), (rewards, infos, ends) = lost_run(made()), lost_run(made(end_when_lost=False))
    at = len(ended)
    assert not any(ends) and len(rewards) == 20 and rewards[:at] == ended
    assert [info["lost"] for info in infos] == [False] * at + [True] * (21 - at)
    assert [info["reward_terms"]["lost_penalty"] < 0.0 for info in infos].count(True) == 1
    assert all(info["lost_at_end"] == (info["position_error"] > 0.06) for info in infos[1:])
    assert sum(rewards) == pytest.approx(
        infos[0]["entropy"] - infos[-1]["entropy"] + infos[at]["reward_terms"]["lost_penalty"]
    )
    assert short[-1] == infos[at]


def test_a_belief_that_is_not_positive_definite_scores_the_floor() -> None:
    env = gym.make("ActiveSLAM-v0", end_when_lost=False, reward="log_score")
    _, first = env.reset(seed=0)
    simulation_of(env).ekf.covariance[6, 6] = -1.0
    _, reward, terminated, _, info = env.step((6, 2))
    assert info["lost"] and not terminated
    assert info["log_score"] == UNSOUND_LOG_SCORE == -10_000.0
    assert reward == pytest.approx(UNSOUND_LOG_SCORE - LOSS)
    assert info["reward_terms"]["entropy"] == 0.0 and info["entropy"] == first["entropy"]


def test_a_feature_is_what_initialised_it_for_life() -> None:
    belief = random_belief(PAPER, [POINT] * 3, np.random.default_rng(0))
    owner, estimate = np.zeros(len(belief.feature), OWNER), estimate_of(belief)
    detections = detections_of(np.zeros((3, 2)))
    detections["match"] = 1, 2, 3

    def frame(*labels: int) -> tuple[int, int]:
        """Wrong matches and features from clutter, where the three features are matched to these labels."""
        match_to_truth(owner, estimate)
        return judge_matches(owner, estimate, K, detections, np.array(labels))

    assert frame(K + 2, CLUTTER_LABEL, 0) == (0, 1)
    for _ in range(5):  # no majority changes that
        assert frame(K, CLUTTER_LABEL, K) == (3, 0)
    assert frame(K + 2, K + 1, 0) == (1, 0)
    assert owner["landmark"][:3].tolist() == [2, NO_OWNER, NO_OWNER]


def test_the_oldest_eligible_feature_stands_for_its_landmark() -> None:
    owner, everyone = np.zeros(4, OWNER), np.ones(4, bool)
    owner["landmark"] = 1, NO_OWNER, 1, 0
    assert features_of_landmarks(owner, 3, everyone).tolist() == [3, 0, -1]
    assert features_of_landmarks(owner, 3, np.array([False, True, True, True])).tolist() == [3, 2, -1]


@pytest.mark.parametrize("initialisation", ["inverse_depth", "depth_particles"])
def test_with_given_labels_no_match_is_wrong_and_no_landmark_is_mapped_twice(initialisation: str) -> None:
    scenario = Scenario(association="known", clutter_rate=2.0, initialisation=initialisation)
    env = gym.make("ActiveSLAM-v0", scenario=scenario, gaze_period=0.25, end_when_lost=False)
    env.reset(seed=3)
    matched = clutter = 0
    for step in range(60):
        _, _, _, _, info = env.step((step // 4 % 2 + 2, 1))
        labels = env.unwrapped.labels
        owned = labels.owners[labels.owners != NO_OWNER]
        assert info["events"]["wrong_matches"] == info["events"]["false_features"] == 0
        assert len(set(owned.tolist())) == len(owned) == len(labels.owners)
        assert (labels.matched[labels.detected == CLUTTER_LABEL] == REJECTED).all()
        matched, clutter = matched + (labels.matched > 0).sum(), clutter + (labels.detected == CLUTTER_LABEL).sum()
    assert matched > 100 and clutter > 20 and info["landmarks_mapped"] >= 2
