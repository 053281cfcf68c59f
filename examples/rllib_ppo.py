"""RLlib's PPO (new API stack) on a local cluster of two workers: python examples/rllib_ppo.py [--iterations 10].

With --address and --workers it runs on a cluster of several machines (docs/cluster.md). It learns in one scenario or in
several, and with --out writes a checkpoint that `python -m agents compare --policies rllib:PATH` plays.
"""

import argparse
import itertools
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym
import ray
from ray.rllib.algorithms.ppo import PPOConfig
from ray.tune.registry import register_env

from activeslam_gym import observation_layout
from agents.rllib import Padded

SCALE = 0.05
MADE = itertools.count()  # environments of this process


def make_env(config: dict) -> gym.Env:
    """One environment; those of a worker are of all scenarios by turns, with as many tokens."""
    scenario = config["scenarios"][next(MADE) % len(config["scenarios"])]
    env = Padded(gym.make("activeslam_gym:ActiveSLAM-v0", scenario=scenario), config["tokens"])
    return gym.wrappers.TransformReward(env, lambda reward: SCALE * float(reward))


def log_failures(episode: Any, metrics_logger: Any, **_: Any) -> None:
    """Log the share of lost episodes beside the return."""
    metrics_logger.log_value("lost", float(episode.get_infos(-1)["lost"]), window=100)


def main(
    iterations: int = 10,
    address: str | None = None,
    workers: int = 2,
    scenario: Sequence[str] = ("paper",),
    out: Path | None = None,
) -> tuple[float, float]:
    """Train for `iterations` of 2240 decisions a worker; the mean return [bit] of the first and the last one."""
    ray.init(
        address=address or "local",
        num_cpus=None if address else workers + 1,
        include_dashboard=False,
        log_to_driver=False,
    )
    register_env("active-slam", make_env)
    layouts = [observation_layout(gym.make("ActiveSLAM-v0", scenario=one)) for one in scenario]
    tokens = max(layout.token_shape[0] for layout in layouts)
    config = (
        PPOConfig()
        .environment("active-slam", env_config={"scenarios": list(scenario), "tokens": tokens})
        .callbacks(on_episode_end=log_failures)
        .env_runners(
            num_env_runners=workers,
            num_envs_per_env_runner=16,
            rollout_fragment_length=140,
            sample_timeout_s=600.0,  # the first may compile the kernels
        )
        .training(
            train_batch_size_per_learner=2240 * workers,
            minibatch_size=448,
            num_epochs=4,
            lr=7e-4,
            gamma=0.995,
            lambda_=0.95,
            entropy_coeff=0.01,
            vf_clip_param=1e3,
            grad_clip=0.5,
        )
        .debugging(seed=0)
    )
    algorithm, returns, began = config.build_algo(), [], time.monotonic()
    for _ in range(iterations):
        result = algorithm.train()
        returns.append(result["env_runners"]["episode_return_mean"] / SCALE)
        print(f"iteration {len(returns)}: {returns[-1]:.0f} bits, {result['env_runners']['lost']:.0%} lost", flush=True)
    steps, seconds = int(result["num_env_steps_sampled_lifetime"]), time.monotonic() - began
    print(f"RLlib PPO, {workers} workers: {returns[0]:.0f} -> {returns[-1]:.0f} bits, {steps} steps in {seconds:.0f} s")
    if out:
        algorithm.save_to_path(str(out.resolve()))
    algorithm.stop()
    ray.shutdown()
    return returns[0], returns[-1]


if __name__ == "__main__":
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--iterations", type=int, default=10)
    options.add_argument("--address", help="of a running cluster; 'auto' on one of its machines")
    options.add_argument("--workers", type=int, default=2)
    options.add_argument("--scenario", nargs="+", default=["paper"], help="names; of several, each is played by turns")
    options.add_argument("--out", type=Path, help="folder of the checkpoint")
    main(**vars(options.parse_args()))
