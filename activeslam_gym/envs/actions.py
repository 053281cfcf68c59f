"""Reading actions and options: whatever a client hands in becomes indices and a dict, or a clear error."""

from typing import Any

import numpy as np
from gymnasium import spaces

from activeslam_gym.motion import GAZE_COUNT, MOTION_COUNT, nearest_motion

_PAIR = f"two whole numbers, a motion in 0 … {MOTION_COUNT - 1} and a gaze in 0 … {GAZE_COUNT - 1}"
_POINT = "four numbers in -1 … 1, a displacement along the camera's x, y and z and a turn"
_INDEX = f"one whole number in 0 … {MOTION_COUNT * GAZE_COUNT - 1}"


def action_space() -> spaces.MultiDiscrete:
    """Of `ActiveSLAM-v0`: a motion and a gaze."""
    return spaces.MultiDiscrete([MOTION_COUNT, GAZE_COUNT])


def discrete_action_space() -> spaces.Discrete:
    """Of `ActiveSLAMDiscrete-v0`: the index 3 motion + gaze."""
    return spaces.Discrete(MOTION_COUNT * GAZE_COUNT)


def continuous_action_space() -> spaces.Box:
    """Of `ActiveSLAMContinuous-v0`: a displacement in steps, camera axes, and a share of the turn rate."""
    return spaces.Box(-1.0, 1.0, (4,), np.float32)


def action_masks(space: spaces.Space[Any], commands: np.ndarray, phases: np.ndarray) -> np.ndarray:
    """Which choices can make a difference, bool (B, 7 + 3), motions first, or (B, 21) in a discrete ``space``.

    Where ``phases`` (B,) is 0 a motion is about to be read and all may be chosen; elsewhere the motion of an action is
    ignored, and of the seven the one under way, of the ``commands`` (B, 4), is left.

    Raises:
        AttributeError: the actions are continuous.
    """
    if isinstance(space, spaces.Box):
        raise AttributeError("continuous actions have no masks")
    under_way = np.array([nearest_motion(command) for command in commands])
    motions = (phases == 0)[:, None] | (np.arange(MOTION_COUNT) == under_way[:, None])
    if isinstance(space, spaces.Discrete):
        return np.repeat(motions, GAZE_COUNT, axis=1)
    return np.hstack((motions, np.ones((len(motions), GAZE_COUNT), bool)))


def checked_options(options: dict[str, Any] | None) -> dict[str, Any]:
    """The ``options`` of a reset; an empty dict for None.

    Raises:
        ValueError: they are no dict.
    """
    if not isinstance(options, (dict, type(None))):
        raise ValueError(f"options must be a dict or None, got {options!r}")
    return options or {}


def motion_and_gaze(action: Any) -> tuple[int, int]:
    """The indices of a MultiDiscrete([7, 3]) action: any sequence of two whole numbers.

    Raises:
        ValueError: it is something else; the message says what is allowed.
    """
    array = np.asarray(action)
    if array.shape == (2,) and array.dtype.kind in "iuf":
        motion, gaze = array.tolist()
        if 0 <= motion < MOTION_COUNT and 0 <= gaze < GAZE_COUNT and motion == int(motion) and gaze == int(gaze):
            return int(motion), int(gaze)
    raise ValueError(f"action must be {_PAIR}, got {action!r}")


def split_index(action: Any) -> tuple[int, int]:
    """The indices of a Discrete(21) action, 3 motion + gaze.

    Raises:
        ValueError: it is not one whole number in the range; the message says what is allowed.
    """
    array = np.asarray(action)
    if array.size == 1 and array.dtype.kind in "iuf":
        index = array.item()
        if 0 <= index < MOTION_COUNT * GAZE_COUNT and index == int(index):
            return divmod(int(index), GAZE_COUNT)
    raise ValueError(f"action must be {_INDEX}, got {action!r}")


def motions_and_gazes(actions: Any, playing: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The indices (B,), (B,) of a batch of MultiDiscrete([7, 3]) actions (B, 2).

    Those of environments that are not ``playing`` (B,) are ignored and come out as 0.

    Raises:
        ValueError: of shape or values outside the action space; the message names the first and what is allowed.
    """
    pairs = _whole_numbers(actions, (len(playing), 2), np.array((MOTION_COUNT, GAZE_COUNT)), playing, _PAIR)
    return pairs[:, 0], pairs[:, 1]


def split_indices(actions: Any, playing: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The indices (B,), (B,) of a batch of Discrete(21) actions (B,); see `motions_and_gazes`."""
    return np.divmod(
        _whole_numbers(actions, (len(playing),), np.array(MOTION_COUNT * GAZE_COUNT), playing, _INDEX), GAZE_COUNT
    )


def command_of(action: Any) -> np.ndarray:
    """The command (4,) of a continuous action; a displacement longer than a step is shortened to it.

    Raises:
        ValueError: it is not four numbers in [-1, 1]; the message says what is allowed.
    """
    array = _as_array(action)
    if array.shape != (4,) or array.dtype.kind not in "iuf" or not (np.abs(array) <= 1.0).all():
        raise ValueError(f"action must be {_POINT}, got {action!r}")
    return _within_a_step(array[None])[0]


def commands_of(actions: Any, playing: np.ndarray) -> np.ndarray:
    """The commands (B, 4) of a batch of continuous actions (B, 4), zero where not ``playing`` (B,); see `command_of`.

    Raises:
        ValueError: of another shape or out of range; the message names the first and what is allowed.
    """
    array = _numbers(actions, (len(playing), 4), _POINT)
    _demand((np.abs(array) <= 1.0).all(axis=1) | ~playing, array, _POINT)
    return _within_a_step(np.where(playing[:, None], array, 0.0))


def _within_a_step(commands: np.ndarray) -> np.ndarray:
    """``commands`` (B, 4) with displacements of length 1 at most, in double precision whatever they were given in."""
    commands = commands.astype(float)
    length = np.sqrt((commands[:, :3] ** 2).sum(axis=1, keepdims=True))
    return np.concatenate((commands[:, :3] / np.maximum(length, 1.0), commands[:, 3:]), axis=1)


def _whole_numbers(
    actions: Any, shape: tuple[int, ...], counts: np.ndarray, playing: np.ndarray, allowed: str
) -> np.ndarray:
    """``actions`` of ``shape`` as int64, each in 0 … ``counts`` - 1 where its environment is playing, 0 elsewhere."""
    array = _numbers(actions, shape, allowed)
    playing = playing.reshape(-1, *(1 for _ in shape[1:]))
    good = (array >= 0) & (array < counts) & (array == np.floor(array)) | ~playing
    _demand(good.reshape(len(array), -1).all(axis=1), array, allowed)
    return np.where(playing, array, 0).astype(np.int64)


def _as_array(value: Any) -> np.ndarray:
    """``value`` as an array; one of no shape where its rows are of different lengths."""
    try:
        return np.asarray(value)
    except ValueError:
        return np.asarray(None)


def _numbers(actions: Any, shape: tuple[int, ...], allowed: str) -> np.ndarray:
    """A batch's actions as an array of numbers of that shape, or the error that says what is allowed."""
    array = _as_array(actions)
    if array.shape != shape or array.dtype.kind not in "iuf":
        raise ValueError(f"actions must be numbers of shape {shape}, for each environment {allowed}, got {actions!r}")
    return array


def _demand(good: np.ndarray, actions: np.ndarray, allowed: str) -> None:
    """Raise ValueError for the first of ``actions`` that is not ``good`` (B,)."""
    if not good.all():
        i = int(np.argmin(good))
        raise ValueError(f"actions[{i}] must be {allowed}, got {actions[i]!r}")
