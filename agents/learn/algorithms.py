"""The training batches, and the learners of Stable-Baselines3 on them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from stable_baselines3 import A2C, DQN, PPO
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecEnv, VecMonitor

from activeslam_gym import observation_layout
from activeslam_gym.files import written_whole
from agents.learn.recipe import Recipe
from agents.learn.weights import policy_arguments
from agents.sb3_vec_env import ActiveSLAMVecEnv, ScaledReward

TRAINING_SEEDS = 2**32
"""Training rooms have seeds from here on, so that no room of the study is among them."""
HELD_OUT_SEEDS = 3_000_000
"""The rooms that choose the best weights: none of training, none of the study."""
REPLAY_STEPS = 100_000
"""What DQN remembers: some hundreds of megabytes of observations."""
_LAST_RATE = 0.05
"""The learning rate's last value, relative to its first."""

CLASSES: dict[str, type[BaseAlgorithm]] = {"ppo": PPO, "a2c": A2C, "dqn": DQN}


def make_batch(recipe: Recipe, num_envs: int, seed: int) -> ScaledReward:
    """A batch behind SB3's interface; its rewards are clipped and scaled, its episodes recorded as they are."""
    arguments: dict[str, Any] = {
        "gaze_period": recipe.decision_period,
        "duration": recipe.duration,
        "reward": recipe.reward,
    }
    env = ActiveSLAMVecEnv(num_envs, discrete=recipe.algorithm == "dqn", **arguments)
    env.seed(seed)
    return ScaledReward(VecMonitor(env), recipe.reward_scale, recipe.reward_clip)


def make_learner(recipe: Recipe, env: VecEnv, logs: Path) -> Any:
    """A new learner. PPO's rollout is one episode of every environment, learned from in 5 minibatches, 4 times."""
    steps, entropy = recipe.steps_per_episode, {"ent_coef": recipe.entropy_bonus}
    rollout = {"n_steps": steps, "batch_size": max(2, steps * recipe.num_envs // 5), "n_epochs": 4, "gae_lambda": 0.95}
    own: dict[str, dict[str, Any]] = {"ppo": rollout | entropy, "a2c": entropy, "dqn": {"buffer_size": REPLAY_STEPS}}
    return CLASSES[recipe.algorithm](
        "MlpPolicy",
        env,
        learning_rate=lambda left: recipe.learning_rate * max(left, _LAST_RATE),
        gamma=recipe.gamma,
        policy_kwargs=policy_arguments(observation_layout(env.unwrapped), recipe.width),
        tensorboard_log=str(logs),
        seed=recipe.seed,
        device="cpu",
        **own[recipe.algorithm],
    )


def load_learner(recipe: Recipe, env: VecEnv, checkpoint: Path) -> Any:
    """The learner as it was saved, in rooms that it has not yet seen."""
    learner = CLASSES[recipe.algorithm].load(checkpoint, env=env, device="cpu")
    env.seed(TRAINING_SEEDS + recipe.num_envs * recipe.seed + learner.num_timesteps)
    return learner


def save_learner(learner: BaseAlgorithm, checkpoint: Path) -> None:
    """The learner with its optimiser, whole or not at all; DQN's memory is left out."""
    with written_whole(checkpoint) as unfinished:
        learner.save(unfinished)
