"""How the kernels are compiled, and their cache: where it is, and what an edit has made stale in it.

Kernels are compiled when they are first called. `kernel` marks those that Python calls while it runs, `part` what they
are made of. Numba checks the source of the kernel that it loads, not of its parts; after an edit or a ``git pull``, a
kernel in an untouched file would still hold their old code.

Numba compiles one function at a time, whatever the threads, so at the first run a second process compiles other kernels
into the same cache.
"""

from __future__ import annotations

import contextlib
import functools
import gc
import hashlib
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from numba import config as _numba_config
from numba import njit
from numba.core import event
from numba.extending import overload

_PACKAGE = Path(__file__).parent
_STAMP = "kernels.stamp"
_CONFIG: Any = _numba_config


def kernel(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """Decorator of a function that Python calls: `numba.njit`, kept in the cache where there is one."""
    if function is None:
        return functools.partial(kernel, **options)
    if _CONFIG.DISABLE_JIT:
        return function
    try:
        dispatcher = njit(cache=True, **options)(function)
    except RuntimeError:  # Numba finds no directory that it can write
        _Cache.missing = True
        return njit(**options)(function)
    _Cache.directories.add(Path(dispatcher.stats.cache_path))
    return dispatcher


def part(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """Decorator of a function that kernels call. ``options`` are those of `numba.njit`.

    A kernel compiles it into itself, without the wrapper by which Python would call it: unpacking the many arrays of a
    named tuple is more code than most parts. Called from Python it is a kernel of its own.

    Every part is optimised again inside each of its callers. So the few that only hand a run down are written into
    their caller instead (``inline="always"``).
    """
    if function is None:
        return functools.partial(part, **options)
    alone = kernel(function, **options)
    if _CONFIG.DISABLE_JIT or "inline" in options:
        return alone

    @functools.wraps(function)
    def call(*arguments: Any, **named: Any) -> Any:
        return alone(*arguments, **named)

    jit_options: Any = {**options, "no_cfunc_wrapper": True}
    overload(call, jit_options=jit_options, strict=False)(lambda *arguments: function)
    return call


class _Cache:
    """What is known of the cache in this process."""

    directories: set[Path] = set()
    """Where Numba keeps our kernels: beside the sources, in ``NUMBA_CACHE_DIR``, or in the user's own cache."""
    missing = False
    """Whether none of these can be written."""


def discard_stale_kernels() -> None:
    """Delete the package's cached kernels if any of its sources has changed since they were stamped."""
    digest = hashlib.sha256()
    for source in sorted(_PACKAGE.rglob("*.py")):
        status = source.stat()
        digest.update(f"{source.relative_to(_PACKAGE)} {status.st_mtime_ns} {status.st_size}\n".encode())
    stamp = digest.hexdigest()
    for directory in _Cache.directories:
        with contextlib.suppress(OSError):
            _discard_unless(stamp, directory)


def _discard_unless(stamp: str, directory: Path) -> None:
    """Empty a directory of kernels that does not bear the ``stamp``, and stamp it."""
    at = directory / _STAMP
    if at.is_file() and at.read_text() == stamp:
        return
    for pattern in ("*.nbi", "*.nbc"):
        for stale in directory.glob(pattern):
            stale.unlink(missing_ok=True)
    partial = at.with_suffix(".partial")
    partial.write_text(stamp)
    partial.replace(at)


class _Announcement(event.Listener):
    """Says once, on the error stream, that kernels are being compiled; what the cache holds is not compiled."""

    def on_start(self, event: event.Event) -> None:
        """The first compilation of one of our own kernels begins."""
        dispatcher = event.data.get("dispatcher") if isinstance(event.data, dict) else None
        module = getattr(getattr(dispatcher, "py_func", None), "__module__", None) or ""
        if module.split(".")[0] == _PACKAGE.name and self._silent:
            self._silent = False
            then = (
                "and again at every start, since no cache can be written: set NUMBA_CACHE_DIR to a directory that can"
                if _Cache.missing
                else "which is kept for the next time"
            )
            print(
                f"{_PACKAGE.name}: compiling its kernels (about half a minute on two cores), {then} ...",
                file=sys.stderr,
                flush=True,
            )

    def on_end(self, event: event.Event) -> None:
        """Nothing to say."""

    _silent = True


def announce_compilation() -> None:
    """Tell the user, once a process, why the first step takes long."""
    event.register("numba:compile", _Announcement())


class _CollectorPaused(event.Listener):
    """Stops the collector of cyclic garbage while kernels are compiled: an eighth of the time, and nothing to find.

    What it then does not find are 200 MB, until it goes on.
    """

    def __init__(self) -> None:
        self._depth, self._paused = 0, False
        if hasattr(os, "register_at_fork"):  # in the child, whoever was compiling is gone
            os.register_at_fork(after_in_child=self._go_on)

    def on_start(self, event: event.Event) -> None:
        """Something begins to be compiled, perhaps a part of what is being compiled."""
        if self._depth == 0 and gc.isenabled():
            gc.disable()
            self._paused = True
        self._depth += 1

    def on_end(self, event: event.Event) -> None:
        """It ends, well or with an error."""
        self._depth -= 1
        if self._depth <= 0:
            self._go_on()

    def _go_on(self) -> None:
        if self._paused:
            gc.enable()
        self._depth, self._paused = 0, False


def hasten_compilation() -> None:
    """Pause the collector of cyclic garbage in every compilation by Numba from now on; once a process."""
    event.register("numba:compile", _CollectorPaused())


# The second process -------------------------------------------------------------------------------------------------


def available_cores() -> int:
    """How many cores this process may use."""
    affinity = getattr(os, "sched_getaffinity", None)  # not on every system
    return len(affinity(0)) if affinity else os.cpu_count() or 1


class SecondProcess(event.Listener):
    """Runs the function ``main`` of ``module`` while this process compiles ``kernel``, if it does (see the cache).

    It compiles other kernels into the cache; `wait` before those are called. Nothing depends on it: where the process
    cannot be started, fails or hangs, the other kernels are simply compiled here, later.
    """

    _GRACE = 10.0
    """[s]."""

    def __init__(self, kernel: Any, module: str) -> None:
        self._kernel, self._module = kernel, module
        self._process: subprocess.Popen[bytes] | None = None
        self._started = 0.0
        if not _CONFIG.DISABLE_JIT:
            event.register("numba:compile", self)

    def on_start(self, event: event.Event) -> None:
        """Something begins to be compiled."""
        dispatcher = event.data.get("dispatcher") if isinstance(event.data, dict) else None
        if dispatcher is self._kernel and self._process is None and self._helps():
            with contextlib.suppress(OSError):
                self._process, self._started = self._start(), time.monotonic()

    def on_end(self, event: event.Event) -> None:
        """Nothing to do."""

    def _helps(self) -> bool:
        """Whether there is a core for it, a cache to share, and a Python to run (not a program that embeds one)."""
        is_python = Path(sys.executable or "").name.lower().startswith("python")
        return is_python and not _Cache.missing and available_cores() > 1

    def _start(self) -> subprocess.Popen[bytes]:
        """The process, which imports from where this one does, and from nowhere else."""
        paths = [os.path.abspath(path) for path in sys.path if isinstance(path, str)]  # "" is here
        code = f"import sys; sys.path[:] = {paths!r}; from {self._module} import main; main()"
        cache = {"NUMBA_CACHE_DIR": _CONFIG.CACHE_DIR} if _CONFIG.CACHE_DIR else {}
        nowhere = subprocess.DEVNULL
        return subprocess.Popen(
            [sys.executable, "-c", code], env={**os.environ, **cache}, stdin=nowhere, stdout=nowhere, stderr=nowhere
        )

    def wait(self) -> None:
        """Until it is done, if it runs at all; but not much longer than twice the time that it has had."""
        process = self._process
        if process is None:
            return
        try:
            process.wait(self._GRACE + 2.0 * (time.monotonic() - self._started))
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        self._process = None
