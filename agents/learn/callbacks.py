"""What happens during training: a progress bar, checkpoints, and the best weights on held-out rooms."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from stable_baselines3.common.callbacks import BaseCallback, EvalCallback
from stable_baselines3.common.vec_env import VecEnv

from agents.learn.algorithms import save_learner
from agents.learn.card import FLOOR


class Progress(BaseCallback):
    """A bar that tells what is being done, and the median return of the last episodes of training."""

    def __init__(self, total_steps: int) -> None:
        super().__init__()
        self.total_steps = total_steps
        self.bar: Any = None

    def doing(self, what: str) -> None:
        """Tell what takes time now."""
        self.bar.set_description_str(what)

    def say(self, line: str) -> None:
        """Leave a line above the bar."""
        self.bar.write(line)

    def close(self) -> None:
        """Take the bar away, if there is one."""
        if self.bar is not None:
            self.bar.close()

    def _on_training_start(self) -> None:
        from tqdm import tqdm

        rollout = getattr(self.model, "n_steps", 1) * self.training_env.num_envs
        left = -(-(self.total_steps - self.num_timesteps) // rollout) * rollout
        total = self.num_timesteps + left
        self.bar = tqdm(total=total, initial=self.num_timesteps, unit="decision", unit_scale=True)

    def _on_rollout_start(self) -> None:
        self.doing("flying")

    def _on_step(self) -> bool:
        self.bar.update(self.training_env.num_envs)
        return True

    def _on_rollout_end(self) -> None:
        returns = [episode["r"] for episode in self.model.ep_info_buffer or ()]
        if returns:
            self.bar.set_postfix_str(f"median return while exploring {np.median(returns):.0f}", refresh=False)
        self.doing("learning")


class HeldOutRooms(EvalCallback):
    """The deterministic policy in the same held-out rooms, an episode in each, every `period` decisions and at the end.

    `save_best` is called with the mean return, in the reward's own unit and at least `FLOOR` a room, where it is the
    best so far.
    """

    def __init__(
        self, rooms: VecEnv, seed: int, period: int, best: float, save_best: Callable[[float], None], progress: Progress
    ) -> None:
        super().__init__(rooms, n_eval_episodes=rooms.num_envs, eval_freq=1, verbose=0)
        self.seed = seed
        self.period = period
        self.best = best
        self.save_best = save_best
        self.progress = progress
        self.visited = 0
        self.returns: list[float] = []
        self.lost: list[bool] = []

    def _on_step(self) -> bool:
        return self.num_timesteps % self.period >= self.training_env.num_envs or self._visit()

    def _on_training_end(self) -> None:
        if self.visited < self.num_timesteps:
            self._visit()

    def _visit(self) -> bool:
        self.visited = self.num_timesteps
        self.progress.doing(f"{self.eval_env.num_envs} held-out rooms")
        self.eval_env.seed(self.seed)
        self.returns, self.lost = [], []
        going_on = super()._on_step()
        found = float(np.maximum(self.returns, FLOOR).mean())
        if better := found > self.best:
            self.best = found
            self.save_best(found)
        returns = f"mean return {found:.0f}, median {np.median(self.returns):.0f}"
        told = f"{returns}, lost in {100 * np.mean(self.lost):.0f} %"
        self.progress.say(f"{self.num_timesteps:>9,} decisions: held-out rooms {told}{'; kept' if better else ''}")
        self.progress.doing("flying")
        return going_on

    def _log_success_callback(self, locals_: dict[str, Any], globals_: dict[str, Any]) -> None:
        """Called at every step of the visit: what did the run that ended here bring, and was it lost?"""
        if locals_["done"]:
            self.returns.append(float(locals_["info"]["episode"]["r"]))
            self.lost.append(bool(locals_["info"]["lost"]))


class Checkpoints(BaseCallback):
    """The learner's state in a file, every `period` decisions, to go on from."""

    def __init__(self, checkpoint: Path, period: int) -> None:
        super().__init__()
        self.checkpoint = checkpoint
        self.period = period

    def _on_step(self) -> bool:
        if self.num_timesteps % self.period < self.training_env.num_envs:
            save_learner(self.model, self.checkpoint)
        return True
