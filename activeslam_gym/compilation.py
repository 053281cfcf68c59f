"""How the kernels are compiled, and their cache: discard what an edit has made stale.

Every compiled function is optimised again inside each of its compiled callers. So the few that only hand a run down
(``inline="always"`` in `envs.step`, `envs.frame` and `slam.filter`) are written into their caller instead, which saves
a fifth of the first run's compilation.

Numba checks the source of the function that it loads, not of those that it was compiled with; after an edit or a
``git pull``, a kernel in an untouched file would still hold the old code of its callees.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from numba import config, njit
from numba.core import event
from numba.extending import overload

_PACKAGE = Path(__file__).parent
_STAMP = _PACKAGE / "__pycache__" / "kernels.stamp"


def discard_stale_kernels() -> None:
    """Delete the package's cached kernels if any of its sources has changed since they were stamped.

    A package directory that cannot be written has no cache of its own, and nothing is done.
    """
    digest = hashlib.sha256()
    for source in sorted(_PACKAGE.rglob("*.py")):
        status = source.stat()
        digest.update(f"{source.relative_to(_PACKAGE)} {status.st_mtime_ns} {status.st_size}\n".encode())
    stamp = digest.hexdigest()
    with contextlib.suppress(OSError):
        if _STAMP.is_file() and _STAMP.read_text() == stamp:
            return
        _STAMP.parent.mkdir(exist_ok=True)
        for pattern in ("*.nbi", "*.nbc"):
            for kernel in _PACKAGE.rglob(pattern):
                kernel.unlink(missing_ok=True)
        partial = _STAMP.with_suffix(".partial")
        partial.write_text(stamp)
        partial.replace(_STAMP)


class _Announcement(event.Listener):
    """Says once, on the error stream, that kernels are being compiled; what the cache holds is not compiled."""

    def on_start(self, event: event.Event) -> None:
        """The first compilation of one of our own kernels begins."""
        dispatcher = event.data.get("dispatcher") if isinstance(event.data, dict) else None
        module = getattr(getattr(dispatcher, "py_func", None), "__module__", None) or ""
        if module.split(".")[0] == _PACKAGE.name and self._silent:
            self._silent = False
            print(
                "activeslam_gym: compiling its kernels, which is kept for the next time ...",
                file=sys.stderr,
                flush=True,
            )

    def on_end(self, event: event.Event) -> None:
        """Nothing to say."""

    _silent = True


def announce_compilation() -> None:
    """Tell the user, once a process, why the first step takes long."""
    event.register("numba:compile", _Announcement())


def compiled(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """Decorator of a function that kernels call. ``options`` are those of `numba.njit`.

    Kernels compile it into themselves, without the wrapper by which Python would call it: to unpack the many arrays of
    a named tuple is more code than most of these functions. From Python it is a kernel of its own, compiled when it is
    first called.
    """
    if function is None:
        return functools.partial(compiled, **options)
    if config.DISABLE_JIT:
        return function
    from_python = njit(cache=True, **options)(function)

    @functools.wraps(function)
    def call(*arguments: Any, **named: Any) -> Any:
        return from_python(*arguments, **named)

    overload(call, jit_options={**options, "no_cfunc_wrapper": True}, strict=False)(lambda *arguments: function)
    return call
