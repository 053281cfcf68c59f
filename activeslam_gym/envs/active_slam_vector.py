"""``ActiveSLAM-v0`` a batch at a time: ``gymnasium.make_vec("ActiveSLAM-v0", num_envs=64)``."""

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from activeslam_gym.config import Scenario, whole_number
from activeslam_gym.envs.actions import INDICES, POINTS, checked_options
from activeslam_gym.envs.info import infos_of
from activeslam_gym.envs.observation import observation_space
from activeslam_gym.envs.public import BatchReads
from activeslam_gym.envs.reset import empty_runs
from activeslam_gym.envs.setting import checked_images, checked_rendering, resolve
from activeslam_gym.envs.snapshot import Snapshot, snapshot_of
from activeslam_gym.envs.step import BEGIN, REST, STEP
from activeslam_gym.threads import Workers


class ActiveSLAMVectorEnv(BatchReads, VectorEnv[np.ndarray, np.ndarray, np.ndarray]):
    """`ActiveSLAMEnv` for ``num_envs`` cameras, each in its own room; see there for what one of them is.

    Each environment's trajectory is that of a single environment of its seed to the bit, whatever ``num_envs`` and
    ``num_threads``, through every autoreset too. Observations, rewards, `infos` (masks ``_key`` beside each ``key``),
    ``final_obs`` and ``final_info`` are as `gymnasium.vector.SyncVectorEnv` gives them, and fresh at each step. What
    `ActiveSLAMEnv` lets policies read has here a leading axis.

    ## Arguments
    Those of `ActiveSLAMEnv`, where ``render_mode`` is None or "rgb_array", and
    ``num_envs``;
    ``num_threads``: at most this many run at once (None: as many as cores that the process may use; see `threads`);
    ``autoreset_mode``: an `AutoresetMode`, its name or its value: NEXT_STEP resets an ended environment in the next
    step, which ignores its action; SAME_STEP in the step that ends it; DISABLED never;
    ``max_episode_steps``: truncates, besides ``duration``.

    Raises:
        ValueError: a bad argument or action; the message names it, its value and what is allowed.
        TypeError: there is no such argument.
    """

    metadata: dict[str, Any] = {
        "render_modes": ["rgb_array"],
        "render_fps": 20,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }
    closed = True  # until the constructor has taken its arguments

    def __init__(
        self,
        num_envs: int = 1,
        scenario: str | Mapping[str, Any] | Scenario = "paper",
        *,
        num_threads: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
        render_size: tuple[int, int] = (960, 640),
        **arguments: Any,
    ) -> None:
        modes = self.metadata["render_modes"]
        self.render_mode, self.render_size = checked_rendering(render_mode, modes, render_size)
        self.num_envs = whole_number("num_envs", num_envs)
        self.autoreset_mode = _mode(autoreset_mode)
        setting = resolve(scenario, **arguments)
        super().__init__(setting, empty_runs(setting.scenario, self.num_envs), Workers(self.num_envs, num_threads))
        self.metadata = {**self.metadata, "render_fps": setting.render_rate, "autoreset_mode": self.autoreset_mode}
        self.single_observation_space = observation_space(setting.layout)
        self.single_action_space = self._encoding.space()
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        limit = int(setting.task.steps) if max_episode_steps is None else max_episode_steps
        self._steps = min(int(setting.task.steps), whole_number("max_episode_steps", limit))
        self._seeded: list[tuple[np.random.Generator, int] | None] = [None] * self.num_envs
        self._over = np.zeros(self.num_envs, bool)
        self.closed = False

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin new runs: in all environments, or where ``options["reset_mask"]``, (B,) bool, is true.

        ``seed``: an int (environment i has ``seed`` + i), one for each environment, or None.

        Raises:
            ValueError: a seed or the mask is not so.
        """
        seeds, chosen = _seeds(seed, self.num_envs), _reset_mask(options, self.num_envs)
        for i in np.flatnonzero(chosen).tolist():
            if seeds[i] is not None:
                self._seeded[i] = seeding.np_random(seeds[i])
        self._begin(chosen)
        return self._runs.observation.copy(), infos_of(self._runs, self.setting.reward, chosen)

    def step(self, actions: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """One gaze period of every environment.

        ``actions``: (B, 2) of motions and gazes, in the discrete variant (B,), in the continuous one (B, 4).

        Raises:
            ValueError: an action is outside the action space.
            gymnasium.error.ResetNeeded: a run has not begun, or in mode DISABLED it has ended.
        """
        self._demand_reset()
        beginning = self._over  # of these NEXT_STEP ignores the action, in the other modes there are none
        commands = self._encoding.read(actions, ~beginning)
        self._reset_runs(beginning)
        self._play(np.where(beginning, BEGIN, STEP), np.where(beginning[:, None], 0.0, commands))
        episode = self._runs.episode
        rewards = episode["reward"].copy()
        terminated = episode["lost"] & ~beginning & self._end_when_lost
        truncated = episode["steps"] >= self._steps
        self._over = terminated | truncated
        infos = self._end_same_step() if self.autoreset_mode is AutoresetMode.SAME_STEP else {}
        infos.update(infos_of(self._runs, self.setting.reward, np.ones(self.num_envs, bool)))
        return self._runs.observation.copy(), rewards, terminated, truncated, infos

    def call(self, name: str, *args: Any, **kwargs: Any) -> Any:
        """The attribute or method ``name`` of the batch, as clients of `gymnasium.vector.SyncVectorEnv` ask for it.

        A method, and what differs from run to run, has a leading axis; of what all share, a tuple has it B times.
        """
        found = getattr(self, name)
        if callable(found) or isinstance(getattr(type(self), name, None), property):
            return found(*args, **kwargs) if callable(found) else found
        return (getattr(self, f"single_{name}", found),) * self.num_envs

    def get_attr(self, name: str) -> Any:
        """The attribute ``name``; see `call`."""
        return self.call(name)

    def render(self) -> tuple[np.ndarray, ...] | None:
        """The present moment of each environment, (H, W, 3) uint8 images, in ``rgb_array`` mode.

        Raises:
            gymnasium.error.ResetNeeded: there is nothing to draw before the first reset.
        """
        if self.render_mode is None:
            gymnasium.logger.warn("render() does nothing without a render_mode; make the environment with 'rgb_array'")
            return None
        from activeslam_gym.rendering.picture import draw

        return tuple(draw(self.snapshot(i), self.render_size) for i in range(self.num_envs))

    def close_extras(self, **kwargs: Any) -> None:
        """End the threads."""
        self._workers.close()

    @property  # type: ignore[misc]
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """The generators of the environments."""
        return tuple(self._generator_and_seed(i)[0] for i in range(self.num_envs))

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """The seeds of the environments' generators."""
        return tuple(self._generator_and_seed(i)[1] for i in range(self.num_envs))

    def snapshot(self, i: int) -> Snapshot:
        """All that a picture of this moment of environment ``i`` needs.

        Raises:
            gymnasium.error.ResetNeeded: its run has not begun.
        """
        return snapshot_of(self, i)

    def _demand_reset(self) -> None:
        begun = self._runs.episode["begun"]
        ready = begun & ~self._over if self.autoreset_mode is AutoresetMode.DISABLED else begun
        if not ready.all():
            idle = np.flatnonzero(~ready).tolist()
            raise gymnasium.error.ResetNeeded(
                f"the runs of environments {idle} have ended or have not begun: call reset() before step()"
            )

    def _begin(self, chosen: np.ndarray) -> None:
        """Begin the runs that are ``chosen`` (B,), and leave the others alone."""
        self._reset_runs(chosen)
        self._play(np.where(chosen, BEGIN, REST), np.where(chosen[:, None], 0.0, self._commands))
        self._over = self._over & ~chosen

    def _reset_runs(self, chosen: np.ndarray) -> None:
        """Give new rooms, each by a key of its own generator, where ``chosen`` (B,)."""
        for i in np.flatnonzero(chosen).tolist():
            generator, _ = self._generator_and_seed(i)
            self._reset_run(i, key=int(generator.integers(2**63)))

    def _generator_and_seed(self, i: int) -> tuple[np.random.Generator, int]:
        """Those of environment ``i``, from a seed of their own where it was given none."""
        self._seeded[i] = seeded = self._seeded[i] or seeding.np_random()
        return seeded

    def _end_same_step(self) -> dict[str, Any]:
        """Reset where a run is over, and return what it ended with: ``final_obs``, ``final_info``."""
        over = self._over
        if not over.any():
            return {}
        observations = np.full(self.num_envs, None, dtype=object)
        for i in np.flatnonzero(over).tolist():
            observations[i] = self._runs.observation[i].copy()
        ended = {"final_obs": observations, "final_info": infos_of(self._runs, self.setting.reward, over)}
        masks = {f"_{key}": over.copy() for key in ended}
        self._begin(over)
        return ended | masks


class ActiveSLAMDiscreteVectorEnv(ActiveSLAMVectorEnv):
    """``ActiveSLAMDiscrete-v0`` a batch at a time: one integer for an action, index = 3 motion + gaze."""

    _encoding = INDICES


class ActiveSLAMContinuousVectorEnv(ActiveSLAMVectorEnv):
    """``ActiveSLAMContinuous-v0`` a batch at a time: actions (B, 4), see `ActiveSLAMContinuousEnv`."""

    _encoding = POINTS


class ActiveSLAMPixelsVectorEnv(ActiveSLAMVectorEnv):
    """``ActiveSLAMPixels-v0`` a batch at a time: what `ActiveSLAMVectorEnv` is to `ActiveSLAMEnv`."""

    def __init__(
        self,
        num_envs: int = 1,
        scenario: str | Mapping[str, Any] | Scenario = "pixels",
        *,
        sensor: Any = None,
        **arguments: Any,
    ) -> None:
        super().__init__(num_envs, scenario, sensor=checked_images(sensor), **arguments)


def _mode(mode: AutoresetMode | str) -> AutoresetMode:
    """The mode that is meant: an enum member, its name or its value."""
    for member in AutoresetMode:
        if isinstance(mode, (str, AutoresetMode)) and mode in (member, member.name, member.value):
            return member
    names = ", ".join(f"{member.name} ({member.value!r})" for member in AutoresetMode)
    raise ValueError(f"autoreset_mode must be one of {names}, got {mode!r}")


def _seeds(seed: int | Sequence[int | None] | None, count: int) -> list[int | None]:
    """A seed for each environment: ``seed`` + i, or those of a sequence; None leaves a generator as it is."""
    if seed is None:
        return [None] * count
    if np.ndim(seed) == 0:  # type: ignore[arg-type]
        first = whole_number("seed", seed, 0)
        return [first + i for i in range(count)]
    given = list(seed)  # type: ignore[arg-type]
    if len(given) != count:
        raise ValueError(f"seed must be one number or {count} (num_envs) of them, got {len(given)}: {seed!r}")
    return [None if one is None else whole_number("seed", one, 0) for one in given]


def _reset_mask(options: dict[str, Any] | None, count: int) -> np.ndarray:
    """Which environments to reset, (B,): all, or those of ``options["reset_mask"]``."""
    mask = checked_options(options, "reset_mask").get("reset_mask", np.ones(count, bool))
    if not (isinstance(mask, np.ndarray) and mask.shape == (count,) and mask.dtype == np.bool_ and mask.any()):
        raise ValueError(f"options['reset_mask'] must be a bool array ({count},) with a true value, got {mask!r}")
    return mask.copy()
