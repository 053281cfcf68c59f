"""`agents.sb3.EpisodeLog`, on the batch and on single environments."""

from typing import Any

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")
from stable_baselines3 import DQN, PPO  # noqa: E402
from stable_baselines3.common.env_util import make_vec_env  # noqa: E402
from stable_baselines3.common.logger import Logger, configure  # noqa: E402

import activeslam_gym  # noqa: E402, F401 (registers the environments)
from agents.sb3 import (
    ActiveSLAMVecEnv,  # noqa: E402
    EpisodeLog,  # noqa: E402
)


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


def logger() -> Logger:
    return configure(None, [])


@pytest.mark.parametrize("kind", ["batch", "single"])
def test_log_score_and_failures_are_those_of_the_episodes_that_ended(kind: str) -> None:
    short: dict[str, Any] = {"duration": 2.0, "gaze_period": 1.0}
    if kind == "batch":
        model: Any = PPO("MlpPolicy", ActiveSLAMVecEnv(4, **short), n_steps=4, batch_size=8, n_epochs=1)
    else:
        env = make_vec_env("ActiveSLAMDiscrete-v0", 2, env_kwargs=short)
        model = DQN("MlpPolicy", env, buffer_size=100, learning_starts=100)
    model.set_logger(logger())
    lines: list[str] = []
    log = Recorded(window=3, write=lines.append)
    model.learn(16, callback=log)
    last = log.infos[-3:]
    assert len(log.infos) == 8
    assert log.means["rollout/log_score"] == pytest.approx(np.mean([one["log_score"] for one in last]))
    failures = np.mean([one["lost"] or one["log_score"] < 0.0 for one in last])
    assert log.means["rollout/failures"] == pytest.approx(failures)
    assert len(lines) == 8 // model.n_envs and "decisions/s" in lines[0]


def test_a_window_has_at_least_one_episode() -> None:
    with pytest.raises(ValueError, match="window: 0; allowed"):
        EpisodeLog(window=0)
