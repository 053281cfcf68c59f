"""The arguments of training, apart from PyTorch and its slow import."""

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal, get_args

from activeslam_gym.config import IMAGE_SCENARIOS, SCENARIOS, Scenario, scenario_from, whole_multiple
from agents.tools.arguments import made_scenario, scenario_argument, within

Algorithm = Literal["ppo", "a2c", "dqn", "sac"]
CHECKPOINT, WEIGHTS, CURVE = "checkpoint.zip", "policy.npz", "curve.csv"  # files of a training
EVERY = "all"
REPLICATIONS = ("paper-literal", "paper-2006")
"""Named scenarios that are not among all: they repeat the paper's numbers."""
LEAST = 1e-12  # of a number that must be positive
ROLLOUT = 1024  # decisions of a scenario between two updates of PPO, or an episode of each environment if that is less
ALGORITHMS: tuple[Algorithm, ...] = get_args(Algorithm)


def scenario_of(text: str) -> Scenario:
    """The scenario of a name, 'package.module:name' or a JSON file. Raises ValueError where there is none."""
    return scenario_from(made_scenario(scenario_argument(text)))


def trained_scenario(name: str) -> Scenario:
    """The scenario as it is trained in: one of images with the sensor `corners`, without the images."""
    scenario = scenario_of(name)
    return replace(scenario, sensor="corners") if name in IMAGE_SCENARIOS else scenario


@dataclass(frozen=True)
class Recipe:
    """The arguments that determine a training."""

    algorithm: Algorithm = "ppo"
    """Learner of Stable-Baselines3: DQN chooses among the 21 joint actions, SAC among continuous ones."""
    reward: str = "entropy"
    """Reward of the environment, by its name."""
    scenario: str = "paper"
    """Scenario to train in: a name, 'package.module:name', a JSON file, several joined by +, or all."""
    warm_start: float = 0.8
    """Probability at the start of the motion, and of the gaze, that the scenario's best sequence holds longest (PPO
    and A2C in one scenario; 0 prefers none)."""
    initial: str = ""
    """Weights of several scenarios to start from, and their width: generalist, or a file policy.npz (PPO and A2C)."""
    total_steps: int = 100_000
    """Decisions of training, rounded up to whole rollouts."""
    decision_period: float = 1.0
    """Seconds between decisions, which is the environment's gaze_period."""
    duration: float | None = None
    """Seconds of an episode; the scenario's if not given."""
    num_envs: int = 32
    """Environments in the batch of each scenario."""
    seed: int = 2
    """Seed of the episodes and the learner."""
    gamma: float = 0.98
    """Discount per decision."""
    learning_rate: float = 7e-4
    """First learning rate; it falls linearly to a twentieth."""
    entropy_bonus: float = 0.0
    """Weight of the policy's own entropy, which falls to a tenth (PPO, A2C); 0.01 explores longer."""
    epochs: int = 8
    """Passes over each rollout, in about five equal minibatches each (PPO)."""
    target_kl: float = 0.02
    """Divergence in nats that ends an update at 1.5 times this value (PPO)."""
    reward_scale: float = 0.01
    """Constant factor of the reward; of several scenarios, that of one as large as `paper`."""
    reward_clip: float = 150.0
    """Most that one decision may gain or lose in training, in the reward's unit, beside the failure penalty."""
    lost_penalty_weight: float = 2.0
    """Factor of the failure penalty, in training and in the choice of the weights."""
    width: int = 64
    """Units of each layer of the network."""
    period: int = 10_000
    """Decisions between checkpoints, and between rounds of validation."""
    validation_episodes: int = 64
    """Episodes of each scenario that choose the best weights."""

    @classmethod
    def of(cls, card: Mapping[str, Any]) -> "Recipe":
        """The recipe on a card; what the card does not name was not yet there, and is at its default."""
        return Recipe(**{field.name: card[field.name] for field in fields(Recipe) if field.name in card})

    def check(self) -> None:
        """Raises ValueError for a bad argument; the message names it, its value and what is allowed."""
        within(self, decision_period=(LEAST, 1e6), duration=(LEAST, 1e6), reward_scale=(LEAST, 1e9))
        within(self, reward_clip=(LEAST, 1e9), lost_penalty_weight=(LEAST, 1e9), target_kl=(LEAST, 1e9))
        within(self, gamma=(LEAST, 1.0), learning_rate=(LEAST, 1.0), entropy_bonus=(0.0, 1e3), seed=(0, 2**31 - 1))
        within(self, warm_start=(0.0, 0.99), total_steps=(1, 2**40), epochs=(1, 1000))
        within(self, num_envs=(1, 2**16), width=(1, 2**13), period=(1, 2**40), validation_episodes=(1, 2**16))
        if len(set(self.scenarios)) < len(self.scenarios):
            raise ValueError(f"scenario: {self.scenario!r}; allowed: each scenario once")
        for scenario in map(scenario_of, self.scenarios):
            whole_multiple("decision_period", self.decision_period, "the frame", scenario.frame_time)
            whole_multiple("duration", self.duration or scenario.duration, "decision_period", self.decision_period)
        if self.algorithm == "ppo" and self.rollout_steps * self.num_envs == 1:
            raise ValueError(f"num_envs: {self.num_envs} with one decision an episode; allowed: 2 or more of them")
        if self.initial and self.algorithm in ("dqn", "sac"):
            raise ValueError(f"initial: {self.initial!r} for {self.algorithm}; allowed: ppo or a2c")
        if self.algorithm not in ALGORITHMS:
            raise ValueError(f"algorithm: {self.algorithm!r}; allowed: {', '.join(ALGORITHMS)}")

    @property
    def scenarios(self) -> tuple[str, ...]:
        """Names of the scenarios."""
        every = tuple(name for name in SCENARIOS if name not in REPLICATIONS)
        return every if self.scenario == EVERY else tuple(self.scenario.split("+"))

    @property
    def rollout_steps(self) -> int:
        """Decisions of each environment between two updates of PPO: so many make `ROLLOUT`, an episode at most.

        Of several scenarios, the episode is the median one.
        """
        durations = [self.duration or scenario_of(name).duration for name in self.scenarios]
        return max(1, min(round(statistics.median(durations) / self.decision_period), ROLLOUT // self.num_envs))


QUICK: dict[str, Any] = {
    **{"reward": "log_score", "warm_start": 0.0, "entropy_bonus": 0.01, "num_envs": 128, "epochs": 4, "width": 256},
    **{"total_steps": 40_000, "period": 5_000},
}
RECIPES = {"quick": QUICK, "full": QUICK | {"total_steps": 200_000, "period": 20_000}}
"""Arguments of `Args` by the name of a recipe; docs/policies.md has the curves of ``quick``."""


def expanded(arguments: Sequence[str]) -> list[str]:
    """Arguments of a command line with those of the named recipe in its place, so that later ones replace them."""
    given = list(arguments)
    for k, one in enumerate(given):
        name = one.removeprefix("--recipe=") if one.startswith("--recipe=") else "".join(given[k + 1 : k + 2])
        if one.partition("=")[0] == "--recipe" and name in RECIPES:
            texts = [f"--{key.replace('_', '-')}={value}" for key, value in RECIPES[name].items()]
            return [*given[:k], *texts, *given[k:]]
    return given


@dataclass(frozen=True)
class Args(Recipe):
    """Train a policy; write the weights that did best in validation episodes, their card, a checkpoint and logs."""

    recipe: Literal["", "quick", "full"] = ""
    """Arguments by name, for scenarios in which decisions pay: quick, or full with five times its decisions. Arguments
    that follow it replace its own."""
    out: Path = Path("results/train")
    """Folder of the results; a checkpoint in it is resumed."""
    device: str = "cpu"
    """Device on which the network learns, as PyTorch names it: cpu, or cuda for a GPU."""
    wandb: str = ""
    """Project of Weights & Biases to which the run is logged too; needs the package wandb."""
    test_episodes: int = 32
    """Episodes of each scenario for the results on the card; 0 for none, and for no search of best-constant before."""

    def check(self) -> None:
        """Raises ValueError for a bad argument; the message names it, its value and what is allowed."""
        super().check()
        if self.wandb and find_spec("wandb") is None:
            raise ValueError(f"wandb: {self.wandb!r}, but its package is absent; allowed: none, or pip install wandb")
        within(self, test_episodes=(0, 10**6))

    def arguments(self) -> dict[str, Any]:
        """The arguments that determine a training, as they stand in a file."""
        return {field.name: getattr(self, field.name) for field in fields(Recipe)}
