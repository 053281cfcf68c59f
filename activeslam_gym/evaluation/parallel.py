"""The same function for many tasks, in several processes or on a cluster, with a progress bar."""

import os
import signal
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from multiprocessing import get_context, parent_process
from threading import Thread

from activeslam_gym.evaluation.cluster import R, T, outcome


def run_all(
    function: Callable[[T], R], tasks: Sequence[T], workers: int | Callable, finished: int | None, apart: bool = False
) -> Generator[tuple[T, R], None, None]:
    """Yield the tasks with their results as they finish, under a progress bar.

    ``workers``: at most so many processes, for one and not ``apart`` this one; or `on_cluster` with an address. The bar
    counts the episodes of each task, and ``finished`` were there before; None is no bar. Close the generator (or
    exhaust it) to end the processes; Ctrl-C reaches the parent alone. What fails is raised when all others are over:
    ValueError or, where a process ends, ChildProcessError, with the names of its episodes.
    """
    from tqdm import tqdm

    outcomes = ((task, outcome(function, task)) for task in tasks)
    if callable(workers):
        outcomes = workers(function, tasks)
    elif tasks and (apart or min(workers, len(tasks)) > 1):
        outcomes = _in_processes(function, tasks, min(workers, len(tasks)))
    before, failed = finished or 0, []
    bar = tqdm(total=before + sum(map(len, tasks)), initial=before, unit="episode", disable=finished is None)
    with bar, closing(outcomes):
        for task, result in outcomes:
            bar.update(len(task))
            if isinstance(result, Exception):
                failed.append(result)
            else:
                yield task, result
    if failed:
        message = f"{len(failed)} of {len(tasks)} failed, such as {'; '.join(map(str, failed[:3]))}"
        raise ValueError(message) if failed[1:] else failed[0]


def _in_processes(
    function: Callable[[T], R], tasks: Sequence[T], processes: int, again: bool = False
) -> Generator[tuple[T, R | Exception], None, None]:
    """The tasks with their outcomes; those that ran when a process ended are repeated once, each alone."""
    pool = ProcessPoolExecutor(processes, mp_context=get_context("spawn"), initializer=_start_worker)
    left = {pool.submit(outcome, function, task): task for task in tasks}
    try:
        for future in as_completed(list(left)):
            if not isinstance(error := future.exception(), BrokenProcessPool):
                yield left.pop(future), error or future.result()  # type: ignore[misc]
    finally:
        for process in list((pool._processes or {}).values()):  # an unfinished episode is not waited for
            process.kill()  # code in it may ignore a request
        pool.shutdown(cancel_futures=True)
    for task in (rest := list(left.values()))[:processes]:  # they begin in their order
        why = f"{task[0]}: its process ended before it was over, twice (by itself, killed, or out of memory)"
        yield from [(task, ChildProcessError(why))] if again else _in_processes(function, [task], 1, again=True)
    if rest[processes:]:
        yield from _in_processes(function, rest[processes:], processes)


def _start_worker() -> None:
    """Leave Ctrl-C to the parent, end with it however it ends, and use one thread."""
    from threadpoolctl import threadpool_limits

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    Thread(target=lambda: (parent_process().join(), os._exit(1)), daemon=True).start()  # type: ignore[union-attr]
    threadpool_limits(1)
