"""What every computing policy shares: `predict`, the held motion, and how scores become an action."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from contextlib import closing
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike, NDArray

from activeslam_gym import ActiveSLAMVectorEnv, Gaze, Motion, Scenario, core_of
from activeslam_gym.evaluation import Episode, play
from activeslam_gym.evaluation import Predictor as Predictor
from activeslam_gym.motion import COMMANDS

TIE = 1e-9  # scores closer than this to the best are equal to it, in the score's unit

Actions = NDArray[np.int64]
Environment = gym.Env | gym.vector.VectorEnv


SPACES = (
    gym.spaces.MultiDiscrete([len(Motion), len(Gaze)]),
    gym.spaces.Discrete(len(Motion) * len(Gaze)),
    gym.spaces.Box(-1.0, 1.0, COMMANDS.shape[2:], np.float32),
    gym.spaces.Box(-np.inf, np.inf, COMMANDS.shape[2:], np.float32),
)
"""Of pairs, indices and points, and of points that `gymnasium.wrappers.ClipAction` takes."""


def best(scores: ArrayLike) -> Actions:
    """Index of the best score along the last axis, (..., n) -> (...); ties within `TIE` go to STAY, the last one.

    NaN, which a lost filter can give, is worse than any number; where all are NaN the best is STAY.
    """
    scores = np.asarray(scores)
    scores = np.where(np.isnan(scores), -np.inf, scores)
    stay_ties = scores[..., -1] >= scores.max(axis=-1) - TIE
    return np.where(stay_ties, scores.shape[-1] - 1, scores.argmax(axis=-1))


def action_space_of(env: Environment) -> gym.Space:
    """The space of one environment's actions. Raises ValueError where a wrapper has changed it."""
    space: gym.Space = getattr(env, "single_action_space", env.action_space)
    if space not in SPACES:
        raise ValueError(f"env: its actions are {space}; allowed: {', '.join(map(str, SPACES))}")
    return space


def actions_in(space: gym.Space, chosen: Actions) -> NDArray[Any]:
    """Motions and gazes (B, 2) as actions of a space: pairs, indices (B,) or points (B, 4)."""
    if isinstance(space, gym.spaces.Discrete):
        return chosen[:, 0] * len(Gaze) + chosen[:, 1]
    if isinstance(space, gym.spaces.Box):
        return COMMANDS[chosen[:, 0], chosen[:, 1]].astype(np.float32)
    return chosen


class Policy(ABC):
    """A policy that computes its action from the belief of the environment to which it is bound.

    The environment is a single one or a batch of B of them (`num_envs`); inside, everything has the leading axis B,
    which is 1 for a single environment. A subclass chooses motions and gazes; this class asks for a motion only where
    one is about to be read (`motion_phase` is 0) and holds it in between. The held motion is renewed at the first
    step of every period, hence of every episode: a policy carries nothing from one episode to the next.
    """

    def __init__(self, env: Environment) -> None:
        self.env = core_of(env)
        self.space = action_space_of(env)
        observed = getattr(env, "single_observation_space", getattr(env, "observation_space", None))
        self._observed_axes = len(getattr(observed, "shape", None) or (0,))
        self.batched = hasattr(self.env, "num_envs")
        self.num_envs: int = getattr(self.env, "num_envs", 1)
        self.motion: Actions = np.full(self.num_envs, Motion.STAY, dtype=np.int64)

    @abstractmethod
    def choose_motion(self) -> Actions:
        """Motions (B,) for the period that starts now."""

    @abstractmethod
    def choose_gaze(self) -> Actions:
        """Gazes (B,) for the present gaze period."""

    def decide(self) -> Actions:
        """Actions (B, 2) for the present step: the motion under way, or a new one where its period starts."""
        starts = self.motion_starts()
        if starts.any():
            self.motion = np.where(starts, self.choose_motion(), self.motion)
        return np.stack((self.motion, self.choose_gaze()), axis=-1)

    def predict(
        self, observation: ArrayLike, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[Any, Any]:
        """Return the action for the environment's present belief, and `state` untouched.

        `observation` gives the shape alone: (D,), or what a wrapper makes of it, -> (2,), (B, D) -> (B, 2); with the
        discrete action space a scalar or (B,), index 3 motion + gaze, and with the continuous one the points (4,) or
        (B, 4) of it that they are.
        `episode_start` and `deterministic` are there for the callers that pass them.
        Raises ValueError when the leading axis is not the number of environments.
        """
        shape = np.shape(observation)
        has_axis = len(shape) > self._observed_axes
        batch = shape[0] if has_axis else 1
        if batch != self.num_envs:
            raise ValueError(
                f"observation: of shape {shape}, {batch} environment(s); allowed: the {self.num_envs} "
                "to which the policy is bound"
            )
        actions = actions_in(self.space, self.decide())
        return (actions if has_axis else actions[0]), state

    def motion_starts(self) -> NDArray[np.bool_]:
        """(B,) true where the next step reads its motion."""
        return self.per_env(self.env.motion_phase) == 0

    def per_env(self, value: ArrayLike) -> NDArray[Any]:
        """`value` with the leading axis B: a number (or one per environment) -> (B,), scores (n,) -> (B, n)."""
        value = np.asarray(value)
        has_axis = self.batched and value.ndim > 0
        return value if has_axis else np.broadcast_to(value, (self.num_envs, *value.shape))

    def always(self, choice: int) -> Actions:
        """(B,) the same choice for every environment."""
        return np.full(self.num_envs, choice, dtype=np.int64)


def played(make: Callable[[Any], Policy], scenario: Scenario, seeds: Sequence[int], **times: float) -> list[Episode]:
    """The episodes of ``seeds`` in a scenario, as one batch, lost ones to their end; sampled at start and end alone.

    ``make``: environment → policy; ``times``: of `ActiveSLAMVectorEnv`, the scenario's if not given.
    """
    given: dict[str, Any] = {"end_when_lost": False, "autoreset_mode": "DISABLED", **times}
    with closing(ActiveSLAMVectorEnv(len(seeds), scenario, **given)) as env:
        return play(env, make(env), list(seeds), sample_period=env.duration)
