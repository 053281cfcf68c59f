"""Repeated timings of a call, without the garbage collector."""

import gc
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

Call = Callable[[], Any]
TURN = 50


def timed(call: Call) -> float:
    """Time of one ``call`` [s]."""
    gc.disable()
    try:
        start = time.perf_counter()
        call()
        return time.perf_counter() - start
    finally:
        gc.enable()


def repeated(call: Call, repeats: int, at_least: float) -> np.ndarray:
    """Times (repeats,) of one ``call`` [s], each the mean of a loop of about ``at_least`` [s], after one call."""
    call()
    number = max(1, int(at_least / max(timed(call), 1e-9)))

    def loop() -> None:
        for _ in range(number):
            call()

    return np.array([timed(loop) for _ in range(repeats)]) / number


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
            for i in range(TURN):
                restore()
                times[i] = timed(call)
    return np.median(seconds, axis=2)
