"""sb3-contrib's RecurrentPPO, a policy with a memory, on the batch: python examples/sb3_recurrent_ppo.py [steps]."""

import sys
import time

from sb3_contrib import RecurrentPPO
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import VecMonitor

from agents.sb3_vec_env import ActiveSLAMVecEnv, ScaledReward


def main(steps: int = 17_920) -> tuple[float, float]:
    """Train for `steps` decisions; the mean return [bit] over 16 rooms before and after."""
    rooms = VecMonitor(ActiveSLAMVecEnv(16))

    def mean_return() -> float:
        rooms.seed(1_000_000)  # the same rooms each time
        return float(evaluate_policy(model, rooms, n_eval_episodes=16, deterministic=False)[0])

    env = ScaledReward(VecMonitor(ActiveSLAMVecEnv(32)), 0.05)
    model = RecurrentPPO(
        "MlpLstmPolicy",
        env,
        learning_rate=7e-4,
        n_steps=70,
        batch_size=560,
        n_epochs=4,
        gamma=0.995,
        ent_coef=0.01,
        policy_kwargs={"lstm_hidden_size": 64},
        seed=0,
        device="cpu",
    )
    before, began = mean_return(), time.monotonic()
    model.learn(steps)
    seconds, after = time.monotonic() - began, mean_return()
    print(f"sb3-contrib RecurrentPPO: {before:.0f} -> {after:.0f} bits, {model.num_timesteps} steps in {seconds:.0f} s")
    return before, after


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
