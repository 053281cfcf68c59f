"""The same function for many tasks, in several processes, with a progress bar."""

import os
import signal
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from multiprocessing import get_context, parent_process
from threading import Thread
from typing import TypeVar

T = TypeVar("T")
R = TypeVar("R")


def run_all(
    function: Callable[[T], R], tasks: Sequence[T], jobs: int, finished: int, size: Callable[[T], int]
) -> Generator[tuple[T, R], None, None]:
    """Yield the tasks with their results as they finish, under a progress bar.

    The bar counts episodes: `size` of a task are in it, and `finished` were there before. Close the generator (or
    exhaust it) to end the processes; Ctrl-C reaches the parent alone.
    """
    from tqdm import tqdm

    total = finished + sum(map(size, tasks))
    with tqdm(total=total, initial=finished, unit="episode") as bar, closing(_run(function, tasks, jobs)) as results:
        for task, result in results:
            bar.update(size(task))
            yield task, result


def _run(function: Callable[[T], R], tasks: Sequence[T], jobs: int) -> Generator[tuple[T, R], None, None]:
    """The same without the bar: from at most `jobs` processes or, with one job, from this one."""
    jobs = min(jobs, len(tasks))
    if jobs <= 1:
        yield from ((task, function(task)) for task in tasks)
        return
    executor = ProcessPoolExecutor(jobs, mp_context=get_context("spawn"), initializer=_start_worker)
    try:
        futures = {executor.submit(function, task): task for task in tasks}
        for future in as_completed(futures):
            yield futures[future], future.result()
    except BrokenProcessPool as error:
        raise ChildProcessError("a process ended before its episode was over: killed, or out of memory") from error
    finally:
        executor.shutdown(cancel_futures=True)


def _start_worker() -> None:
    """Leave Ctrl-C to the parent, end with it however it ends, and use one thread."""
    from threadpoolctl import threadpool_limits

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    Thread(target=_end_with_the_parent, daemon=True).start()
    threadpool_limits(1)


def _end_with_the_parent() -> None:
    if parent := parent_process():
        parent.join()
        os._exit(1)
