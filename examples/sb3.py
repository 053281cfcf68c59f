"""Learners of Stable-Baselines3 and sb3-contrib, unmodified: python examples/sb3.py [PPO [steps]].

PPO, RecurrentPPO (a policy with a memory) and MaskablePPO (no motion is chosen where it is ignored) learn on the batch,
A2C and DQN (on the 21 joint actions) on single environments, as `make_vec_env` makes them.
"""

import sys
import time
from collections.abc import Callable
from functools import partial
from importlib import import_module
from typing import Any, NamedTuple

from gymnasium.wrappers import TransformReward
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import VecEnv, VecMonitor

from agents.sb3 import ActiveSLAMVecEnv, ScaledReward


def batch(count: int, scale: float = 1.0) -> VecEnv:
    """The batch environment; Monitor sees the rewards before they are scaled."""
    return ScaledReward(VecMonitor(ActiveSLAMVecEnv(count)), scale)


def singles(name: str, count: int, scale: float = 1.0) -> VecEnv:
    """The same of single environments."""
    scaled = {"func": lambda reward: scale * reward}
    return make_vec_env(name, count, seed=0, wrapper_class=TransformReward, wrapper_kwargs=scaled)


class Learner(NamedTuple):
    """How an algorithm learns."""

    make: Callable[..., VecEnv]
    environments: int
    rooms: int
    """In which it is judged, before and after."""
    steps: int
    """Decisions."""
    settings: dict[str, Any]


SHARED: dict[str, Any] = {"gamma": 0.995, "seed": 0, "device": "cpu"}
EXPLORING = SHARED | {"ent_coef": 0.01}
OF_PPO = EXPLORING | {"learning_rate": lambda left: 7e-4 * left, "n_steps": 140, "batch_size": 1792, "n_epochs": 4}
"""A rollout is one episode of 35 s of every environment."""
OF_LSTM = {"learning_rate": 7e-4, "n_steps": 70, "batch_size": 560, "policy_kwargs": {"lstm_hidden_size": 64}}
OF_DQN = {"learning_starts": 1_000, "target_update_interval": 1_000, "train_freq": 4, "gradient_steps": 4}
LEARNERS = {
    "PPO": Learner(batch, 64, 32, 89_600, OF_PPO),
    "MaskablePPO": Learner(batch, 64, 32, 89_600, OF_PPO),
    "RecurrentPPO": Learner(batch, 32, 16, 17_920, OF_PPO | OF_LSTM),
    "A2C": Learner(partial(singles, "ActiveSLAM-v0"), 16, 16, 32_000, EXPLORING | {"n_steps": 20}),
    "DQN": Learner(
        partial(singles, "ActiveSLAMDiscrete-v0"), 8, 16, 16_000, SHARED | OF_DQN | {"exploration_fraction": 0.3}
    ),
}
"""Name of the class → how it learns."""
EVALUATION = {"MaskablePPO": "sb3_contrib.common.maskable.evaluation"}


def main(algorithm: str = "PPO", steps: int | None = None) -> tuple[float, float]:
    """Train for `steps` decisions; the mean return [bit] over the same rooms before and after."""
    learner = LEARNERS[algorithm]
    package = "sb3_contrib" if algorithm in ("MaskablePPO", "RecurrentPPO") else "stable_baselines3"
    evaluation = import_module(EVALUATION.get(algorithm, "stable_baselines3.common.evaluation"))
    rooms = learner.make(learner.rooms)

    def mean_return() -> float:
        rooms.seed(1_000_000)  # the same rooms each time
        greedy = algorithm == "DQN"
        return float(evaluation.evaluate_policy(model, rooms, learner.rooms, deterministic=greedy)[0])

    policy = "MlpLstmPolicy" if algorithm == "RecurrentPPO" else "MlpPolicy"
    env = learner.make(learner.environments, 0.05)
    model = getattr(import_module(package), algorithm)(policy, env, **learner.settings)
    before, began = mean_return(), time.monotonic()
    model.learn(steps or learner.steps)
    seconds, after = time.monotonic() - began, mean_return()
    print(f"{package} {algorithm}: {before:.0f} -> {after:.0f} bits, {model.num_timesteps} steps in {seconds:.0f} s")
    return before, after


if __name__ == "__main__":
    main(*sys.argv[1:2], *map(int, sys.argv[2:]))
