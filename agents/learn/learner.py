"""What a recipe trains: the batches of its scenarios, and a learner of Stable-Baselines3 on them."""

import json
import math
from collections.abc import Iterable, Mapping
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from pickle import UnpicklingError
from typing import Any
from zipfile import ZipFile

import numpy as np
import torch
from stable_baselines3 import A2C, DQN, PPO, SAC
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.save_util import load_from_zip_file
from stable_baselines3.common.vec_env import VecEnv, VecMonitor

from activeslam_gym import observation_layout
from activeslam_gym.config import TRAINING_SEED
from activeslam_gym.files import written_whole
from activeslam_gym.motion import CAMERA_DIM
from agents.learn.policy import policy_arguments
from agents.learn.recipe import Recipe, scenario_of, trained_scenario
from agents.learn.weights import Weights, read, require_finite
from agents.sb3 import Actions, ActiveSLAMVecEnv, ScaledReward, SeveralScenarios
from agents.tools.files import reading
from baselines.sequences import best_sequence

REPLAY_STEPS = 100_000  # length of the replay buffer of DQN and SAC: some hundreds of megabytes of observations
COUNTS = {"num_timesteps": int, "_n_updates": int, "_episode_num": int, "seconds": float}
"""Plain numbers of a learner in a checkpoint, beside its tensors."""
LAST_RATE = 0.05  # the learning rate's last value, relative to its first

CLASSES: dict[str, type[BaseAlgorithm]] = {"ppo": PPO, "a2c": A2C, "dqn": DQN, "sac": SAC}

ACTIONS: dict[str, Actions] = {"dqn": "indices", "sac": "points"}  # of the others: pairs


def training_seed(recipe: Recipe) -> int:
    """The first seed of the episodes that are trained in."""
    return TRAINING_SEED + recipe.num_envs * recipe.seed


def make_training(recipe: Recipe) -> VecEnv:
    """What is trained in: a batch of one scenario, or the batches of several in their common layout, which initial
    weights have too. Rewards are clipped and scaled, episodes recorded as they are."""
    threads = None if len(recipe.scenarios) == 1 else 1
    batches = [_make_batch(recipe, name, recipe.num_envs, threads) for name in recipe.scenarios]
    env = SeveralScenarios(batches, _most_tokens(batches)) if _common_layout(recipe) else batches[0]
    env.seed(training_seed(recipe))
    return env


def make_validation(recipe: Recipe, episodes: int) -> dict[str, VecEnv]:
    """Of each scenario a batch of ``episodes`` that choose the best weights, observed as those of `make_training`."""
    batches = {name: _make_batch(recipe, name, episodes) for name in recipe.scenarios}
    if not _common_layout(recipe):
        return dict(batches)
    tokens = _most_tokens(batches.values())
    return {name: SeveralScenarios([batch], tokens) for name, batch in batches.items()}


def _common_layout(recipe: Recipe) -> bool:
    return len(recipe.scenarios) > 1 or bool(recipe.initial)


def dimensions(scenario: str) -> int:
    """Estimated dimensions: of the camera, and of all expected landmarks."""
    return CAMERA_DIM + 3 * scenario_of(scenario).landmark_count


def _make_batch(recipe: Recipe, name: str, num_envs: int, threads: int | None = None) -> ScaledReward:
    """A batch behind SB3's interface."""
    scenario, scale = trained_scenario(name), recipe.reward_scale
    if len(recipe.scenarios) > 1:
        scale *= dimensions("paper") / dimensions(name)
    times = {"duration": recipe.duration, "gaze_period": recipe.decision_period}
    task: dict[str, Any] = {"scenario": scenario, "reward": recipe.reward, "num_threads": threads, **times}
    env = ActiveSLAMVecEnv(num_envs, ACTIONS.get(recipe.algorithm, "pairs"), **task)
    return ScaledReward(VecMonitor(env), scale, recipe.reward_clip, recipe.lost_penalty_weight)


def _most_tokens(batches: Iterable[VecEnv]) -> int:
    """The most tokens that an observation of any of the batches has."""
    return max(observation_layout(one.unwrapped).token_shape[0] for one in batches)


class RolloutOfScenarios(RolloutBuffer):
    """A rollout in several scenarios, the advantages of each in units of their own standard deviation.

    Otherwise those of the scenario whose rewards vary most, by a rare loss, would leave the others unheard.

    Args:
        args: Arguments of `RolloutBuffer`.
        scenarios: Their number; each has as many environments, one after another.
        kwargs: Arguments of `RolloutBuffer`.
    """

    def __init__(self, *args: Any, scenarios: int, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.scenarios = scenarios

    def compute_returns_and_advantage(self, last_values: torch.Tensor, dones: np.ndarray) -> None:
        """As `RolloutBuffer`; then of each scenario the advantages have the mean 0 and the standard deviation 1."""
        super().compute_returns_and_advantage(last_values, dones)
        of_scenario = self.advantages.reshape(len(self.advantages), self.scenarios, -1)
        of_scenario -= of_scenario.mean(axis=(0, 2), keepdims=True)
        of_scenario /= of_scenario.std(axis=(0, 2), keepdims=True) + 1e-8


def require_device(name: str) -> None:
    """Raise ValueError for a device that PyTorch does not know, or that this machine lacks."""
    try:
        torch.zeros(1, device=name).item()
    except (RuntimeError, AssertionError, NotImplementedError) as error:
        allowed = ", ".join(["cpu", *(["cuda"] if torch.cuda.is_available() else [])])
        raise ValueError(f"device: {name!r}; allowed on this machine: {allowed}") from error


def minibatch(decisions: int) -> int:
    """Size of the equal minibatches of a rollout, as near as can be to five of two or more decisions."""
    counts = [count for count in range(1, 10) if decisions % count == 0 and decisions // count > 1]
    return decisions // min(counts, key=lambda count: abs(count - 5))


def make_learner(
    recipe: Recipe,
    env: VecEnv,
    logs: Path | None,
    device: str = "cpu",
    weights: Mapping[str, np.ndarray] | None = None,
) -> Any:
    """A learner in the first episodes that are trained in, new or with ``weights``.

    PPO's rollout is `Recipe.rollout_steps` of every environment. Raises ValueError for weights of another network.
    """
    steps, entropy, several = recipe.rollout_steps, {"ent_coef": recipe.entropy_bonus}, len(recipe.scenarios) > 1
    decisions = max(steps * env.num_envs, 2)  # PPO alone reads it, and `Recipe.check` refuses one
    rollout: dict[str, Any] = {"n_steps": steps, "batch_size": minibatch(decisions), "gae_lambda": 0.95}
    if several:
        buffer = {"scenarios": len(recipe.scenarios)}
        rollout |= {"rollout_buffer_class": RolloutOfScenarios, "rollout_buffer_kwargs": buffer}
    replay = {"buffer_size": REPLAY_STEPS, "gradient_steps": env.num_envs}  # with `train_freq` one in four decisions
    own: dict[str, dict[str, Any]] = {
        "ppo": {**rollout, **entropy, "n_epochs": recipe.epochs, "target_kl": recipe.target_kl},
        "a2c": entropy,
        "dqn": {**replay, "train_freq": 4},
        "sac": {**replay, "train_freq": 4},
    }
    layout = getattr(env, "layout", None) or observation_layout(env.unwrapped)
    learner = CLASSES[recipe.algorithm](
        "MlpPolicy",
        env,
        learning_rate=lambda left: recipe.learning_rate * max(left, LAST_RATE),
        gamma=recipe.gamma,
        policy_kwargs=policy_arguments(layout, recipe.width, weights),
        tensorboard_log=str(logs) if logs else None,
        seed=recipe.seed,
        device=device,
        **own[recipe.algorithm],
    )
    env.seed(training_seed(recipe))  # SB3 has set the learner's own
    if weights is not None:
        try:
            learner.policy.load_state_dict({name: torch.as_tensor(value) for name, value in weights.items()})
        except RuntimeError as error:
            raise ValueError(f"the weights do not fit their card: {error}") from error
    elif recipe.warm_start and recipe.algorithm not in ACTIONS and not several:
        _prefer(learner, best_sequence(env.unwrapped).longest(), recipe.warm_start)
    return learner


def _prefer(learner: Any, action: tuple[int, int], probability: float) -> None:
    """Give a motion and a gaze, each, this probability in a new policy, whose other choices are about equal."""
    bias, choices, (motion, gaze) = learner.policy.action_net.bias, learner.action_space.nvec, action
    with torch.no_grad():
        for index, others in zip((motion, choices[0] + gaze), choices - 1):
            bias[index] += math.log(others * probability / (1.0 - probability))


def initial_weights(recipe: Recipe) -> tuple[Weights, dict[str, Any]]:
    """The recipe's initial weights and their card.

    Raises ValueError where there are none, or they are of another learner or of a single scenario.
    """
    weights, card = read(recipe.initial, "initial")
    if card["algorithm"] != recipe.algorithm or not _common_layout(Recipe.of(card)):
        theirs = f"{card['algorithm']} in {card['scenario']}"
        raise ValueError(
            f"initial: {recipe.initial!r} is of {theirs}; allowed: {recipe.algorithm} in several scenarios"
        )
    return weights, card


def learner_of(weights: Mapping[str, np.ndarray], card: Mapping[str, Any]) -> Any:
    """A learner of SB3 that has these weights, for a single environment of the recipe on the card.

    Raises ValueError where they do not fit each other.
    """
    recipe = replace(Recipe.of(card), num_envs=1)
    with closing(make_training(recipe)) as env:
        learner = make_learner(recipe, env, None, weights=weights)
    if isinstance(learner, PPO):  # one of several scenarios groups the environments of its own training
        learner.rollout_buffer_class, learner.rollout_buffer_kwargs = RolloutBuffer, {}
    learner.learning_rate = recipe.learning_rate  # a number, where a function would be pickled
    learner._setup_lr_schedule()
    return learner


def learner_in(recipe: Recipe, env: VecEnv, checkpoint: Path, logs: Path, device: str = "cpu") -> Any:
    """A learner with the weights, the optimiser and the counts of a checkpoint, in episodes that it has not yet seen.

    Without a checkpoint it is new, or has the recipe's initial weights. Its random draws begin again, and the replay
    buffer of DQN or SAC is empty. Of the file, tensors and numbers are read, never a pickle: `BaseAlgorithm.load` would
    run its code. Raises ValueError for a damaged file, or one of another learner, and for initial weights that do not
    fit.
    """
    initial = initial_weights(recipe)[0] if recipe.initial else None
    learner = make_learner(recipe, env, logs, device, initial)
    if not checkpoint.exists():
        return learner
    with reading(checkpoint), ZipFile(checkpoint) as archive:
        kept = json.loads(archive.read("data"))
        try:
            _, parameters, variables = load_from_zip_file(checkpoint, load_data=False, device="cpu")
        except UnpicklingError as error:
            raise ValueError("it holds more than tensors and numbers, which could run code; remove it") from error
        learner.set_parameters(parameters, device=device)
        for name, value in (variables or {}).items():
            getattr(learner, name).data = value.data
        for name, kind in COUNTS.items():
            setattr(learner, name, kind(kept.get(name, 0)))
    env.seed(training_seed(recipe) + learner.num_timesteps)
    return learner


def save_learner(learner: BaseAlgorithm, checkpoint: Path) -> None:
    """The learner with its optimiser, whole or not at all; a replay buffer is left out.

    Raises ValueError for weights that are not finite.
    """
    require_finite(weights_of(learner))
    with written_whole(checkpoint) as unfinished:
        learner.save(unfinished)


def weights_of(learner: BaseAlgorithm) -> Weights:
    """The weights of a learner's policy."""
    return {name: value.cpu().numpy() for name, value in learner.policy.state_dict().items()}
