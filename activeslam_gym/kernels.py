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
from numba.core.serialize import dumps
from numba.core.typing.templates import infer_global
from numba.extending import intrinsic, lower_cast

from .files import written_whole

Tree = TypeVar("Tree", bound=tuple)

_PACKAGE = Path(__file__).parent
_CONFIG: Any = _numba_config


def compiled(function: Any = None, **options: Any) -> Any:
    """Decorator of a function of numbers, arrays and records that kernels and Python may call; see `numba.njit`.

    Called from Python it is a kernel of its own, ``function.kernel``: Numba's dispatcher. A kernel that calls it has it
    compiled into itself, and is optimised there and nowhere else.
    """
    if function is None:
        return functools.partial(compiled, **options)
    if _CONFIG.DISABLE_JIT:
        return function
    alone = njit(nogil=True, error_model="numpy", **options)(function)  # a division by zero is no exception
    alone._cache = _cache_of(function)

    @functools.wraps(function)
    def call(*arguments: Any, **named: Any) -> Any:
        return alone(*arguments, **named)

    call.kernel = alone  # type: ignore[attr-defined]
    return _as_part(function, call, **options)


def uncompiled(function: Any) -> Any:
    """A `compiled` function as plain Python, for what is called so rarely that a kernel of its own does not pay."""
    return getattr(function, "__wrapped__", function)


def borrowing(function: Any = None, **options: Any) -> Any:
    """Decorator like `compiled`, of a kernel that makes no array, and calls none that returns one.

    It counts no references to its caller's arrays, which is a tenth of a frame. Numba refuses one that makes an array;
    an array that it is given is never freed, which `tests/test_no_slow_path.py` would count.
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
            return np.void.__getitem__(self, name) if fields and name in fields else object.__getattribute__(self, name)


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


def constants(example: Any, **fields: Any) -> tuple[np.dtype[Any], Callable[[Any], Record]]:
    """The type of a record of constants, and the function that fills it for a scenario, from one definition.

    A field is ``"f8"`` for the scenario's field of that name and this type, a function of the scenario, or a value; the
    type of the last two is that of the value for the scenario ``example``.
    """

    def value(scenario: Any, name: str) -> Any:
        field = fields[name]
        return getattr(scenario, name) if isinstance(field, str) else field(scenario) if callable(field) else field

    values = {name: np.asarray(value(example, name)) for name in fields}
    kinds = {
        name: field if isinstance(field, str) else (values[name].dtype, values[name].shape)
        for name, field in fields.items()
    }
    kind = record(**kinds)
    return kind, lambda scenario: filled(kind, **{name: value(scenario, name) for name in fields})


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
    """The code of a function that only kernels call: linked into them, and optimised there alone.

    Numba by itself optimises every function and makes machine code of it, and does so again within each of its callers.
    The first run takes 53 s of a processor with parts, and 116 s without.
    """

    def _optimize_final_module(self) -> None:
        """Nothing: the kernel that it becomes a part of is optimised as a whole."""

    def _finalize_final_module(self) -> None:
        """Ready to be linked, and no more."""
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """None: there is no machine code."""
        self._ensure_finalized()
        return 0

    @property
    def codegen(self) -> "_Part":
        """The receiver of the function's environment, the constants of its errors: a kernel raises none."""
        return self

    def set_env(self, name: str, environment: Any) -> None:
        """Nothing: see `codegen`."""


class _PartCompiler(Compiler):
    """Numba's compiler, with a `_Part` as its result."""

    def define_pipelines(self) -> list[Any]:
        """The passes of Numba's own."""
        self.state.library = _Part(self.state.targetctx.codegen(), self.state.func_id.func_qualname)
        self.state.library.enable_object_caching()
        return super().define_pipelines()


def _plain(kind: Any) -> Any:
    """The type of an argument, without a literal's value or the shape of an array in a record.

    Each would be compiled on its own: 360 functions instead of 320 before the first step, 52 s instead of 44.
    """
    return types.Array(kind.dtype, kind.ndim, "C") if isinstance(kind, types.NestedArray) else types.unliteral(kind)


@lower_cast(types.NestedArray, types.Array)
def _as_array(context: Any, builder: Any, source: Any, target: Any, value: Any) -> Any:
    return value


def _as_part(function: Any, call: Any = None, **options: Any) -> Any:
    """``call``, or the function itself; in kernels it is the function, compiled as a part of them."""
    call = call or function
    if not _CONFIG.DISABLE_JIT:
        alone: Any = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True, "pipeline_class": _PartCompiler}
        call.part = njit(**{"error_model": "numpy", "_nrt": True, **options, **alone})(function)
        found = call.part.get_call_template
        call.part.get_call_template = lambda arguments, named: found(
            tuple(map(_plain, arguments)), {name: _plain(kind) for name, kind in named.items()}
        )
        infer_global(call, types.Dispatcher(call.part))
    return call


# What `borrowed` is in kernels.
_as_part(lambda array: _without_owner(array), borrowed)  # type: ignore[call-arg]


# The cache ----------------------------------------------------------------------------------------------------------


_SIGNS = b"@compiled", b"@borrowing", b"@inlined", b" = record(", b" = constants(", b"one_of("
"""What tells a module that kernels are made of."""
_UPPER_FLOOR = _PACKAGE / "vision"  # its kernels call those of the modules below it, and never the other way round


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


class _Cache(FunctionCache):
    """Numba's own cache in a folder named after the `_content`; each kernel has a file named after its types.

    A kernel that cannot be loaded is compiled again.
    """

    complained = False  # that kernels cannot be kept, once a process

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        source = Path(function.__code__.co_filename)
        content = _content(source.is_relative_to(_UPPER_FLOOR))
        self._stamp = content if source.is_relative_to(_PACKAGE) else (content, self._impl.locator.get_source_stamp())
        self._cache_path = os.path.join(self._cache_path, f"kernels-{content}")
        self._cache_file: Any = self  # in the place of Numba's files: `load` and `save`

    def load(self, key: Any) -> Any:
        """The kernel that was saved under ``key``, or None."""
        identity, kernel = pickle.loads(self._file(key).read_bytes())
        return kernel if identity == (self._stamp, key) else None

    def save(self, key: Any, kernel: Any) -> None:
        """Keep a kernel under ``key``."""
        with written_whole(self._file(key)) as unfinished:
            unfinished.write_bytes(dumps(((self._stamp, key), kernel)))

    def _file(self, key: Any) -> Path:
        digest = hashlib.sha256(repr(key).encode()).hexdigest()[:16]
        return Path(self._cache_path, f"{self._impl.filename_base}.{digest}.nbc")

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The kernel for these types, or None where it has to be compiled."""
        found = None
        with contextlib.suppress(Exception):  # absent or damaged, or of a module that is no longer installed
            found = super().load_overload(sig, target_context)
        if found is None:
            _announce("which is kept for the next time")
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep the kernel."""
        try:
            super().save_overload(sig, data)
        except OSError as error:
            if not _Cache.complained:
                problem = f"a kernel could not be kept in {self._cache_path}: {error}"
                _say(f"{problem}; they will be compiled again at the next start")
            _Cache.complained = True
        _compilation_ended()


class _NoCache(NullCache):
    """In the place of `_Cache` where nothing can be written."""

    def load_overload(self, sig: Any, target_context: Any) -> None:
        """Every kernel has to be compiled."""
        _announce(
            "and again at every start, since no cache can be written: set NUMBA_CACHE_DIR to a directory that can"
        )

    def save_overload(self, sig: Any, data: Any) -> None:
        """Nothing is kept."""
        _compilation_ended()


def _cache_of(function: Callable[..., Any]) -> Any:
    """The cache of a kernel."""
    try:
        return _Cache(function)
    except RuntimeError:  # Numba finds no directory that it can write
        return _NoCache()


# Messages -----------------------------------------------------------------------------------------------------------

_PAUSE = 1.0  # seconds without compilation after which the next kernels are a batch of their own, and are announced
_compiled_at = -_PAUSE  # time of the last beginning or end of a compilation


def _announce(then: str) -> None:
    """Say why a call takes long: once for all kernels that are compiled one after another."""
    global _compiled_at
    if time.monotonic() - _compiled_at > _PAUSE:
        _say(f"compiling kernels (a minute or two), {then} ...")
    _compiled_at = time.monotonic()


def _compilation_ended() -> None:
    global _compiled_at
    _compiled_at = time.monotonic()


def _say(message: str) -> None:
    print(f"{_PACKAGE.name}: {message}", file=sys.stderr, flush=True)
