"""Tasks on a cluster of Ray, in small chunks, on machines with the same installation.

The calling process alone makes the chunks and takes their results, so that each task counts once. Ray starts processes,
moves functions, files and results, and repeats what is lost with a process or machine.
"""

import os
import pickle
import shutil
import signal
import sys
from collections import deque
from collections.abc import Callable, Generator, Hashable, Mapping, Sequence
from multiprocessing import parent_process
from pathlib import Path
from socket import create_connection
from tempfile import TemporaryDirectory
from threading import Thread
from time import perf_counter
from typing import Any, TypeVar

from activeslam_gym.evaluation.code import installation, processor
from activeslam_gym.files import argument

T = TypeVar("T", bound=Sequence)
R = TypeVar("R")
CHUNK = 8  # most tasks of a chunk: Ray needs 4 ms for one
CHUNKS = 8  # chunks for each core, if there are as many tasks
AHEAD = 2  # chunks for each core that are on their way
PATIENCE = 5.0  # for what is there already, and between questions to the head [s]
NODE_ID = "ray.io/node-id"
FOUND: dict[Hashable, Any] = {}
"""What takes a process long to find, and others are given."""
_connection: dict[str, Any] = {}  # what the one connection of this process was asked for


def on_cluster(
    function: Callable[[T], R | Exception], tasks: Sequence[T], address: str, files: Mapping[str, Path]
) -> Generator[tuple[T, R | Exception], None, None]:
    """Yield the tasks with their results or errors, as they finish, on the cluster of Ray at an ``address``.

    The ``function`` raises nothing. ``files`` and folders are sent with it: path in the working folder there → path
    here. Where a process or a machine is lost, its chunk is repeated once, and then each of its tasks alone. A machine
    whose `installation` is another one is named, and plays nothing.

    Raises:
        ImportError: Ray is not installed.
        ConnectionError: there is no cluster at this address, or its head is lost.
        ValueError: every machine has another installation.
    """
    ray = _connected(address, files)
    head = address if "://" in address else ray.get_runtime_context().gcs_address
    given = ray.put(ray.cloudpickle.dumps((function, FOUND))), ray.put(installation())
    on_node = ray.remote(num_cpus=1, max_retries=1)(_on_node())
    refused, kinds, pending = dict[str, str](), {processor()}, dict[Any, Sequence[T]]()
    try:
        cores, asked = _cores(ray, head), perf_counter()
        size = min(max(1, len(tasks) // (CHUNKS * cores)), CHUNK)
        waiting = deque(tasks[i : i + size] for i in range(0, len(tasks), size))
        while waiting or pending:
            if perf_counter() > asked + PATIENCE:
                cores, asked = _cores(ray, head), perf_counter()
            there = on_node.options(label_selector={NODE_ID: f"!in({','.join(refused)})"} if refused else {})
            while waiting and len(pending) < AHEAD * cores:
                chunk = waiting.popleft()
                pending[there.remote(*given, ray.cloudpickle.dumps(chunk))] = chunk
            ray.wait(list(pending), num_returns=1, timeout=PATIENCE)
            for ref in ray.wait(list(pending), num_returns=len(pending), timeout=0)[0]:
                chunk = pending.pop(ref)
                try:
                    node, name, kind, differs, played = ray.get(ref, timeout=6.0 * PATIENCE)
                except ray.exceptions.RayTaskError as error:
                    yield from ((task, ChildProcessError(f"{task[0]}: {error.cause}")) for task in chunk)
                    continue
                except ray.exceptions.RayError as error:
                    why = f"its process or machine was lost twice ({type(error).__name__})"
                    if len(chunk) == 1:
                        yield chunk[0], ChildProcessError(f"{chunk[0][0]}: {why}")
                    else:
                        waiting.extend(chunk[i : i + 1] for i in range(len(chunk)))
                    continue
                if differs:
                    _refuse(ray, refused, node, f"{name} plays nothing, its installation differs: {differs}")
                    waiting.append(chunk)
                    continue
                if kind not in kinds:
                    warning = f"{name} has another processor, {kind}: its scores may differ in their last digits."
                    print(warning, file=sys.stderr, flush=True)
                    kinds.add(kind)
                yield from zip(chunk, pickle.loads(played), strict=True)
    except ConnectionError as error:
        raise ConnectionError(f"--cluster: the head is lost, and what is over is kept ({error})") from error
    finally:
        if pending:
            _connection.clear()
            ray.shutdown()  # unfinished episodes are not waited for


def _cores(ray: Any, head: str) -> int:
    """Cores of the cluster. ConnectionError where its head is silent: Ray would wait a minute, and end this process."""
    if why := _silent(head):
        raise ConnectionError(why)
    return max(1, int(ray.cluster_resources().get("CPU", 1)))


def _on_node() -> Callable[..., Any]:
    """What a process there runs; it is sent by value, for a machine may have another version of this module."""

    def play(work: bytes, expected: dict[str, str], chunk: bytes) -> tuple:
        import platform

        import ray

        node, name, kind = ray.get_runtime_context().get_node_id(), platform.node(), ""
        try:
            from activeslam_gym.evaluation import cluster, code

            here, kind = code.installation(), code.processor()
        except (ImportError, AttributeError, AssertionError) as error:
            here = {"activeslam-gym": f"{type(error).__name__}: {error}"}
        differs = ", ".join(f"{one} {here.get(one)} → {of}" for one, of in expected.items() if here.get(one) != of)
        return node, name, kind, differs, None if differs else cluster.play(work, chunk)

    return play


def start_worker() -> None:
    """Leave Ctrl-C to the parent, end with it however it ends, and use one thread."""
    from threadpoolctl import threadpool_limits

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if parent := parent_process():
        Thread(target=lambda: (parent.join(), os._exit(1)), daemon=True).start()  # type: ignore[func-returns-value]
    threadpool_limits(1)


def play(work: bytes, chunk: bytes) -> bytes:
    """The outcomes of a chunk, in a process of a cluster."""
    start_worker()
    function, found = pickle.loads(work)
    FOUND.update(found)
    return pickle.dumps([function(task) for task in pickle.loads(chunk)])


def _refuse(ray: Any, refused: dict[str, str], node: str, why: str) -> None:
    """Name a machine; ValueError where every one is refused."""
    if node not in refused:
        print(why, file=sys.stderr, flush=True)
    refused[node] = why
    there = {one["NodeID"] for one in ray.nodes() if one["Alive"] and one["Resources"].get("CPU")}
    if there <= refused.keys():
        raise ValueError(f"--cluster: no machine can play: {'; '.join(refused.values())}")


def _connected(address: str, files: Mapping[str, Path]) -> Any:
    """Ray, with a connection to the cluster at ``address`` whose processes find the ``files``."""
    try:
        import ray
    except ImportError as error:
        raise ImportError("--cluster needs Ray: pip install --editable '.[cluster]'") from error
    wanted = {"address": address, **files}
    if _connection != wanted or not ray.is_initialized():
        ray.shutdown()
        with TemporaryDirectory() as folder, argument("cluster"):
            for name, path in files.items():
                target = Path(folder, name)
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copytree(path, target) if path.is_dir() else shutil.copyfile(path, target)
            if ":" in address and (why := _silent(address)):  # Ray would try again for minutes
                raise ConnectionError(f"{why}; allowed: the address of a cluster of Ray")
            environment = {"working_dir": folder} if files else {}
            try:
                ray.init(address, runtime_env=environment, log_to_driver=False, logging_level="ERROR")
            except ConnectionError as error:
                raise ConnectionError(f"{error}; where the cluster asks for a token: RAY_AUTH_MODE=token") from None
        _connection.clear()
        _connection.update(wanted)
    return ray


def _silent(address: str) -> str:
    """Why nothing answers there; empty where something does."""
    host, _, port = address.rpartition("/")[2].rpartition(":")
    try:
        create_connection((host.strip("[]"), int(port)), 10.0).close()
    except (OSError, ValueError, OverflowError) as error:
        return f"{address!r}: {error}"
    return ""
