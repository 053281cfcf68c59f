"""`python -m agents train`: PPO (or A2C) from Stable-Baselines3 on the native batch."""

from __future__ import annotations

import platform
import time
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal

TRAINING_SEEDS = 2**32
"""Training rooms have seeds from here on, so that no room of the study is among them."""
_LAST_RATE = 0.05
"""The learning rate's last value, relative to its first."""
CHECKPOINT = "checkpoint.zip"
WEIGHTS = "policy.npz"


@dataclass(frozen=True)
class Args:
    """Train a policy; --out gets its weights and card, a checkpoint to resume from, and TensorBoard logs."""

    out: Path = Path("results/train")
    """Folder of the results; it is resumed where it holds a checkpoint."""
    algorithm: Literal["ppo", "a2c"] = "ppo"
    """Learner of Stable-Baselines3."""
    reward: str = "entropy"
    """Reward of the environment."""
    total_steps: int = 1_000_000
    """Decisions in all."""
    decision_period: float = 0.25
    """Time between decisions, the environment's gaze_period [s]."""
    num_envs: int = 64
    """Environments in the batch."""
    seed: int = 0
    """Seed of the rooms and the learner."""
    gamma: float = 0.995
    """Discount per decision."""
    learning_rate: float = 5e-4
    """First learning rate; it falls linearly to a twentieth."""
    entropy_bonus: float = 0.01
    """Weight of the policy's own entropy."""
    reward_scale: float = 0.05
    """Constant factor of the reward; it is not normalised, which would clip the forfeit."""
    width: int = 64
    """Units of each layer."""


def check(args: Args) -> None:
    """Raises ValueError when an argument has no meaning, naming it, its value and what is allowed."""
    for name in ("total_steps", "num_envs", "width", "decision_period", "learning_rate", "reward_scale"):
        if not getattr(args, name) > 0:
            raise ValueError(f"{name} must be positive, got {getattr(args, name)!r}")
    if not 0.0 < args.gamma <= 1.0:
        raise ValueError(f"gamma must be in (0, 1], got {args.gamma!r}")


def make_env(args: Args) -> Any:
    """The training batch behind SB3's interface, its rewards scaled and its episodes recorded."""
    from stable_baselines3.common.vec_env import VecMonitor

    from agents.sb3_vec_env import ActiveSLAMVecEnv, ScaledReward

    env = ActiveSLAMVecEnv(args.num_envs, gaze_period=args.decision_period, reward=args.reward)
    env.seed(TRAINING_SEEDS + args.num_envs * args.seed)
    return ScaledReward(VecMonitor(env), args.reward_scale)


def make_learner(args: Args, env: Any) -> Any:
    """The learner, from the folder's checkpoint if there is one."""
    from stable_baselines3 import A2C, PPO
    from stable_baselines3.common.vec_env import VecEnv

    from activeslam_gym import observation_layout
    from agents.learned import policy_arguments

    assert isinstance(env, VecEnv)
    learner = {"ppo": PPO, "a2c": A2C}[args.algorithm]
    checkpoint = args.out / CHECKPOINT
    if checkpoint.exists():
        return learner.load(checkpoint, env=env, device="cpu")
    steps = round(35.0 / args.decision_period)
    own = {"n_steps": steps, "batch_size": steps * args.num_envs // 5, "n_epochs": 4} if learner is PPO else {}
    return learner(
        "MlpPolicy",
        env,
        learning_rate=lambda left: args.learning_rate * max(left, _LAST_RATE),
        gamma=args.gamma,
        gae_lambda=0.95,
        ent_coef=args.entropy_bonus,
        policy_kwargs=policy_arguments(observation_layout(env.unwrapped), args.width),
        tensorboard_log=str(args.out / "logs"),
        seed=args.seed,
        device="cpu",
        **own,
    )


def train(args: Args) -> Path:
    """Train until `total_steps`, or Ctrl-C; the path of the weights. A second call goes on from the checkpoint.

    Raises:
        ValueError: as `check`.
    """
    from agents.learned import save

    check(args)
    args.out.mkdir(parents=True, exist_ok=True)
    env = make_env(args)
    learner = make_learner(args, env)
    begun = time.monotonic()
    left = args.total_steps - learner.num_timesteps
    try:
        if left > 0:
            learner.learn(left, callback=_checkpoints(args), reset_num_timesteps=False, progress_bar=False)
    except KeyboardInterrupt:
        print(f"Interrupted after {learner.num_timesteps} of {args.total_steps} steps; the same command goes on.")
    finally:
        _save_checkpoint(learner, args.out)
        save(args.out / WEIGHTS, learner.policy, card_of(args, learner.num_timesteps, time.monotonic() - begun))
        env.close()
    return args.out / WEIGHTS


def card_of(args: Args, steps: int, seconds: float) -> dict[str, Any]:
    """What the weights' card says."""
    packages = ("activeslam-gym", "stable-baselines3", "torch", "gymnasium", "numba", "numpy")
    arguments = {name: value for name, value in asdict(args).items() if name != "out"}
    return {
        "command": "python -m agents train "
        + " ".join(f"--{name.replace('_', '-')} {value}" for name, value in arguments.items()),
        "decision_period": args.decision_period,
        "width": args.width,
        "gamma": args.gamma,
        "steps": steps,
        "seconds_of_this_call": round(seconds, 1),
        "machine": platform.processor() or platform.machine(),
        "versions": {name: version(name) for name in packages},
    }


def _save_checkpoint(learner: Any, out: Path) -> None:
    """The learner with its optimiser, whole or not at all."""
    from agents.files import written_whole

    with written_whole(out / CHECKPOINT, "wb") as file:
        learner.save(file)


def _checkpoints(args: Args) -> Any:
    """A callback that saves a checkpoint at every tenth rollout and says how it goes."""
    from stable_baselines3.common.callbacks import BaseCallback

    class Checkpoints(BaseCallback):
        rollouts = 0

        def _on_step(self) -> bool:
            return True

        def _on_rollout_end(self) -> None:
            self.rollouts += 1
            if self.rollouts % 10 == 0:
                _save_checkpoint(self.model, args.out)
                returns = [episode["r"] for episode in self.model.ep_info_buffer]
                mean = sum(returns) / max(len(returns), 1)
                print(f"{self.num_timesteps:>10} of {args.total_steps} steps, mean return {mean:.1f}", flush=True)

    return Checkpoints()


def main(args: Args) -> int:
    """Run the command."""
    print(f"Written to {train(args)}")
    return 0
