"""Threads that share the rows of a batch.

The kernels release the GIL, so ordinary threads run slices of the rows side by side, each the very kernel that a single
environment runs. Numba's ``parallel=True`` is not used: it would compile everything twice, its threading layer belongs
to the whole process, and of the layers at hand one dies in a forked child and the other when two Python threads call it
at once. Here each environment has its own threads, started at the first use and again in a forked child.
"""

import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from typing import Any

from activeslam_gym.config import whole_number


def available_cores() -> int:
    """How many cores this process may use."""
    affinity = getattr(os, "sched_getaffinity", None)  # not on every system
    return len(affinity(0)) if affinity else os.cpu_count() or 1


_SLICES = 4
"""For each thread: who is done early, since the maps of its rows are small or its core is its own, takes another."""
_FEWEST = 8
"""Rows of a slice at least, but where there are hardly more rows than threads: each slice is a call of its own."""


class OneThread:
    """A context that one thread at a time may enter, as often as it likes.

    Raises:
        RuntimeError: another thread is inside.
    """

    def __init__(self) -> None:
        self._lock, self._process = threading.RLock(), os.getpid()

    def __enter__(self) -> None:
        if self._lock.acquire(blocking=False):
            return
        if self._process == os.getpid():
            raise RuntimeError("an environment is used by two threads at once; make one for each thread")
        self.__init__()  # type: ignore[misc]  # in a forked child the thread that was inside is gone
        self._lock.acquire()

    def __exit__(self, *_: object) -> None:
        self._lock.release()

    def __reduce__(self) -> Any:
        """Copies and pickles are free."""
        return OneThread, ()


class Workers:
    """Calls kernels on contiguous slices of ``rows`` rows, which threads take one after another, the caller's too.

    ``threads``: at most as many as rows; None: as many as cores that the process may use. ``alone``: entered by calls.

    Raises:
        ValueError: ``threads`` is no positive whole number.
    """

    def __init__(self, rows: int, threads: int | None = None, alone: OneThread | None = None) -> None:
        wanted = available_cores() if threads is None else whole_number("num_threads", threads)
        self.threads = min(wanted, rows)
        """In use, the caller's included."""
        count = max(self.threads, min(_SLICES * self.threads, rows // _FEWEST)) if self.threads > 1 else 1
        ends = [rows * i // count for i in range(count + 1)]
        self._slices = list(zip(ends[:-1], ends[1:], strict=True))
        self._pool: ThreadPoolExecutor | None = None
        self._process = os.getpid()
        self.alone = alone or OneThread()

    def call(self, kernel: Callable[..., Any], *arguments: Any) -> None:
        """Call ``kernel(*arguments, start, stop)`` for every slice of rows, and wait for all.

        Raises:
            RuntimeError: another thread is in a call.
        """
        if self._process != os.getpid():  # a forked child has neither the parent's threads nor their locks
            self._pool, self._process = None, os.getpid()
        left = iter(self._slices)  # shared: each slice is given out once

        def work() -> None:
            for part in left:
                kernel(*arguments, *part)

        with self.alone:
            if self.threads > 1 and self._pool is None:
                self._pool = ThreadPoolExecutor(self.threads - 1, thread_name_prefix="activeslam")
            futures = [self._pool.submit(work) for _ in range(self.threads - 1)] if self._pool else []
            try:
                work()
            finally:
                wait(futures)
            for future in futures:
                future.result()

    def close(self) -> None:
        """End the threads; a later call starts new ones."""
        if self._pool is not None and self._process == os.getpid():
            self._pool.shutdown()
        self._pool = None

    def __getstate__(self) -> dict[str, Any]:
        """Copies and pickles start their own threads."""
        return {**self.__dict__, "_pool": None}
