"""What happens during training: a progress bar, checkpoints, and the best weights on held-out rooms."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from stable_baselines3.common.callbacks import BaseCallback, EvalCallback
from stable_baselines3.common.vec_env import VecEnv

from agents.learn.algorithms import HELD_OUT_SEEDS, save_learner


class HeldOutRooms(EvalCallback):
    """The deterministic policy in the same held-out rooms, an episode in each, every `period` decisions and at the end.

    `save_best` is called with the mean return, in the reward's own unit, where it is the best so far.
    """

    def __init__(self, rooms: VecEnv, period: int, best: float, save_best: Callable[[float], None]) -> None:
        super().__init__(rooms, n_eval_episodes=rooms.num_envs, eval_freq=1, verbose=0)
        self.period = period
        self.best_mean_reward = best
        self.save_best = save_best
        self.visited = 0

    def _on_step(self) -> bool:
        return self.num_timesteps % self.period >= self.training_env.num_envs or self._visit()

    def _on_training_end(self) -> None:
        if self.visited < self.num_timesteps:
            self._visit()

    def _visit(self) -> bool:
        self.visited = self.num_timesteps
        self.eval_env.seed(HELD_OUT_SEEDS)
        before = self.best_mean_reward
        going_on = super()._on_step()
        if self.best_mean_reward > before:
            self.save_best(self.best_mean_reward)
        return going_on


class Progress(BaseCallback):
    """A bar with the last mean return of training."""

    def __init__(self, total_steps: int) -> None:
        super().__init__()
        self.total_steps = total_steps

    def _on_training_start(self) -> None:
        from tqdm import tqdm

        rollout = getattr(self.model, "n_steps", 1) * self.training_env.num_envs
        left = -(-(self.total_steps - self.num_timesteps) // rollout) * rollout
        total = self.num_timesteps + left
        self.bar = tqdm(total=total, initial=self.num_timesteps, unit="decision", unit_scale=True)

    def _on_step(self) -> bool:
        self.bar.update(self.training_env.num_envs)
        return True

    def _on_rollout_end(self) -> None:
        returns = [episode["r"] for episode in self.model.ep_info_buffer or ()]
        if returns:
            self.bar.set_postfix_str(f"mean return {np.mean(returns):.0f}")

    def _on_training_end(self) -> None:
        self.bar.close()


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
