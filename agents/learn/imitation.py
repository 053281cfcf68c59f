"""The warm start of a training: a new policy learns to do what the best open loop does, and what that is worth.

By chance alone no course is held for seconds. From a policy that holds one and leaves it now and then, each change is
tried beside it.
"""

from typing import Any

import numpy as np
import torch
from stable_baselines3.common.vec_env import VecEnv

import baselines

EPISODES = 2
"""So often the best sequence is flown in every environment,"""
EPOCHS = 30
"""and so often learned from,"""
MINIBATCHES = 5
"""in so many parts,"""
RATE = 1e-3
"""at this learning rate."""


def imitate(learner: Any, env: VecEnv, steps: int, probability: float, gamma: float) -> None:
    """Teach a new actor and critic the scenario's `best-sequence`, of which ``steps`` decisions are an episode.

    The actor gives its motion and its gaze, each, this ``probability``, and the others equal ones; the episodes are
    drawn so, and the critic learns their returns, discounted by ``gamma`` a decision.
    """
    flown = [_fly(env, steps, probability, gamma) for _ in range(EPISODES)]
    observations, targets, returns, ended = (torch.as_tensor(np.concatenate(part)) for part in zip(*flown))
    policy = learner.policy
    optimiser, generator = torch.optim.Adam(policy.parameters(), RATE), torch.Generator().manual_seed(0)
    for _ in range(EPOCHS):
        for part in torch.randperm(len(targets), generator=generator).tensor_split(MINIBATCHES):
            logits = policy.get_distribution(observations[part]).distribution
            logits = torch.cat([one.logits.log_softmax(1) for one in logits], dim=1)
            errors = policy.predict_values(observations[part])[:, 0] - returns[part]
            loss = 0.5 * (ended[part] * errors**2).mean() - (targets[part] * logits).sum(1).mean()
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()


def _fly(env: VecEnv, steps: int, probability: float, gamma: float) -> tuple[np.ndarray, ...]:
    """An episode in every environment: observations (n, D), target probabilities (n, 10), returns (n,), of what ended.

    The last is 1 where the episode came to its end, and 0 where it had begun anew after a loss.
    """
    pilot, rng = baselines.make("best-sequence", env.unwrapped), np.random.default_rng(steps)
    observation, told = env.reset(), []
    for _ in range(steps):
        targets = _targets(pilot.predict(observation)[0], env.action_space.nvec, probability)
        parts = np.split(targets, env.action_space.nvec.cumsum()[:-1], axis=1)
        action = np.stack([(part.cumsum(1) > rng.random((len(part), 1))).argmax(1) for part in parts], axis=1)
        after, rewards, dones, _ = env.step(action)
        told.append((observation, targets, rewards, dones))
        observation = after
    observations, aims, rewards, dones = map(np.array, zip(*told))
    returns, ended = np.zeros_like(rewards, np.float32), np.zeros_like(rewards, np.float32)
    worth, known = np.zeros(env.num_envs), np.zeros(env.num_envs)
    for t in reversed(range(steps)):
        known = np.where(dones[t], 1.0, known)
        worth = rewards[t] + gamma * np.where(dones[t], 0.0, worth)
        returns[t], ended[t] = worth, known
    return tuple(part.reshape(-1, *part.shape[2:]) for part in (observations, aims, returns, ended))


def _targets(actions: np.ndarray, choices: np.ndarray, probability: float) -> np.ndarray:
    """(n, 10) probabilities of the motions and of the gazes: of ``actions`` (n, 2), and what is left for the others."""
    parts = [np.full((len(actions), count), (1.0 - probability) / (count - 1), np.float32) for count in choices]
    for part, chosen in zip(parts, actions.T):
        part[np.arange(len(part)), chosen] = probability
    return np.hstack(parts)
