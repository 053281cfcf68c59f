"""sb3-contrib's MaskablePPO: no motion is chosen where it is ignored: python examples/sb3_maskable_ppo.py [steps]."""

import sys
import time

from sb3_contrib import MaskablePPO
from sb3_contrib.common.maskable.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import VecMonitor

from agents.sb3_vec_env import ActiveSLAMVecEnv, ScaledReward


def main(steps: int = 89_600) -> tuple[float, float]:
    """Train for `steps` decisions; the mean return [bit] over 32 rooms before and after."""
    rooms = VecMonitor(ActiveSLAMVecEnv(32))

    def mean_return() -> float:
        rooms.seed(1_000_000)  # the same rooms each time
        return float(evaluate_policy(model, rooms, n_eval_episodes=32, deterministic=False)[0])

    env = ScaledReward(VecMonitor(ActiveSLAMVecEnv(64)), 0.05)
    model = MaskablePPO(
        "MlpPolicy",
        env,
        learning_rate=lambda left: 7e-4 * left,
        n_steps=140,  # one episode of 35 s
        batch_size=1792,
        n_epochs=4,
        gamma=0.995,
        ent_coef=0.01,
        seed=0,
        device="cpu",
    )
    before, began = mean_return(), time.monotonic()
    model.learn(steps)
    seconds, after = time.monotonic() - began, mean_return()
    print(f"sb3-contrib MaskablePPO: {before:.0f} -> {after:.0f} bits, {model.num_timesteps} steps in {seconds:.0f} s")
    return before, after


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
