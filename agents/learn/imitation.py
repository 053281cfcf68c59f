"""Imitation before reinforcement: DAgger (Ross, Gordon and Bagnell, AISTATS 2011), a teacher for each scenario."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.vec_env import VecEnv

from activeslam_gym import Gaze, Motion
from agents import policies
from agents.learn.recipe import Recipe
from agents.learn.weights import LearnedPolicy

TEACHER_ROUNDS = 4  # in which a falling share of the decisions is the teacher's; then all are the learner's own
UPDATES, LAST_UPDATES = 60, 1600  # of the network, after each round and after the last
BATCH = 1024  # decisions of an update
RATES = (1e-3, 1e-4)  # learning rate, of the first round and of the last
VALUE_WEIGHT = 0.25  # of the squared error of the value, in the loss
LARGEST_GRADIENT = 0.5


def imitate(learner: Any, recipe: Recipe, env: VecEnv) -> Iterator[str]:
    """Teach a learner with an actor and a critic the teachers' decisions, in the situations into which it comes itself.

    A round is an episode of every environment. Its decisions are the teacher's with a probability that falls from 1 to
    0, and else the learner's own. Of all rounds so far, the network learns what the teacher of the scenario decides
    there, a learned one by its probabilities, and the return that follows.

    Args:
        learner: PPO or A2C of Stable-Baselines3, whose network is changed.
        recipe: Its recipe; ``teachers`` has one for each scenario.
        env: What it is trained in, of `algorithms.make_training`.

    Yields:
        A line about each round.
    """
    teacher, rng = Teachers(recipe, env), np.random.default_rng(recipe.seed)
    optimiser = torch.optim.Adam(learner.policy.parameters())
    rounds = max(1, round(recipe.imitated_steps / (recipe.steps_per_episode * env.num_envs)))
    known: list[tuple[Any, ...]] = []
    observations = env.reset()
    for k in range(rounds):
        share, course = max(0.0, 1.0 - k / TEACHER_ROUNDS), []
        for _ in range(recipe.steps_per_episode):
            seen = getattr(env, "observed", [observations])
            taught, own = teacher.probabilities(seen), _probabilities(learner, observations)
            followed = (rng.random(env.num_envs) < share)[:, None]
            actions = np.stack([_drawn(np.where(followed, a, b), rng) for a, b in zip(taught, own)], axis=1)
            begun = observations
            observations, rewards, dones, _ = env.step(actions)
            course.append((begun.astype(np.float16), *taught, rewards, dones))
        known.append(_with_returns(course, _values(learner, observations), recipe.gamma))
        data = [torch.as_tensor(np.concatenate(parts), device=learner.device) for parts in zip(*known)]
        first, last = RATES
        optimiser.param_groups[0]["lr"] = first + (last - first) * k / max(1, rounds - 1)
        size = min(BATCH, len(data[0]))
        updates = LAST_UPDATES if k == rounds - 1 else UPDATES
        losses = [_update(learner, optimiser, data, rng.integers(len(data[0]), size=size)) for _ in range(updates)]
        yield f"{len(data[0]):,} imitated decisions: {np.mean(losses[-UPDATES:]):.2f} nats from the teachers"


class Teachers:
    """The teachers of all scenarios, bound to their batches."""

    def __init__(self, recipe: Recipe, env: VecEnv) -> None:
        batches: Sequence[VecEnv] = getattr(env, "batches", (env,))
        self._teachers = [
            policies.resolve(recipe.teacher_of[scenario], batch.unwrapped, [recipe.seed] * batch.num_envs)
            for scenario, batch in zip(recipe.scenarios, batches)
        ]

    def probabilities(self, observations: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """Of each motion (B, 7) and each gaze (B, 3), from the batches' own observations; 1 for the action of a policy
        that knows no probabilities."""
        each = []
        for teacher, seen in zip(self._teachers, observations):
            if isinstance(teacher, LearnedPolicy):
                each.append(teacher.probabilities(seen))
            else:
                motion, gaze = np.asarray(teacher.predict(seen)[0]).T
                each.append([np.eye(len(Motion), dtype=np.float32)[motion], np.eye(len(Gaze), dtype=np.float32)[gaze]])
        motions, gazes = zip(*each)
        return np.concatenate(motions), np.concatenate(gazes)


def _probabilities(learner: Any, observations: np.ndarray) -> list[np.ndarray]:
    with torch.inference_mode():
        drawn = learner.policy.get_distribution(_on(learner, observations)).distribution
        return [part.probs.cpu().numpy() for part in drawn]


def _values(learner: Any, observations: np.ndarray) -> np.ndarray:
    with torch.inference_mode():
        return learner.policy.predict_values(_on(learner, observations))[:, 0].cpu().numpy()


def _on(learner: Any, values: np.ndarray) -> torch.Tensor:
    return torch.as_tensor(values, device=learner.device)


def _drawn(probabilities: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(B, choices) -> (B,) one of each row."""
    reached = np.cumsum(probabilities, axis=1)
    return (rng.random((len(reached), 1)) * reached[:, -1:] > reached).sum(axis=1)


def _with_returns(course: list[tuple[Any, ...]], values: np.ndarray, gamma: float) -> tuple[Any, ...]:
    """Observations, motions and gazes of a round, and the discounted return after each decision."""
    *parts, rewards, dones = (np.stack(part) for part in zip(*course))
    returns = np.empty_like(rewards)
    for step in range(len(rewards) - 1, -1, -1):
        values = rewards[step] + gamma * values * ~dones[step]
        returns[step] = values
    return *(part.reshape(-1, part.shape[-1]) for part in parts), returns.ravel()


def _update(learner: Any, optimiser: torch.optim.Optimizer, data: list[torch.Tensor], chosen: np.ndarray) -> float:
    """One step on the ``chosen`` decisions; the cross entropy before it [nat]."""
    observations, motions, gazes, returns = (part[_on(learner, chosen)] for part in data)
    policy = learner.policy
    actor, critic = policy.mlp_extractor(policy.extract_features(observations.float()))
    logits = policy.action_net(actor).split((len(Motion), len(Gaze)), dim=1)
    entropy = -sum((p * part.log_softmax(dim=1)).sum(dim=1).mean() for p, part in zip((motions, gazes), logits))
    error = (policy.value_net(critic)[:, 0] - returns).square().mean()
    optimiser.zero_grad()
    (entropy + VALUE_WEIGHT * error).backward()
    torch.nn.utils.clip_grad_norm_(policy.parameters(), LARGEST_GRADIENT)
    optimiser.step()
    return entropy.item()
