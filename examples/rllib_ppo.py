"""RLlib's PPO (new API stack) on a local cluster of two workers: python examples/rllib_ppo.py [--iterations 10].

With --address and --workers it runs on a cluster of several machines: see docs/clients.md.
"""

import argparse
import time

import gymnasium as gym
import ray
from ray.rllib.algorithms.ppo import PPOConfig
from ray.tune.registry import register_env

SCALE = 0.05


def make_env(config: dict) -> gym.Env:
    """One environment; called on the worker, so that it registers the environments there."""
    import activeslam_gym  # noqa: F401

    return gym.wrappers.TransformReward(gym.make("ActiveSLAM-v0", **config), lambda reward: SCALE * float(reward))


def main(iterations: int = 10, address: str | None = None, workers: int = 2) -> tuple[float, float]:
    """Train for `iterations` of 2240 decisions a worker; the mean return [bit] of the first and the last one."""
    ray.init(address=address, num_cpus=None if address else workers + 1, include_dashboard=False, log_to_driver=False)
    register_env("active-slam", make_env)
    config = (
        PPOConfig()
        .environment("active-slam")
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
    steps, seconds = int(result["num_env_steps_sampled_lifetime"]), time.monotonic() - began
    print(f"RLlib PPO, {workers} workers: {returns[0]:.0f} -> {returns[-1]:.0f} bits, {steps} steps in {seconds:.0f} s")
    algorithm.stop()
    ray.shutdown()
    return returns[0], returns[-1]


if __name__ == "__main__":
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--iterations", type=int, default=10)
    options.add_argument("--address", help="of a running cluster; 'auto' on one of its machines")
    options.add_argument("--workers", type=int, default=2)
    main(**vars(options.parse_args()))
