"""The same function for many tasks, in several processes or on a cluster, with a progress bar."""

from collections.abc import Callable, Generator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, ProcessPoolExecutor, as_completed
from contextlib import closing
from functools import partial
from multiprocessing import get_context, parent_process
from pathlib import Path
from types import MappingProxyType

from activeslam_gym.evaluation.cluster import R, T, on_cluster, start_worker


def run_all(
    function: Callable[[T], R],
    tasks: Sequence[T],
    workers: int | str,
    finished: int | None,
    apart: bool = False,
    files: Mapping[str, Path] = MappingProxyType({}),
) -> Generator[tuple[T, R], None, None]:
    """Yield the tasks with their results as they finish, under a progress bar; close the generator to end processes.

    ``workers``: so many processes (one and not ``apart``: this one), or the address of a cluster, which is sent the
    ``files``. ``finished``: of the bar at its start, None is no bar. What fails is raised with the names of its
    episodes, when all others are over.
    """
    from tqdm import tqdm

    if isinstance(workers, str):
        outcomes = on_cluster(partial(outcome, function, elsewhere=True), tasks, workers, files)
    elif tasks and (apart or min(workers, len(tasks)) > 1):
        outcomes = _in_processes(function, tasks, min(workers, len(tasks)))
    else:
        outcomes = ((task, outcome(function, task)) for task in tasks)
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
        raise ValueError(f"{len(failed)} failed: {'; '.join(map(str, failed[:3]))}") if failed[1:] else failed[0]


def outcome(function: Callable[[T], R], task: T, elsewhere: bool = False) -> R | Exception:
    """`function(task)`, or its error; SystemExit is one too, and Ctrl-C in another process: the parent alone has it."""
    try:
        return function(task)
    except Exception as error:
        return error
    except BaseException as error:
        if parent_process() is None and not elsewhere and not isinstance(error, SystemExit):
            raise
        return ChildProcessError(f"{task[0]}: {type(error).__name__} ended it before its episode was over")


def _in_processes(
    function: Callable[[T], R], tasks: Sequence[T], processes: int, again: bool = False
) -> Generator[tuple[T, R | Exception], None, None]:
    """The tasks with their outcomes; those that ran when a process ended are repeated once, each alone."""
    with ProcessPoolExecutor(processes, get_context("spawn"), start_worker) as pool:
        left = {pool.submit(outcome, function, task): task for task in tasks}
        try:
            for future in as_completed(list(left)):
                if not isinstance(future.exception(), BrokenExecutor):
                    yield left.pop(future), future.exception() or future.result()  # type: ignore[misc]
        finally:
            for process in list((pool._processes or {}).values()):  # an unfinished episode is not waited for
                process.kill()
    for task in (rest := list(left.values()))[:processes]:  # they begin in their order
        error = ChildProcessError(f"{task[0]}: its process ended twice before it was over (killed, or out of memory)")
        yield from [(task, error)] if again else _in_processes(function, [task], 1, again=True)
    yield from _in_processes(function, rest[processes:], processes) if rest[processes:] else ()
