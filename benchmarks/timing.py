"""Medians of repeated runs, what the clock's calls cost, and the machine that they ran on."""

import gc
import platform
import statistics
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from activeslam_gym.threads import available_cores
from agents.tools.machine import package_versions, processor

PACKAGES = ("activeslam-gym", "gymnasium", "numba", "numpy", "scipy", "filterpy")


class Timing(NamedTuple):
    """Seconds of one call, over several repeats; `seconds` is the median."""

    seconds: float
    fastest: float
    slowest: float
    repeats: int


def summary(seconds: list[float]) -> Timing:
    """The median of ``seconds`` and their range."""
    return Timing(statistics.median(seconds), min(seconds), max(seconds), len(seconds))


def timed(call: Callable[[], Any]) -> float:
    """Seconds of one ``call``, without the garbage collector."""
    gc.disable()
    try:
        start = time.perf_counter()
        call()
        return time.perf_counter() - start
    finally:
        gc.enable()


def repeated(call: Callable[[], Any], repeats: int, at_least: float) -> Timing:
    """Time of one ``call``: the median of ``repeats`` loops of about ``at_least`` [s], after one call."""
    call()
    number = max(1, int(at_least / max(timed(call), 1e-9)))

    def loop() -> None:
        for _ in range(number):
            call()

    return summary([timed(loop) / number for _ in range(repeats)])


def restored(call: Callable[[], Any], restore: Callable[[], Any], count: int) -> Timing:
    """Time of a ``call`` that changes its arguments: the median of ``count`` calls, each after ``restore``."""
    restore()
    call()
    seconds = []
    for _ in range(count):
        restore()
        seconds.append(timed(call))
    return summary(seconds)


def dispatch(arguments: tuple[Any, ...], result: Any = None, count: int = 500) -> float:
    """Median seconds to hand a compiled function these ``arguments``, and to hand back such a ``result``.

    Taken from what a call from Python takes, it leaves the kernel itself: named tuples of arrays are slow to hand over.
    """

    @njit
    def nothing(arguments: Any) -> int:
        return 0

    @njit
    def identity(argument: Any) -> Any:
        return argument

    def cost(call: Callable[[Any], Any], argument: Any) -> float:
        return restored(lambda: call(argument), lambda: None, count).seconds

    there = cost(nothing, arguments)
    return there if result is None else there + max(0.0, cost(identity, result) - cost(nothing, result))


def machine() -> dict[str, Any]:
    """The processor, the cores at hand, the load, and the versions."""
    python, packages = platform.python_version(), package_versions(PACKAGES)
    where = {"processor": processor(), "cores": available_cores(), "system": platform.platform()}
    return {**where, "python": python, "packages": packages}


def slope(sizes: list[int], seconds: list[float]) -> float:
    """Fitted exponent of growth: of log ``seconds`` on log ``sizes``."""
    return float(np.polyfit(np.log(sizes), np.log(seconds), 1)[0])
