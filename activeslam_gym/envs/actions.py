"""Reading actions: whatever a client hands in becomes two indices, or a clear error."""

from __future__ import annotations

from typing import Any

import numpy as np

from activeslam_gym.motion import GAZE_COUNT, MOTION_COUNT


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
    raise ValueError(
        f"action must be two whole numbers, a motion in 0 … {MOTION_COUNT - 1} and a gaze in 0 … {GAZE_COUNT - 1}, "
        f"got {action!r}"
    )


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
    raise ValueError(f"action must be one whole number in 0 … {MOTION_COUNT * GAZE_COUNT - 1}, got {action!r}")
