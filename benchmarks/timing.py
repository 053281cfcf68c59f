"""Repeated timings of a call; `timeit` runs them without the garbage collector."""

from collections.abc import Callable, Sequence
from timeit import repeat, timeit
from typing import Any

import numpy as np

Call = Callable[[], Any]
TURN = 50


def timed(call: Call) -> float:
    """Time of one ``call`` [s]."""
    return timeit(call, number=1)


def repeated(call: Call, repeats: int, at_least: float) -> np.ndarray:
    """Times (repeats,) of one ``call`` [s], each the mean of a loop of about ``at_least`` [s], after one call."""
    call()
    number = max(1, int(at_least / max(timed(call), 1e-9)))
    return np.array(repeat(call, number=number, repeat=repeats)) / number


def restored(calls: Sequence[Call], restore: Call, count: int) -> np.ndarray:
    """Median times (turns, calls) of ``calls`` that change their arguments [s], of ``count`` each after ``restore``.

    They take turns of `TURN` calls in succession: changes of the machine meet all alike, and each has its own code in
    the caches.
    """
    seconds = np.empty((count // TURN, len(calls), TURN))
    for turn in seconds:
        for call, times in zip(calls, turn):
            restore()
            call()
            times[:] = repeat(call, restore, number=1, repeat=TURN)
    return np.median(seconds, axis=2)
