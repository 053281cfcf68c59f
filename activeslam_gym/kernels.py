"""Kernels: the functions that Numba compiles, and the records that they work on.

A kernel is compiled when it is first called, with all that it calls, and kept on disk. The folder that keeps it is
named after the *content* of the modules that hold kernels: an edit of any of them, or another branch, has a folder of
its own, and going back to the old content finds the old kernels again. Edits of other modules change nothing.
"""

import contextlib
import functools
import gc
import os
import sys
import threading
from collections.abc import Callable, Iterator
from operator import getitem
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

Tree = TypeVar("Tree", bound=tuple)

_LOCK = threading.Lock()


def _is_disabled() -> bool:
    """Whether Numba is not to compile."""
    if "numba" in sys.modules:
        return bool(sys.modules["numba"].config.DISABLE_JIT)
    return os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0")


_DISABLED = _is_disabled()


def borrowed(array: np.ndarray) -> np.ndarray:
    """For kernels: an array without the owner whose references Numba counts; see `linking`."""
    return array


_to_link: list[tuple[Any, Any, dict[str, Any]]] = [(borrowed, None, {})]
"""What kernels may call, its function and options: linked before a compilation. So an import takes no Numba in."""


def compiled(function: Any = None, **options: Any) -> Any:
    """Decorator of a function of numbers, arrays and records that kernels and Python may call; see `numba.njit`.

    Called from Python it is a kernel of its own, ``function.kernel``: Numba's dispatcher, once it was called. A kernel
    that calls it has it compiled into itself, and is optimised there and nowhere else.
    """
    if function is None:
        return functools.partial(compiled, **options)
    if _DISABLED:
        return function

    @functools.wraps(function)
    def call(*arguments: Any, **named: Any) -> Any:
        return call.kernel(*arguments, **named)  # type: ignore[attr-defined]

    call.kernel = functools.partial(_first_call, call, function, options)  # type: ignore[attr-defined]
    _to_link.append((call, function, options))
    return call


def _first_call(call: Any, function: Any, options: dict[str, Any], *arguments: Any, **named: Any) -> Any:
    """Make the kernel of ``call`` and run it. At the import, most of the time would go into those never called."""
    with _LOCK:  # of several threads, one makes it
        if isinstance(call.kernel, functools.partial):
            from numba import njit

            from .linking import keep

            kernel: Any = njit(nogil=True, error_model="numpy", **options)(function)  # dividing by zero is no exception
            if kernel is not function:  # which a file of settings may ask of Numba
                kernel.compile = _compiling()(kernel.compile)
                kernel._compiler.compile = functools.partial(_compile, kernel._compiler.compile)
                keep(kernel, function)
            call.kernel = kernel
    return call.kernel(*arguments, **named)


def _compile(compile: Any, *arguments: Any) -> Any:
    """What is not on disk: Numba's ``compile``, after all that kernels may call was linked."""
    from .linking import link, link_borrowed

    while _to_link:
        call, function, options = _to_link.pop()
        if function is None:
            link_borrowed(call)
        else:
            link(call, function, **options)
    return compile(*arguments)


@contextlib.contextmanager
def _compiling() -> Iterator[None]:
    """Without Python's garbage collector: a tenth faster, with a peak of 0.9 GB of memory in place of 0.5. With LLVM's
    first level of optimisation: another 7 %, and kernels as fast, with equal results."""
    from numba import config
    from numba.core.compiler_lock import global_compiler_lock

    settings: Any = config
    with global_compiler_lock:  # another thread that compiles has both settings as they were
        was_enabled, level = gc.isenabled(), settings.OPT
        gc.disable()
        settings.OPT = type(level)(min(level, 1))
        try:
            yield
        finally:
            settings.OPT = level
            if was_enabled:
                gc.enable()


def uncompiled(function: Any) -> Any:
    """A `compiled` function as plain Python, for what is called so rarely that a kernel of its own does not pay."""
    return getattr(function, "__wrapped__", function)


def borrowing(function: Any = None, **options: Any) -> Any:
    """Decorator like `compiled`, of a kernel that makes no array, and calls none that returns one; see `linking`.

    It counts no references to its caller's arrays. Numba refuses one that makes an array.
    """
    return compiled(function, _nrt=False, **options)


def inlined(function: Any) -> Any:
    """Decorator of a function that is written into the kernels that call it; nothing else can call it.

    For those that make one run's records and arrays from a batch's: Numba cannot return a record.
    """
    function.targetoptions, function.py_func = {"inline": "always"}, function  # as of Numba's dispatcher
    _to_link.append((function, function, {}))
    return function


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

        def __reduce__(self) -> Any:
            """As an item of an array: once unpickled, a record of NumPy 2.4.6 ignores what is written (findings/)."""
            return getitem, (np.array([self]), 0)


def record(**fields: Any) -> np.dtype[Any]:
    """The type of a record with these fields: ``name="f8"``, ``name=("f8", 3)``, or a record in the record.

    A record of an array, ``states[i]``, is a view, in kernels and outside: ``states[i].dim = 12`` writes. An argument
    has the name of its type: ``motion`` is a MOTION. A ``lens`` is a CAMERA, and ``model`` the constants of its module.
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
    names = {f"f{k}": function for k, function in enumerate(functions)}
    lines = [f"    if number == {k}: return {name}(*arguments)" for k, name in enumerate(names)]
    made: dict[str, Any] = {"__name__": __name__, "nan": np.nan, **names}
    exec("\n".join(("def choose(number, *arguments):", *lines, "    return nan")), made)
    choose = made["choose"]
    # A name of its own: kernels that two processes compiled are linked by names, and would take each other's choice.
    choose.__qualname__ = "_".join(("one_of", functions[0].__module__, *(one.__name__ for one in functions)))
    _to_link.append((choose, choose, {}))
    return choose
