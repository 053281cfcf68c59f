"""How kernels are compiled, and where they are kept.

A kernel is compiled when it is first called, with all that it calls, and kept on disk. The folder that keeps it is
named after the *content* of the modules that hold kernels: an edit of any of them, or another branch, has a folder of
its own, and going back to the old content finds the old kernels again. Edits of other modules change nothing.
"""

import contextlib
import functools
import hashlib
import os
import pickle
import shutil
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numba
import numpy as np
from numba import config as _numba_config
from numba import njit, types
from numba.core.caching import FunctionCache, NullCache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.datamodel.models import OpaqueModel
from numba.core.errors import TypingError
from numba.core.serialize import dumps
from numba.core.targetconfig import ConfigStack
from numba.core.typing.templates import infer_global
from numba.extending import intrinsic, lower_cast, register_model

from .files import read_sealed, write_sealed

Tree = TypeVar("Tree", bound=tuple)

_PACKAGE = Path(__file__).parent
_CONFIG: Any = _numba_config
_FOLDERS_KEPT = 4
"""Contents whose kernels are kept beside the present one's, the last used ones."""


def compiled(function: Any = None, **options: Any) -> Any:
    """Decorator of a function of numbers, arrays and records that kernels and Python may call; see `numba.njit`.

    Called from Python it is a kernel of its own, ``function.kernel``: Numba's dispatcher. A kernel that calls it has it
    compiled into itself, and is optimised there and nowhere else. Where that is faster, it is written into its caller
    before that is compiled (``inline="always"``).
    """
    if function is None:
        return functools.partial(compiled, **options)
    if _CONFIG.DISABLE_JIT:
        return function
    alone = njit(nogil=True, error_model="numpy", **options)(function)  # a division by zero is no exception
    _keep(alone)
    if "inline" in options:
        return alone

    @functools.wraps(function)
    def call(*arguments: Any, **named: Any) -> Any:
        return alone(*arguments, **named)

    call.kernel = alone  # type: ignore[attr-defined]
    return _as_part(function, call, **options)


def uncompiled(function: Any) -> Any:
    """A `compiled` function as plain Python, for what is called so rarely that a kernel of its own does not pay."""
    return getattr(function, "__wrapped__", function)


def borrowing(function: Any = None, **options: Any) -> Any:
    """Decorator like `compiled`, of a kernel that makes no array: all that it handles are its caller's.

    So it counts no references to them, which is a tenth of a frame. Numba refuses one that makes an array.
    """
    return compiled(function, _nrt=False, **options)


def inlined(function: Any) -> Any:
    """Decorator of a function that is written into the kernels that call it; nothing else can call it.

    For those that make one run's records and arrays from a batch's: Numba cannot return a record.
    """
    return function if _CONFIG.DISABLE_JIT else njit(inline="always", error_model="numpy")(function)


def row(tree: Tree, i: int | slice) -> Tree:
    """Row ``i`` of all arrays in ``tree``, a nested named tuple of them: views. For Python; kernels have `inlined`."""
    return type(tree)(*(row(x, i) if isinstance(x, tuple) else x[i] for x in tree))


if TYPE_CHECKING:
    Record = Any  # a type checker does not know what fields a record has
else:

    class Record(np.record):
        """NumPy's record, of which a field comes before a method of the same name: ``feature.mean``."""

        def __getattribute__(self, name: str) -> Any:
            fields = object.__getattribute__(self, "dtype").fields
            return self[name] if fields and name in fields else super().__getattribute__(name)


@intrinsic
def _without_owner(_: Any, array: Any) -> Any:
    """Of an array in a kernel: the same numbers, without the owner whose references Numba counts."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        view = context.make_array(signature.return_type)(context, builder, value=arguments[0])
        view.meminfo = view.meminfo.type(None)
        return view._getvalue()

    return array(array), generate


def borrowed(array: np.ndarray) -> np.ndarray:
    """The same ``array``, of which a kernel keeps no count of references: that is a tenth of a frame, and more where
    threads count those of one batch. The kernel's caller holds the array for as long as the kernel runs.
    """
    return array


def record(**fields: Any) -> np.dtype[Any]:
    """The type of a record with these fields: ``name="f8"``, ``name=("f8", 3)``, or a record in the record.

    A record of an array, ``states[i]``, is a view, in kernels and outside: ``states[i].dim = 12`` writes.
    """
    return np.dtype(
        (Record, [(name, *(kind if isinstance(kind, tuple) else (kind,))) for name, kind in fields.items()])
    )


def filled(kind: np.dtype[Any], source: Any = None, **values: Any) -> Record:
    """A record of that ``kind`` with these values; the others of its fields are ``source``'s of the same names."""
    values = {name: getattr(source, name) for name in kind.names or () if hasattr(source, name)} | values
    if set(values) != set(kind.names or ()):
        raise TypeError(f"values must be given for {kind.names}, got {tuple(values)}")
    out = np.zeros(1, kind)[0]
    for name, value in values.items():
        out[name] = value
    return out


def one_of(functions: Any) -> Any:
    """A function for kernels, of (number, *arguments), that calls the one of that number; NaN where there is none."""
    first, *others = functions
    rest = one_of(others) if others else _as_part(lambda number, *arguments: np.nan)

    def choose(number, *arguments):  # type: ignore[no-untyped-def]
        return first(*arguments) if number == 0 else rest(number - 1, *arguments)

    # A name of its own: kernels that two processes compiled are linked by names, and would take each other's choice.
    choose.__qualname__ = "_".join(("one_of", first.__module__, *(function.__name__ for function in functions)))
    return _as_part(choose)


# Parts of kernels ---------------------------------------------------------------------------------------------------


class _Part(JITCodeLibrary):
    """The code of a function that only kernels call: linked into them, and never a program of its own.

    Numba optimises every function and makes machine code of it, and then does so again within each of its callers.
    Without that, the first run waits about a quarter less.
    """

    def _optimize_final_module(self) -> None:
        """Nothing: the kernel that it becomes a part of is optimised as a whole."""

    def _finalize_final_module(self) -> None:
        """Ready to be linked, and no more."""
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """Nowhere: there is no machine code."""
        self._ensure_finalized()
        return 0

    @property
    def codegen(self) -> "_Part":
        """Who is told the function's environment, the constants of its errors: a kernel raises none."""
        return self

    def set_env(self, name: str, environment: Any) -> None:
        """Nothing: see `codegen`."""


class _PartCompiler(Compiler):
    """Numba's compiler, whose outcome is a `_Part`."""

    def define_pipelines(self) -> list[Any]:
        """The passes of Numba's own."""
        self.state.library = _Part(self.state.targetctx.codegen(), self.state.func_id.func_qualname)
        self.state.library.enable_object_caching()
        return super().define_pipelines()

    def compile_extra(self, func: Any) -> Any:
        """The part, without the types of all that it names, which the garbage collector would visit again and again."""
        part = super().compile_extra(func)
        part.fndesc.typemap = part.fndesc.calltypes = None
        return part._replace(type_annotation=None)


class _PartType(types.Dispatcher):
    """What a part is to Numba: a function that is compiled once for an array, in a record or not, and for an integer.

    Numba by itself would compile it for every length of an array in a record, and for every integer that is written
    out: of 230 functions it made 374, and of 35 of this package's own two or more.
    """

    def get_call_type(self, context: Any, arguments: Any, named: Any) -> Any:
        """The signature for arguments of these types."""
        plain = {name: _plain(kind) for name, kind in named.items()}
        signature = super().get_call_type(context, tuple(map(_plain, arguments)), plain)
        part: Any = self.dispatcher
        caller, counts = ConfigStack.top_or_none(), part.targetoptions["_nrt"]
        if caller and not caller.nrt and counts and signature and _holds_array(signature.return_type):
            raise TypingError(f"a borrowing kernel cannot own the array that {part.py_func.__name__} returns")
        return signature


register_model(_PartType)(OpaqueModel)


def _plain(kind: Any) -> Any:
    """The type of an argument, without the length of an array in a record or the value of an integer."""
    if isinstance(kind, types.NestedArray):
        return types.Array(kind.dtype, kind.ndim, "C")
    return types.unliteral(kind)


def _holds_array(kind: Any) -> bool:
    """Whether a value of that type is an array, or a tuple that holds one."""
    return isinstance(kind, types.Array) or any(_holds_array(part) for part in getattr(kind, "types", ()))


@lower_cast(types.NestedArray, types.Array)
def _array_in_record(_context: Any, _builder: Any, _from: Any, _to: Any, array: Any) -> Any:
    """An array in a record is to a kernel what every array is: a view, of a length that is known."""
    return array


def _as_part(function: Any, call: Any = None, **options: Any) -> Any:
    """``call``, or the function itself; in kernels it is the function, compiled as a part of them."""
    call = call or function
    if not _CONFIG.DISABLE_JIT:
        alone: Any = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True, "pipeline_class": _PartCompiler}
        call.part = njit(**{"error_model": "numpy", "_nrt": True, **options, **alone})(function)
        infer_global(call, _PartType(call.part))
    return call


# What `borrowed` is in kernels.
_as_part(lambda array: _without_owner(array), borrowed)  # type: ignore[call-arg]


# The cache ----------------------------------------------------------------------------------------------------------


_SIGNS = b"@compiled", b"@borrowing", b"@inlined", b" = record(", b"one_of("
"""What tells a module that kernels are made of."""
_UPPER_FLOOR = _PACKAGE / "vision"
"""Its kernels call those of the modules below it, and never the other way round."""


@functools.cache
def _content(upper_floor: bool) -> str:
    """A number for the content of all modules that kernels are made of, with or without the upper floor's.

    The versions of Numba and NumPy, which compile and are compiled in, count as content.
    """
    digest = hashlib.sha256(f"numba {numba.__version__}, numpy {np.__version__}".encode())
    for source in sorted(_PACKAGE.rglob("*.py")):
        content = source.read_bytes()
        if any(sign in content for sign in _SIGNS) and (upper_floor or not source.is_relative_to(_UPPER_FLOOR)):
            digest.update(source.relative_to(_PACKAGE).as_posix().encode() + b"\0" + content)
    return digest.hexdigest()[:16]


class _Files:
    """A file for each kernel, with a checksum, in the place of Numba's own files, which have none.

    A flipped bit in a file of Numba's can crash the process. Here a damaged file counts as absent.
    """

    def __init__(self, folder: str, name: str, stamp: Any) -> None:
        self._stamp, self._path = stamp, os.path.join(folder, name)

    def load(self, key: Any) -> Any:
        """The kernel that was saved under ``key``, or None."""
        data = read_sealed(self._file(key))
        identity, kernel = (None, None) if data is None else pickle.loads(data)
        return kernel if identity == (self._stamp, key) else None

    def save(self, key: Any, kernel: Any) -> None:
        """Keep a kernel under ``key``."""
        write_sealed(self._file(key), dumps(((self._stamp, key), kernel)))

    def _file(self, key: Any) -> Path:
        return Path(f"{self._path}.{hashlib.sha256(repr(key).encode()).hexdigest()[:16]}.nbc")


class _Cache(FunctionCache):
    """Numba's own cache in a folder named after the `_content`. A kernel that cannot be loaded is compiled again."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        source = Path(function.__code__.co_filename)
        content = _content(source.is_relative_to(_UPPER_FLOOR))
        stamp = content if source.is_relative_to(_PACKAGE) else (content, self._impl.locator.get_source_stamp())
        self._cache_path = os.path.join(self._cache_path, f"kernels-{content}")
        self._cache_file: Any = _Files(self._cache_path, self._impl.filename_base, stamp)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The kernel for these types, or None where it has to be compiled."""
        found = None
        with contextlib.suppress(Exception):  # an undamaged file may name a module that is no longer installed
            found = super().load_overload(sig, target_context)
        if found is None:
            _announce(kept=True)
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep the kernel, and forget the kernels of contents that were not used for long."""
        try:
            if not os.path.isdir(self._cache_path):
                os.makedirs(self._cache_path, exist_ok=True)
                _forget_old_folders(Path(self._cache_path))
            super().save_overload(sig, data)
        except OSError as error:
            problem = f"a kernel could not be kept in {self._cache_path}: {error}"
            _say_once("cache", f"{problem}; they will be compiled again at the next start")
        _compilation_ended()


class _NoCache(NullCache):
    """In the place of `_Cache` where nothing can be written."""

    def load_overload(self, sig: Any, target_context: Any) -> None:
        """Every kernel has to be compiled."""
        _announce(kept=False)

    def save_overload(self, sig: Any, data: Any) -> None:
        """Nothing is kept."""
        _compilation_ended()


def _keep(kernel: Any) -> None:
    """Give a kernel its cache."""
    try:
        kernel._cache = _Cache(kernel.py_func)
    except RuntimeError:  # Numba finds no directory that it can write
        kernel._cache = _NoCache()


def _forget_old_folders(present: Path) -> None:
    """Remove the folders beside the ``present`` one, but for those used last."""
    with contextlib.suppress(OSError):
        folders = sorted(present.parent.glob("kernels-*"), key=lambda folder: folder.stat().st_mtime, reverse=True)
        for folder in [folder for folder in folders if folder != present][_FOLDERS_KEPT:]:
            shutil.rmtree(folder, ignore_errors=True)


# What is said -------------------------------------------------------------------------------------------------------

_PAUSE = 1.0
"""Seconds without compilation after which the next kernels are a batch of their own, and are announced."""
_said: set[str] = set()
_compiled_at = -_PAUSE
"""When the last compilation began or ended."""


def _announce(kept: bool) -> None:
    """Say why a call takes long: once for all kernels that are compiled one after another."""
    then = (
        "which is kept for the next time"
        if kept
        else "and again at every start, since no cache can be written: set NUMBA_CACHE_DIR to a directory that can"
    )
    if time.monotonic() - _compiled_at > _PAUSE:
        _say(f"compiling kernels (a minute or two), {then} ...")
    _compilation_ended()


def _compilation_ended() -> None:
    global _compiled_at
    _compiled_at = time.monotonic()


def _say_once(topic: str, message: str) -> None:
    """Say something on a topic, once a process."""
    if topic not in _said:
        _said.add(topic)
        _say(message)


def _say(message: str) -> None:
    print(f"{_PACKAGE.name}: {message}", file=sys.stderr, flush=True)
