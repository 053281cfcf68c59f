"""Reading actions and options: whatever a client hands in becomes commands and a dict, or a clear error."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from activeslam_gym.motion import COMMANDS, GAZE_COUNT, MOTION_COUNT


@dataclass(frozen=True)
class Encoding:
    """How numbers mean a motion and a gaze."""

    space: Callable[[], spaces.Space[Any]]  # makes the action space
    shape: tuple[int, ...]  # of one action
    least: float
    most: tuple[float, ...]  # of each number
    whole: bool  # the numbers must be whole
    allowed: str  # the same in words, for errors
    commands: Callable[..., np.ndarray]
    """From the numbers of an action to its command (4,), or from k arrays (B,) to (B, 4); see `motion.COMMANDS`."""

    def read_one(self, action: Any) -> np.ndarray:
        """The command (4,) of an action; a ValueError states what is allowed where it is outside the action space."""
        array = _as_array(action)
        if (array.shape == self.shape or array.size == 1 and not self.shape) and array.dtype.kind in "iuf":
            numbers = array.ravel().tolist()
            limits = zip(numbers, self.most, strict=True)
            if all(self.least <= x <= most and (not self.whole or x == int(x)) for x, most in limits):
                return self.commands(*(map(int, numbers) if self.whole else numbers))
        raise ValueError(f"action must be {self.allowed}, got {action!r}")

    def read(self, actions: Any, playing: np.ndarray) -> np.ndarray:
        """The same of a batch: (B, 4) of actions (B, ...); those of environments not ``playing`` (B,) are ignored."""
        array, shape = _as_array(actions), (len(playing), *self.shape)
        if array.shape != shape or array.dtype.kind not in "iuf":
            raise ValueError(
                f"actions must be numbers of shape {shape}, for each environment {self.allowed}, got {actions!r}"
            )
        rows = array.reshape(len(array), -1)
        inside = (rows >= self.least) & (rows <= self.most) & (not self.whole or rows == np.floor(rows))
        good = inside.all(axis=1) | ~playing
        if not good.all():
            i = int(np.argmin(good))
            raise ValueError(f"actions[{i}] must be {self.allowed}, got {array[i]!r}")
        rows = np.where(playing[:, None], rows, 0)
        return self.commands(*(rows.astype(int) if self.whole else rows).T)


def _as_array(value: Any) -> np.ndarray:
    """``value`` as an array; one of no shape where its rows are of different lengths."""
    try:
        return np.asarray(value)
    except ValueError:
        return np.asarray(None)


def _within_a_step(*numbers: Any) -> np.ndarray:
    """The command (..., 4) with a displacement of length 1 at most, in double precision whatever it was given in."""
    command = np.stack(numbers, axis=-1).astype(float)
    length = np.sqrt((command[..., :3] ** 2).sum(axis=-1, keepdims=True))
    command[..., :3] /= np.maximum(length, 1.0)
    return command


PAIRS = Encoding(
    lambda: spaces.MultiDiscrete([MOTION_COUNT, GAZE_COUNT]),
    (2,), 0, (MOTION_COUNT - 1, GAZE_COUNT - 1), True,
    f"two whole numbers, a motion in 0 … {MOTION_COUNT - 1} and a gaze in 0 … {GAZE_COUNT - 1}",
    lambda motion, gaze: COMMANDS[motion, gaze],
)  # fmt: skip
"""Of `ActiveSLAM-v0`: a motion and a gaze."""
INDICES = Encoding(
    lambda: spaces.Discrete(MOTION_COUNT * GAZE_COUNT),
    (), 0, (MOTION_COUNT * GAZE_COUNT - 1,), True,
    f"one whole number in 0 … {MOTION_COUNT * GAZE_COUNT - 1}",
    lambda index: COMMANDS[divmod(index, GAZE_COUNT)],
)  # fmt: skip
"""Of `ActiveSLAMDiscrete-v0`: the index 3 motion + gaze."""
POINTS = Encoding(
    lambda: spaces.Box(-1.0, 1.0, (4,), np.float32),
    (4,), -1.0, (1.0,) * 4, False,
    "four numbers in -1 … 1, a displacement along the camera's x, y and z and a turn",
    _within_a_step,
)  # fmt: skip
"""Of `ActiveSLAMContinuous-v0`: a displacement in steps, camera axes, and a share of the turn rate."""


def checked_options(options: dict[str, Any] | None, *known: str) -> dict[str, Any]:
    """The ``options`` of a reset, an empty dict for None; warns of keys that are not ``known``.

    Raises:
        ValueError: they are no dict.
    """
    if not isinstance(options, (dict, type(None))):
        raise ValueError(f"options must be a dict or None, got {options!r}")
    for key in (options or {}).keys() - set(known):
        gymnasium.logger.warn(f"reset() ignores options[{key!r}]; what an episode is like is set by gym.make")
    return options or {}
