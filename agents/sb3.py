"""For Stable-Baselines3: the batch environment as its `VecEnv`, and a callback that logs episodes."""

import os
from collections import deque
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Literal

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvStepReturn

from activeslam_gym import ActiveSLAMVectorEnv, observation_layout
from activeslam_gym.envs.info import info_at
from agents.learn.inputs import Inputs, common_size

Actions = Literal["pairs", "indices", "points"]
BATCHES = {"pairs": "ActiveSLAM-v0", "indices": "ActiveSLAMDiscrete-v0", "points": "ActiveSLAMContinuous-v0"}
"""Ids of the environments with these actions."""


class ActiveSLAMVecEnv(VecEnv):
    """`ActiveSLAMVectorEnv` in mode SAME_STEP behind SB3's interface.

    An environment's dict of `infos` has its last `info` when its episode ends, with ``terminal_observation`` and
    ``TimeLimit.truncated``, and is empty before: a dict for each environment and step would cost time. The latter is
    False at the time limit too: the return is that of a finite horizon and the observation has the time, so that SB3
    must not add the value of the last observation.

    `baselines.make(name, env)` and `observation_layout(env)` take it, also under SB3's wrappers: it is read as the
    batch environment within (`unwrapped`).

    Args:
        num_envs: Environments in the batch.
        actions: A motion and a gaze, one index = 3 motion + gaze, or the four numbers of ``ActiveSLAMContinuous-v0``.
        kwargs: Arguments of `ActiveSLAMVectorEnv`.

    Raises:
        ValueError: a bad argument; the message names it, its value and what is allowed.
    """

    def __init__(self, num_envs: int, actions: Actions = "pairs", **kwargs: Any) -> None:
        if actions not in BATCHES:
            raise ValueError(f"actions: {actions!r}; allowed: {', '.join(BATCHES)}")
        self.env: Any = gym.make_vec(BATCHES[actions], num_envs, autoreset_mode=AutoresetMode.SAME_STEP, **kwargs)
        self._actions: np.ndarray | None = None
        super().__init__(num_envs, self.env.single_observation_space, self.env.single_action_space)
        self.metadata["render_fps"] = self.env.metadata["render_fps"]

    @property
    def unwrapped(self) -> ActiveSLAMVectorEnv:  # type: ignore[override]
        """The batch environment, whose belief and scores policies read."""
        return self.env

    def reset(self) -> np.ndarray:
        """Reset all, with the seeds of `seed` if it was called since the last time."""
        observations, infos = self.env.reset(seed=self._seeds)
        self.reset_infos = [info_at(infos, i) for i in range(self.num_envs)]
        self._reset_seeds()
        self._reset_options()
        return observations

    def step_async(self, actions: np.ndarray) -> None:
        """Take the actions, (B, 2) if they are pairs, for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """One gaze period; see `ActiveSLAMVectorEnv.step`. Environments whose episode ended have been reset."""
        observations, rewards, terminated, truncated, infos = self.env.step(self._actions)
        dones = terminated | truncated
        ended: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        if dones.any():
            last_observations, last_infos = infos.pop("final_obs"), infos.pop("final_info")
            for i in np.flatnonzero(dones).tolist():
                last = {"terminal_observation": last_observations[i], "TimeLimit.truncated": False}
                ended[i] = info_at(last_infos, i) | last
                self.reset_infos[i] = info_at(infos, i)
        return observations, rewards.astype(np.float32), dones, ended

    def close(self) -> None:
        """End the threads."""
        self.env.close()

    def get_images(self) -> Sequence[np.ndarray | None]:
        """The present moment of each environment, if ``render_mode`` is "rgb_array"."""
        return self.env.render() or [None] * self.num_envs

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """An attribute of each environment, or of the batch."""
        return [self._of(attr_name, int(i)) for i in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Set an attribute that all environments share. Raises ValueError where ``indices`` are not all of them."""
        if set(self._get_indices(indices)) != set(range(self.num_envs)):
            raise ValueError(f"indices must be None: the environments share their attributes, got {indices!r}")
        setattr(self.env, attr_name, value)

    def env_method(self, method_name: str, *args: Any, indices: VecEnvIndices = None, **kwargs: Any) -> list[Any]:
        """Call a method that reads single environments, for instance ``env_method("motion_scores", indices=[3])``."""
        if method_name == "action_masks":  # those of the whole batch in one call, which a learner asks at each step
            return list(self.env.action_masks()[self._get_indices(indices)])
        return [method(*args, **kwargs) for method in self.get_attr(method_name, indices)]

    def env_is_wrapped(self, wrapper_class: type[Any], indices: VecEnvIndices = None) -> list[bool]:
        """None is: there are no single environments to wrap."""
        return [False for _ in self._get_indices(indices)]

    def _of(self, name: str, i: int) -> Any:
        """An attribute of environment ``i``, as a single environment has it."""
        if name == "action_masks":
            return lambda: self.env.action_masks()[i]
        for owner, known_as in ((self.env.run(i), name), (self.env, f"single_{name}")):
            if hasattr(owner, known_as):
                return getattr(owner, known_as)
        return getattr(self.env, name)


class ScaledReward(VecEnvWrapper):
    """Rewards within ± ``clip``, times a constant ``scale``: no running normalisation, whose scale would drift.

    The failure penalty (`info["reward_terms"]["lost_penalty"]`) is not clipped; it counts ``penalty_weight``
    times.
    """

    def __init__(self, venv: VecEnv, scale: float, clip: float = np.inf, penalty_weight: float = 1.0) -> None:
        super().__init__(venv)
        self.scale, self.clip, self.penalty_weight = scale, clip, penalty_weight

    def reset(self) -> np.ndarray:
        """As the wrapped environment."""
        return self.venv.reset()

    def step_wait(self) -> VecEnvStepReturn:
        """As the wrapped environment, the rewards scaled."""
        observations, rewards, dones, infos = self.venv.step_wait()
        lost_penalties = np.zeros_like(rewards)
        for i in np.flatnonzero(dones).tolist():
            lost_penalties[i] = infos[i]["reward_terms"]["lost_penalty"]
        gains = np.clip(rewards - lost_penalties, -self.clip, self.clip) + self.penalty_weight * lost_penalties
        return observations, self.scale * gains, dones, infos


class SeveralScenarios(VecEnv):
    """Batches of different scenarios as one, with the context behind the global features (`Inputs`).

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
        """As `ActiveSLAMVecEnv.set_attr`."""
        for one in self.batches:
            one.set_attr(attr_name, value, indices)

    def env_method(self, method_name: str, *args: Any, indices: VecEnvIndices = None, **kwargs: Any) -> list[Any]:
        """As `ActiveSLAMVecEnv.env_method`."""
        return [method(*args, **kwargs) for method in self.get_attr(method_name, indices)]

    def env_is_wrapped(self, wrapper_class: type[Any], indices: VecEnvIndices = None) -> list[bool]:
        """True of the one that records episodes, as each batch does; there are no single environments to wrap."""
        return [issubclass(wrapper_class, Monitor) for _ in self._get_indices(indices)]

    def _laid_out(self, observed: Sequence[np.ndarray]) -> np.ndarray:
        self._contexts = [one.unwrapped.context for one in self.batches]
        return np.concatenate([inputs(*own) for inputs, *own in zip(self._inputs, observed, self._contexts)])


class EpisodeLog(BaseCallback):
    """Log the episodes that end in training, beside what the learner logs itself.

    For any learner of Stable-Baselines3 or sb3-contrib but ARS, on `ActiveSLAMVecEnv` as on `make_vec_env`:
    ``PPO("MlpPolicy", env, tensorboard_log="logs").learn(100_000, callback=EpisodeLog())``. Under ``rollout/`` it
    records ``log_score``, the mean [bit], and ``failures``, the share of episodes that were lost or ended with a log
    score under 0.

    Args:
        window: The last so many episodes count.

    Raises:
        ValueError: ``window`` is no positive number; or later, the learner is ARS, which calls back in no step.
        KeyError: an environment's ``info`` has no ``log_score``: it is none of ActiveSLAM.
    """

    def __init__(self, window: int = 100) -> None:
        super().__init__()
        if window < 1:
            raise ValueError(f"window: {window}; allowed: 1 or more episodes")
        self._ended = deque[tuple[float, bool]](maxlen=window)  # log score and failure

    def _on_step(self) -> bool:
        if "infos" not in self.locals:
            raise ValueError("EpisodeLog: the learner calls back in no step, as ARS; allowed: any other")
        ended = [info for info, done in zip(self.locals["infos"], self.locals["dones"]) if done]
        self._ended.extend((info["log_score"], info["lost"] or info["log_score"] < 0.0) for info in ended)
        if ended:
            log_score, failures = np.mean(self._ended, axis=0).tolist()
            self.logger.record("rollout/log_score", log_score)
            self.logger.record("rollout/failures", failures)
        return True
