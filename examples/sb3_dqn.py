"""Stable-Baselines3's DQN on the discrete environment: python examples/sb3_dqn.py [steps]."""

import sys
import time

from gymnasium.wrappers import TransformReward
from stable_baselines3 import DQN
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy

import activeslam_gym  # noqa: F401  (registers the environments)


def main(steps: int = 16_000) -> tuple[float, float]:
    """Train for `steps` decisions; the mean return [bit] over 16 rooms before and after."""
    rooms = make_vec_env("ActiveSLAMDiscrete-v0", n_envs=16)

    def mean_return() -> float:
        rooms.seed(1_000_000)  # the same rooms each time
        return float(evaluate_policy(model, rooms, n_eval_episodes=16)[0])

    scaled = {"func": lambda reward: 0.05 * reward}
    env = make_vec_env("ActiveSLAMDiscrete-v0", 8, seed=0, wrapper_class=TransformReward, wrapper_kwargs=scaled)
    model = DQN(
        "MlpPolicy",
        env,
        learning_starts=1_000,
        train_freq=4,
        gradient_steps=4,
        target_update_interval=1_000,
        exploration_fraction=0.3,
        gamma=0.995,
        seed=0,
        device="cpu",
    )
    before, began = mean_return(), time.monotonic()
    model.learn(steps)
    seconds, after = time.monotonic() - began, mean_return()
    print(f"SB3 DQN: {before:.0f} -> {after:.0f} bits, {model.num_timesteps} steps in {seconds:.0f} s")
    return before, after


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
