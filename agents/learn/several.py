"""One batch of several scenarios, in the common layout of their observations."""

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from gymnasium import spaces
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvStepReturn

from activeslam_gym import observation_layout
from agents.learn.inputs import Inputs, common_size


class SeveralScenarios(VecEnv):
    """Batches of different scenarios as one, with the context behind the global features (`agents.learn.inputs`).

    Episodes of different durations run beside each other. Empty tokens fill the rooms with fewer landmarks. Each core
    plays one batch at a time.

    Args:
        batches: One for each scenario, with the same actions.
        tokens: Tokens of an observation, at least as many as any of them has.
    """

    def __init__(self, batches: Sequence[VecEnv], tokens: int) -> None:
        self.batches = tuple(batches)
        layouts = [observation_layout(one.unwrapped) for one in self.batches]
        self._inputs = [Inputs(layout, common_size(layout), tokens) for layout in layouts]
        self.layout = self._inputs[0].layout
        ends = np.cumsum([one.num_envs for one in self.batches]).tolist()
        self.observed: list[np.ndarray] = []
        """The last observations of each batch, in its own layout."""
        self._contexts: list[np.ndarray] = []
        self._rows = [slice(end - one.num_envs, end) for end, one in zip(ends, self.batches)]
        self._pool = ThreadPoolExecutor(os.cpu_count())
        space = spaces.Box(-1.0, 1.0, (self.layout.size,), np.float32)
        super().__init__(ends[-1], space, self.batches[0].action_space)

    def reset(self) -> np.ndarray:
        """Reset all."""
        return self._laid_out([one.reset() for one in self.batches])

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Of the first environment of each scenario; the others have the following ones."""
        return [own for one in self.batches for own in one.seed(seed)]

    def step_async(self, actions: np.ndarray) -> None:
        """Take the actions for `step_wait`."""
        for rows, one in zip(self._rows, self.batches):
            one.step_async(actions[rows])

    def step_wait(self) -> VecEnvStepReturn:
        """One decision of every environment."""
        each = self._pool.map(lambda one: one.step_wait(), self.batches)
        observations, rewards, dones, infos = zip(*each)
        for inputs, contexts, of_batch in zip(self._inputs, self._contexts, infos):
            for context, info in zip(contexts, of_batch):
                if "terminal_observation" in info:  # with the context of the decision before the end
                    info["terminal_observation"] = inputs(info["terminal_observation"][None], context[None])[0]
        every_info = [info for of_batch in infos for info in of_batch]
        return self._laid_out(observations), np.concatenate(rewards), np.concatenate(dones), every_info

    def close(self) -> None:
        """Close the batches, and end the threads."""
        self._pool.shutdown()
        for one in self.batches:
            one.close()

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """An attribute of each environment, or of the batch."""
        each = [own for one in self.batches for own in one.get_attr(attr_name)]
        return [each[i] for i in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Set an attribute that all environments share. Raises ValueError where ``indices`` are not all of them."""
        if set(self._get_indices(indices)) != set(range(self.num_envs)):
            raise ValueError(f"indices must be None: the environments share their attributes, got {indices!r}")
        for one in self.batches:
            one.set_attr(attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **kwargs: Any
    ) -> list[Any]:
        """Call a method that reads single environments."""
        return [method(*method_args, **kwargs) for method in self.get_attr(method_name, indices)]

    def env_is_wrapped(self, wrapper_class: type[Any], indices: VecEnvIndices = None) -> list[bool]:
        """True of the one that records episodes, as each batch does; there are no single environments to wrap."""
        return [issubclass(wrapper_class, Monitor) for _ in self._get_indices(indices)]

    def _laid_out(self, observed: Sequence[np.ndarray]) -> np.ndarray:
        self.observed, self._contexts = list(observed), [one.unwrapped.context for one in self.batches]
        return np.concatenate([inputs(*own) for inputs, *own in zip(self._inputs, observed, self._contexts)])
