"""What counts in active SLAM, logged while a learner of Stable-Baselines3 trains: log score and failures."""

from collections import deque
from collections.abc import Callable
from time import perf_counter

import numpy as np
from stable_baselines3.common.callbacks import BaseCallback


class EpisodeLog(BaseCallback):
    """Log the episodes that end in training, beside what the learner logs itself.

    For any learner of Stable-Baselines3 or sb3-contrib, on `ActiveSLAMVecEnv` as on `make_vec_env`:
    ``PPO("MlpPolicy", env, tensorboard_log="logs").learn(100_000, callback=EpisodeLog())``. Under ``rollout/`` it
    records ``log_score``, the mean [bit], and ``failures``, the share of episodes that were lost or ended with a log
    score under 0.

    Args:
        window: The last so many episodes count.
        write: Called with a line of text whenever as many episodes as environments have ended, for instance `print`:
            decisions so far, mean return and failures of those episodes, decisions a second. No lines if None.

    Raises:
        ValueError: ``window`` is no positive number.
        KeyError: an environment's ``info`` has no ``log_score``: it is none of ActiveSLAM.
    """

    def __init__(self, window: int = 100, write: Callable[[str], object] | None = None) -> None:
        super().__init__()
        if window < 1:
            raise ValueError(f"window: {window}; allowed: 1 or more episodes")
        self._write, self._ended = write, deque[tuple[float, bool, float]](maxlen=window)
        self._new: list[tuple[float, bool, float]] = []  # log score, failure and return of those since the last line
        self._since = 0, 0.0  # decisions and time at the last line

    def _on_training_start(self) -> None:
        self._since = self.num_timesteps, perf_counter()

    def _on_step(self) -> bool:
        ended = [info for info, done in zip(self.locals["infos"], self.locals["dones"]) if done]
        for info in ended:
            score, gained = float(info["log_score"]), float(info.get("episode", {"r": np.nan})["r"])
            self._new.append((score, bool(info["lost"]) or score < 0.0, gained))
            self._ended.append(self._new[-1])
        if ended:
            scores, failed, _ = np.transpose(self._ended)
            self.logger.record("rollout/log_score", float(scores.mean()))
            self.logger.record("rollout/failures", float(failed.mean()))
        if len(self._new) >= self.training_env.num_envs:
            if self._write:
                self._write(self._line())
            self._new, self._since = [], (self.num_timesteps, perf_counter())
        return True

    def _line(self) -> str:
        scores, failed, gained = np.transpose(self._new).mean(axis=1)
        speed = (self.num_timesteps - self._since[0]) / (perf_counter() - self._since[1])
        means = f"return {gained:.0f}, log score {scores:.0f}, failures {100.0 * failed:.0f} %"
        return f"{self.num_timesteps:>9,} decisions: {len(self._new)} episodes, {means}, {speed:.0f} decisions/s"
