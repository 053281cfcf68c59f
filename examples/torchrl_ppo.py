"""TorchRL's PPO loss on `GymEnv`: python examples/torchrl_ppo.py [steps]."""

import sys
import time

import torch
from tensordict.nn import ProbabilisticTensorDictSequential, TensorDictModule
from torch.distributions import Categorical
from torchrl.collectors import Collector
from torchrl.envs import GymEnv, RewardScaling, RewardSum, SerialEnv, TransformedEnv
from torchrl.modules import MLP, ProbabilisticActor, ValueOperator
from torchrl.objectives import ClipPPOLoss
from torchrl.objectives.value import GAE

import activeslam_gym  # noqa: F401  (registers the environments)

SCALE = 0.05


def main(steps: int = 44_800, num_envs: int = 16) -> tuple[float, float]:
    """Train for `steps` decisions; the mean return [bit] of the first and of the last rollout's episodes."""
    torch.manual_seed(0)
    rollout = 140 * num_envs  # an episode of 35 s each

    def make() -> GymEnv:
        return GymEnv("ActiveSLAMDiscrete-v0", categorical_action_encoding=True)

    env = (
        TransformedEnv(SerialEnv(num_envs, make))
        .append_transform(RewardScaling(0.0, SCALE))
        .append_transform(RewardSum())
    )
    env.set_seed(0)
    size = env.observation_spec["observation"].shape[-1]
    logits = TensorDictModule(
        MLP(size, 21, num_cells=[64, 64], activation_class=torch.nn.Tanh), ["observation"], ["logits"]
    )
    actor: ProbabilisticTensorDictSequential = ProbabilisticActor(
        logits, in_keys=["logits"], distribution_class=Categorical, return_log_prob=True
    )
    critic = ValueOperator(MLP(size, 1, num_cells=[64, 64], activation_class=torch.nn.Tanh), in_keys=["observation"])
    advantage = GAE(gamma=0.995, lmbda=0.95, value_network=critic)
    loss = ClipPPOLoss(actor, critic, entropy_coeff=0.01, critic_coeff=0.5, normalize_advantage=True)
    optimiser = torch.optim.Adam(loss.parameters(), lr=7e-4)

    returns, began = [], time.monotonic()
    for batch in Collector(
        env, actor, frames_per_batch=rollout, total_frames=steps, auto_register_policy_transforms=True
    ):
        ended = batch["next", "done"].squeeze(-1)
        returns.append(batch["next", "episode_reward"][ended].mean().item() / SCALE)
        with torch.no_grad():
            advantage(batch)
        flat = batch.reshape(-1)
        for _ in range(4):
            for indices in torch.randperm(len(flat)).split(448):
                terms = loss(flat[indices])
                optimiser.zero_grad()
                sum(terms[f"loss_{name}"] for name in ("objective", "entropy", "critic")).backward()
                torch.nn.utils.clip_grad_norm_(loss.parameters(), 0.5)
                optimiser.step()
    seconds = time.monotonic() - began
    print(f"TorchRL PPO: {returns[0]:.0f} -> {returns[-1]:.0f} bits, {len(returns) * rollout} steps in {seconds:.0f} s")
    return returns[0], returns[-1]


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
