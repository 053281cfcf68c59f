"""Results are kept under all that could change them; what is missing is made, by processes or a cluster."""

import hashlib
import json
import re
from collections.abc import Callable, Collection, Generator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, ProcessPoolExecutor, as_completed
from contextlib import closing
from functools import partial
from io import BytesIO
from itertools import groupby
from multiprocessing import get_context, parent_process
from pathlib import Path
from types import MappingProxyType
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from activeslam_gym.evaluation.cluster import R, T, on_cluster, start_worker
from activeslam_gym.evaluation.code import LIBRARIES, foreign_parts, package_sources, package_versions
from activeslam_gym.files import written_whole

Arrays = dict[str, NDArray[Any]]
Key = dict[str, Any]
"""JSON-plain: what a result depends on, beside this package, the libraries and the user's own parts that it names."""


class Job(Protocol):
    """A result to be made."""

    @property
    def key(self) -> Key:
        """What it depends on."""

    @property
    def label(self) -> str:
        """Begins the name of its file."""

    @property
    def group(self) -> Any:
        """Jobs of equal groups may be played together."""


J = TypeVar("J", bound=Job)


class Store:
    """A folder of results, each a file of arrays whose name ends in the digest of its key.

    A key is completed with the sources of `activeslam_gym` and the versions of `code.LIBRARIES`. The type of the
    processor is no part of it. Without a ``folder`` nothing is kept, nor is a result of a user's own criterion, reward,
    estimator, sensor or scene, whose files and libraries are not known. What is missing is made by
    ``workers``: so many processes, or a cluster at an address (see `run_all`).
    """

    def __init__(self, folder: Path | None = None, workers: int | str = 1) -> None:
        self.folder, self.workers = folder, workers

    def load(self, label: str, key: Key) -> Arrays | None:
        """The result of ``key``, or None where it is not there, or its file is damaged, which is printed."""
        path = self._path(label, key)
        if path is None or not path.exists():
            return None
        try:
            with np.load(path, allow_pickle=False) as file:
                return {name: file[name] for name in set(file.files) - {"key"}}
        except Exception as error:  # readers of archives and arrays raise a dozen kinds
            print(f"Played again: {str(path)!r} cannot be read: {type(error).__name__}: {error}")
            return None

    def save(self, label: str, key: Key, arrays: Arrays) -> None:
        """Keep a result, whole or not at all."""
        self._write(label, key, _packed(key, arrays))

    def _write(self, label: str, key: Key, packed: bytes) -> None:
        if path := self._path(label, key):
            with written_whole(path) as unfinished:
                unfinished.write_bytes(packed)

    def of(self, label: str, key: Key, make: Callable[[], Arrays]) -> Arrays:
        """The result of ``key``, kept or made now."""
        if (found := self.load(label, key)) is None:
            self.save(label, key, found := make())
        return found

    def gather(
        self,
        jobs: Sequence[J],
        play: Callable[[tuple[J, ...]], list[Arrays]],
        batch: int = 1,
        anew: Collection[J] = (),
        apart: bool = False,
        files: Mapping[str, Path] = MappingProxyType({}),
    ) -> Generator[tuple[J, Arrays], None, None]:
        """Yield every job with its result: the kept ones first, whose number is printed, then others as they finish.

        ``play`` makes the results of up to ``batch`` jobs of one group, by the `workers`; a single one is this process,
        unless ``apart``; a cluster is sent the ``files``. Kept results of the jobs ``anew`` are replaced. Close the
        generator (or exhaust it) to end them. Raises as `run_all`, after all others, where some jobs fail.
        """
        missing = []
        for job in jobs:
            arrays = None if job in anew else self.load(job.label, job.key)
            if arrays is None:
                missing.append(job)
            else:
                yield job, arrays
        if kept := len(jobs) - len(missing):
            print(f"{kept} of {len(jobs)} episodes are kept from an earlier command.", flush=True)
        if not missing:
            return
        groups = [list(group) for _, group in groupby(missing, lambda job: job.group)]
        parts = [tuple(group[i : i + batch]) for group in groups for i in range(0, len(group), batch)]
        with closing(run_all(partial(_made, play), parts, self.workers, kept, apart, files)) as finished:
            for part, results in finished:
                for job, (arrays, packed) in zip(part, results, strict=True):
                    self._write(job.label, job.key, packed)
                    yield job, arrays

    def _path(self, label: str, key: Key) -> Path | None:
        if self.folder is None or foreign_parts(json.dumps(key)):
            return None
        digest = hashlib.sha256(_completed(key).encode()).hexdigest()[:20]
        return self.folder / f"{re.sub(r'[^A-Za-z0-9_.-]', '_', label)}-{digest}.npz"


def _made(play: Callable[[Any], list[Arrays]], jobs: Sequence[Job]) -> list[tuple[Arrays, bytes]]:
    """The results of ``jobs``, each with its file, which is packed where it was played: that takes milliseconds."""
    return [(arrays, _packed(job.key, arrays)) for job, arrays in zip(jobs, play(jobs), strict=True)]


def _packed(key: Key, arrays: Arrays) -> bytes:
    """The content of a file."""
    file = BytesIO()
    np.savez_compressed(file, **{**arrays, "key": np.array(_completed(key))})  # type: ignore[arg-type]
    return file.getvalue()


NOT_KEPT = Store()  # where nothing is to be kept


def _completed(key: Key) -> str:
    """The whole key as JSON."""
    depends_on = {"activeslam_gym": package_sources("activeslam_gym"), "versions": package_versions(LIBRARIES)}
    return json.dumps({**key, **depends_on}, sort_keys=True)


# Where functions run --------------------------------------------------------------------------------------------------


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
        attempts = on_cluster(partial(attempt, function, elsewhere=True), tasks, workers, files)
    elif tasks and (apart or min(workers, len(tasks)) > 1):
        attempts = _in_processes(function, tasks, min(workers, len(tasks)))
    else:
        attempts = ((task, attempt(function, task)) for task in tasks)
    before, failed = finished or 0, []
    bar = tqdm(total=before + sum(map(len, tasks)), initial=before, unit="episode", disable=finished is None)
    with bar, closing(attempts):
        for task, result in attempts:
            bar.update(len(task))
            if isinstance(result, Exception):
                failed.append(result)
            else:
                yield task, result
    messages = list(dict.fromkeys(map(str, failed)))
    if failed:
        raise ValueError(f"{len(failed)} failed: {'; '.join(messages[:3])}") if messages[1:] else failed[0]


def attempt(function: Callable[[T], R], task: T, elsewhere: bool = False) -> R | Exception:
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
    """The tasks with their attempts; those that ran when a process ended are repeated once, each alone."""
    with ProcessPoolExecutor(processes, get_context("spawn"), start_worker) as pool:
        left = {pool.submit(attempt, function, task): task for task in tasks}
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
