"""The training batches, and the learners of Stable-Baselines3 on them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from stable_baselines3 import A2C, DQN, PPO
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecEnv, VecMonitor

from activeslam_gym import observation_layout
from agents.files import written_whole
from agents.learned import policy_arguments
from agents.learning import Learning
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


def make_batch(learning: Learning, num_envs: int, seed: int) -> ScaledReward:
    """A batch behind SB3's interface; its rewards are clipped and scaled, its episodes recorded as they are."""
    env = ActiveSLAMVecEnv(
        num_envs,
        discrete=learning.algorithm == "dqn",
        gaze_period=learning.decision_period,
        duration=learning.duration,
        reward=learning.reward,
    )
    env.seed(seed)
    return ScaledReward(VecMonitor(env), learning.reward_scale, learning.reward_clip)


def make_learner(learning: Learning, env: VecEnv, logs: Path) -> Any:
    """A new learner. PPO's rollout is one episode of every environment, learned from in 5 minibatches, 4 times."""
    steps = learning.steps_per_episode
    own: dict[str, dict[str, Any]] = {
        "ppo": {
            "n_steps": steps,
            "batch_size": max(2, steps * learning.num_envs // 5),
            "n_epochs": 4,
            "gae_lambda": 0.95,
            "ent_coef": learning.entropy_bonus,
        },
        "a2c": {"ent_coef": learning.entropy_bonus},
        "dqn": {"buffer_size": REPLAY_STEPS},
    }
    return CLASSES[learning.algorithm](
        "MlpPolicy",
        env,
        learning_rate=lambda left: learning.learning_rate * max(left, _LAST_RATE),
        gamma=learning.gamma,
        policy_kwargs=policy_arguments(observation_layout(env.unwrapped), learning.width),
        tensorboard_log=str(logs),
        seed=learning.seed,
        device="cpu",
        **own[learning.algorithm],
    )


def load_learner(learning: Learning, env: VecEnv, checkpoint: Path) -> Any:
    """The learner as it was saved, in rooms that it has not yet seen."""
    learner = CLASSES[learning.algorithm].load(checkpoint, env=env, device="cpu")
    env.seed(TRAINING_SEEDS + learning.num_envs * learning.seed + learner.num_timesteps)
    return learner


def save_learner(learner: BaseAlgorithm, checkpoint: Path) -> None:
    """The learner with its optimiser, whole or not at all; DQN's memory is left out."""
    with written_whole(checkpoint, "wb") as file:
        learner.save(file)
