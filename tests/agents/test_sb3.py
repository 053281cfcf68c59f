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
        for indices in (None, [3, 1]):
            np.testing.assert_array_equal(*(env.env_method("action_masks", indices=indices) for env in (ours, theirs)))
    assert ours.reset_infos == theirs.reset_infos and 0 < lost < ended
    assert ours.metadata["render_fps"] == theirs.envs[0].metadata["render_fps"]


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


def test_a_baseline_is_scored_by_evaluate_policy() -> None:
    single = Monitor(gym.make("ActiveSLAM-v0", duration=2.0))
    assert evaluate_policy(baselines.make("mi-fisher", single), single, 2)[0] > 0.0
    env = VecMonitor(ActiveSLAMVecEnv(3, gaze_period=0.5, duration=2.0), info_keywords=("log_score",))
    assert observation_layout(env).size == env.observation_space.shape[0]
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
