"""The batch environment behind Stable-Baselines3's interface, and the log of its episodes."""

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

from stable_baselines3 import DQN, PPO
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.logger import configure
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor

import baselines
from activeslam_gym import observation_layout
from agents.sb3 import ActiveSLAMVecEnv, EpisodeLog, ScaledReward

SHORT: dict[str, Any] = {"gaze_period": 0.25, "duration": 3.0, "lost_position_error": 0.04}


def test_is_the_dummy_vec_env_of_single_environments_but_nothing_follows_a_time_limit() -> None:
    ours = ActiveSLAMVecEnv(4, **SHORT)
    theirs = DummyVecEnv([lambda: gym.make("ActiveSLAM-v0", **SHORT)] * 4)
    for env in (ours, theirs):
        env.seed(5)
    np.testing.assert_array_equal(ours.reset(), theirs.reset())
    ours.action_space.seed(0)
    lost = ended = 0
    for _ in range(40):
        assert ours.reset_infos == theirs.reset_infos
        actions = np.array([ours.action_space.sample() for _ in range(4)])
        (*mine, infos), (*their, expected) = ours.step(actions), theirs.step(actions)
        for array, other in zip(mine, their, strict=True):
            assert array.dtype == other.dtype
            np.testing.assert_array_equal(array, other)
        for info, other, done in zip(infos, expected, mine[2], strict=True):
            assert bool(info) == done
            if done:
                np.testing.assert_array_equal(info.pop("terminal_observation"), other.pop("terminal_observation"))
                assert info == other | {"TimeLimit.truncated": False}
                lost, ended = lost + info["lost"], ended + 1
    assert ours.reset_infos == theirs.reset_infos and 0 < lost < ended


def test_a_gain_is_clipped_and_the_failure_penalty_is_not() -> None:
    plain = ActiveSLAMVecEnv(4, **SHORT)
    scaled = ScaledReward(ActiveSLAMVecEnv(4, **SHORT), 0.1, clip=3.0, penalty_weight=2.0)
    for env in (plain, scaled):
        env.seed(5)
        env.reset()
    plain.action_space.seed(0)
    clipped = lost = 0
    for _ in range(40):
        actions = np.array([plain.action_space.sample() for _ in range(4)])
        (_, rewards, _, infos), found = plain.step(actions), scaled.step(actions)[1]
        lost_penalties = np.array([info["reward_terms"]["lost_penalty"] if info else 0.0 for info in infos])
        gains = np.clip(rewards - lost_penalties, -3.0, 3.0)
        np.testing.assert_allclose(found, 0.1 * (gains + 2.0 * lost_penalties), rtol=1e-5, atol=1e-6)
        clipped, lost = clipped + (gains == 3.0).sum(), lost + (lost_penalties <= -100.0).sum()
    assert clipped > 0 and lost > 0


def test_attributes_and_methods_are_those_of_single_environments() -> None:
    env = ActiveSLAMVecEnv(3)
    env.reset()
    env.step(np.zeros((3, 2), int))
    assert env.get_attr("time") == [0.25] * 3
    assert env.get_attr("render_mode", indices=0) == [None]
    assert env.get_attr("action_space", indices=[0, 2]) == [env.action_space] * 2
    (belief,) = env.get_attr("belief", indices=[1])
    np.testing.assert_array_equal(belief.position, env.unwrapped.belief[1].position)
    scores = env.env_method("motion_scores", "fisher_trace", indices=[0, 2])
    np.testing.assert_array_equal(scores, env.unwrapped.motion_scores("fisher_trace")[[0, 2]])
    assert env.has_attr("scenario") and not env.has_attr("nonsense")
    assert env.env_is_wrapped(Monitor) == [False] * 3
    env.set_attr("label", "mine")
    assert env.get_attr("label", 2) == ["mine"]
    with pytest.raises(ValueError, match="indices"):
        env.set_attr("label", "other", indices=[1])


def test_monitor_counts_episodes_and_a_baseline_is_scored_by_evaluate_policy() -> None:
    env = VecMonitor(ActiveSLAMVecEnv(3, gaze_period=0.5, duration=2.0), info_keywords=("log_score",))
    assert observation_layout(env).size == env.observation_space.shape[0]
    env.reset()
    total = 0.0
    for _ in range(4):
        _, rewards, dones, infos = env.step(np.full((3, 2), (6, 1)))
        total = total + rewards
    assert dones.all() and [info["episode"]["l"] for info in infos] == [4] * 3
    np.testing.assert_allclose([info["episode"]["r"] for info in infos], total, rtol=1e-5)
    assert [info["episode"]["log_score"] for info in infos] == [info["log_score"] for info in infos]
    single = Monitor(gym.make("ActiveSLAM-v0", duration=2.0))
    assert evaluate_policy(baselines.make("mi-fisher", single), single, 2)[0] > 0.0
    returns, lengths = evaluate_policy(baselines.make("mi-fisher", env), env, 3, return_episode_rewards=True)
    assert lengths == [4, 4, 4] and np.isfinite(returns).all()


class Recorded(EpisodeLog):
    """Keeps the `info` of each episode that ends."""

    def __init__(self, **arguments: Any) -> None:
        super().__init__(**arguments)
        self.infos: list[dict[str, Any]] = []

    def _on_step(self) -> bool:
        self.infos += [info for info, done in zip(self.locals["infos"], self.locals["dones"]) if done]
        goes_on = super()._on_step()
        self.means = dict(self.logger.name_to_value)
        return goes_on


@pytest.mark.parametrize("kind", ["batch", "single"])
def test_log_score_and_failures_are_those_of_the_episodes_that_ended(kind: str) -> None:
    short: dict[str, Any] = {"duration": 2.0, "gaze_period": 1.0}
    if kind == "batch":
        model: Any = PPO("MlpPolicy", ActiveSLAMVecEnv(4, **short), n_steps=4, batch_size=8, n_epochs=1)
    else:
        env = make_vec_env("ActiveSLAMDiscrete-v0", 2, env_kwargs=short)
        model = DQN("MlpPolicy", env, buffer_size=100, learning_starts=100)
    model.set_logger(configure(None, []))
    log = Recorded(window=3)
    model.learn(16, callback=log)
    last = log.infos[-3:]
    assert len(log.infos) == 8
    assert log.means["rollout/log_score"] == pytest.approx(np.mean([one["log_score"] for one in last]))
    failures = np.mean([one["lost"] or one["log_score"] < 0.0 for one in last])
    assert log.means["rollout/failures"] == pytest.approx(failures)
    with pytest.raises(ValueError, match="window: 0; allowed"):
        EpisodeLog(window=0)
