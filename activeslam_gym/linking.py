"""What the kernels need of Numba's inside: how their parts are compiled and linked, and where kernels are kept.

| mechanism | a processor's time for the first step | without it |
|---|---|---|
| `_Part`: functions that only kernels call are optimised within them alone | 53 s | 116 s |
| `_plain`: a literal's value, or a record's array, makes no function of its own | 44 s | 52 s |
| `_Cache`: kernels are kept by the content of all their modules; Numba's looks at the kernel's own | 1.3 s | 53 s |
| `borrowing`, `borrowed`: references to the arrays of a run are not counted | 45 µs a frame | 50 µs |
"""

import contextlib
import functools
import hashlib
import pickle
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numba import njit, types
from numba.core.caching import FunctionCache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.serialize import dumps
from numba.core.typing.templates import infer_global, make_intrinsic_template
from numba.extending import lower_cast

from .files import written_whole

_PACKAGE = Path(__file__).parent
_UPPER_FLOOR = _PACKAGE / "vision"  # its kernels call those of the modules below it, and never the other way round
_SIGNS = b"@compiled", b"@borrowing", b"@inlined", b" = record(", b" = constants(", b"one_of("
"""Texts in the source of a module from which kernels are made."""


class _Part(JITCodeLibrary):
    """The code of a function that only kernels call: linked into them, and optimised there alone."""

    codegen = property(lambda self: self)  # gets the constants of a function's errors; a kernel raises none

    def set_env(self, name: str, environment: Any) -> None: ...
    def _optimize_final_module(self) -> None: ...
    def _finalize_final_module(self) -> None:
        self._finalized = True


class _PartCompiler(Compiler):
    """Numba's compiler, with a `_Part` as its result."""

    def define_pipelines(self) -> list[Any]:
        self.state.library = _Part(self.state.targetctx.codegen(), self.state.func_id.func_qualname)
        self.state.library.enable_object_caching()
        return super().define_pipelines()


def _plain(kind: Any) -> Any:
    """The type of an argument, without a literal's value or the shape of an array in a record."""
    return types.Array(kind.dtype, kind.ndim, "C") if isinstance(kind, types.NestedArray) else types.unliteral(kind)


lower_cast(types.NestedArray, types.Array)(lambda *arguments: arguments[-1])  # it is that array already


def link(call: Any, function: Callable[..., Any], **options: Any) -> None:
    """In kernels, ``call`` is ``function``, compiled as a part of them."""
    alone: Any = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True, "pipeline_class": _PartCompiler}
    call.part = njit(**{"error_model": "numpy", "_nrt": True, **options, **alone})(function)
    found = call.part.get_call_template
    call.part.get_call_template = lambda arguments, named: found(tuple(map(_plain, arguments)), named)
    infer_global(call, types.Dispatcher(call.part))


def link_borrowed(call: Any) -> None:
    """In kernels, ``call`` gives the numbers of an array without the owner whose references Numba counts.

    The kernel's caller holds the array for as long as the kernel runs.
    """
    infer_global(call, types.Function(make_intrinsic_template(call, _borrowed, call.__name__)))


def _borrowed(_: Any, array: Any) -> Any:
    """The type, and how it is compiled."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        view = context.make_array(signature.return_type)(context, builder, value=arguments[0])
        view.meminfo = view.meminfo.type(None)
        return view._getvalue()

    return array(array), generate


@functools.cache
def _content(upper_floor: bool) -> str:
    """A number for the content of all modules that kernels are made of, and the versions of Numba and NumPy."""
    digest = hashlib.sha256(f"numba {numba.__version__}, numpy {np.__version__}".encode())
    for source in sorted(_PACKAGE.rglob("*.py")):
        content = source.read_bytes()
        if any(sign in content for sign in _SIGNS) and (upper_floor or not source.is_relative_to(_UPPER_FLOOR)):
            digest.update(source.relative_to(_PACKAGE).as_posix().encode() + b"\0" + content)
    return digest.hexdigest()[:16]


class _Cache(FunctionCache):
    """Numba's own cache in a folder named after the `_content`; each kernel has a file named after its types."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        source = Path(function.__code__.co_filename)
        content = _content(source.is_relative_to(_UPPER_FLOOR))
        self._stamp = content if source.is_relative_to(_PACKAGE) else (content, self._impl.locator.get_source_stamp())
        self._folder = Path(self._cache_path, f"kernels-{content}")

    def _file(self, key: Any) -> Path:
        digest = hashlib.sha256(repr(key).encode()).hexdigest()[:16]
        return self._folder / f"{self._impl.filename_base}.{digest}.nbc"

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        target_context.refresh()
        key = self._index_key(sig, target_context.codegen())
        with contextlib.suppress(Exception):  # absent or damaged, or of a module that is no longer installed
            identity, kernel = pickle.loads(self._file(key).read_bytes())
            if identity == (self._stamp, key):
                return self._impl.rebuild(target_context, kernel)
        _say_once("compiling kernels (a minute or two), which are kept for the next time ...")
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        if not self._impl.check_cachable(data):
            return
        key = self._index_key(sig, data.codegen)
        try:
            with written_whole(self._file(key)) as unfinished:
                unfinished.write_bytes(dumps(((self._stamp, key), self._impl.reduce(data))))
        except OSError as error:
            _say_once(f"kernels cannot be kept in {self._folder}, and are compiled at every start: {error}")


def keep(kernel: Any, function: Callable[..., Any]) -> None:
    """Keep on disk what ``kernel``, Numba's dispatcher of ``function``, compiles; messages go to the error stream."""
    try:
        kernel._cache = _Cache(function)
    except RuntimeError:  # Numba finds no directory that it can write
        _say_once("kernels are compiled at every start: set NUMBA_CACHE_DIR to a directory that can be written")


@functools.cache
def _say_once(message: str) -> None:
    print(f"{_PACKAGE.name}: {message}", file=sys.stderr, flush=True)
