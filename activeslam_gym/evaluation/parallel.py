"""The same function for many tasks, in several processes, with a progress bar."""

import os
import signal
from collections.abc import Callable, Generator, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack
from multiprocessing import get_context, parent_process
from threading import Thread
from typing import TypeVar

T = TypeVar("T", bound=Sequence)
R = TypeVar("R")


def run_all(
    function: Callable[[T], R], tasks: Sequence[T], jobs: int, finished: int | None, apart: bool = False
) -> Generator[tuple[T, R], None, None]:
    """Yield the tasks with their results as they finish, under a progress bar.

    They run in at most `jobs` processes or, with one job and not `apart`, in this one. The bar counts the episodes of
    each task, and `finished` were there before; None is no bar. Close the generator (or exhaust it) to end the
    processes; Ctrl-C reaches the parent alone. Raises ChildProcessError, which names its episode, where one ends.
    """
    from tqdm import tqdm

    results: Iterable[tuple[T, R]] = ((task, _result(function, task)) for task in tasks)
    before, processes, futures = finished or 0, min(jobs, len(tasks)), {}
    bar = tqdm(total=before + sum(map(len, tasks)), initial=before, unit="episode", disable=finished is None)
    with bar, ExitStack() as stack:
        if processes > 1 or (tasks and apart):
            pool = ProcessPoolExecutor(processes, mp_context=get_context("spawn"), initializer=_start_worker)
            stack.callback(_end, pool)
            futures = {pool.submit(_result, function, task): task for task in tasks}
            results = ((futures[future], future.result()) for future in as_completed(futures))
        try:
            for task, result in results:
                bar.update(len(task))
                yield task, result
        except BrokenProcessPool as error:
            left = [task[0] for one, task in futures.items() if isinstance(one.exception(), BrokenProcessPool)]
            played = "; ".join(map(str, left[:processes]))  # they begin in their order
            raise ChildProcessError(
                f"a process ended before its episode was over (by itself, killed, or out of memory): {played}"
            ) from error


def _result(function: Callable[[T], R], task: T) -> R:
    """`function(task)`; a SystemExit or the like is an error, but for Ctrl-C, which the parent alone has."""
    try:
        return function(task)
    except BaseException as error:
        if isinstance(error, Exception) or (parent_process() is None and not isinstance(error, SystemExit)):
            raise
        raise ChildProcessError(f"{task[0]}: {type(error).__name__} ended it before its episode was over") from error


def _end(pool: ProcessPoolExecutor) -> None:
    for process in list((pool._processes or {}).values()):  # an unfinished episode is not waited for
        process.kill()  # code in it may ignore a request
    pool.shutdown(cancel_futures=True)


def _start_worker() -> None:
    """Leave Ctrl-C to the parent, end with it however it ends, and use one thread."""
    from threadpoolctl import threadpool_limits

    def end_with_the_parent() -> None:
        if parent := parent_process():
            parent.join()
            os._exit(1)

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    Thread(target=end_with_the_parent, daemon=True).start()
    threadpool_limits(1)
