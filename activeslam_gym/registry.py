"""Registries: the criteria, rewards, estimators, sensors and scenarios that are chosen by name."""

import difflib
import numbers
from collections.abc import Callable, Iterable
from typing import Any, TypeVar

import numpy as np

Entry = TypeVar("Entry")

_GREATEST = 1e300  # a registered function's values are below it, so that differences and sums of them are finite
REGISTERED = -1  # in place of its number: an entry that is not one of the package's own


class Registry(dict[str, Entry]):
    """Entries of one ``kind``, such as "criterion", by name; `register` adds one at run time."""

    kind = "name"
    reserved: tuple[str, ...] = ()
    """Names that no entry may have from now on: those of the package's own entries, and others."""
    own: tuple[str, ...] = ()  # names of the package's own entries, by number

    def __init__(self, kind: str, entries: dict[str, Entry] | None = None) -> None:
        super().__init__(entries or {})
        self.kind = kind
        REGISTRIES.append(self)

    def register(self, name: str) -> Callable[[Any], Any]:
        """Decorator that adds an entry, or replaces the registered one of that name.

        Raises:
            ValueError: ``name`` is not a string, empty, or the name of one of the package's own.
        """

        def enter(entry: Any) -> Any:
            self[name] = entry
            return entry

        return enter

    def seal(self, *reserved: str) -> list[Entry]:
        """The entries so far, which become the package's own. Nothing can replace them or have a ``reserved`` name."""
        self.own = tuple(self)
        self.reserved = (*self.own, *reserved)
        return list(self.values())

    def __setitem__(self, name: str, entry: Entry) -> None:
        if not isinstance(name, str) or not name:
            raise ValueError(f"the name of a registered {self.kind} must be a string, got {name!r}")
        if name in self.reserved:
            raise ValueError(f"the name of a registered {self.kind} must be none of the package's own, got {name!r}")
        super().__setitem__(name, entry)

    def __getitem__(self, name: Any) -> Entry:
        """The entry of that name; raises as `require`."""
        self.require(name)
        return super().__getitem__(name)

    def require(self, name: Any, argument: str = "") -> None:
        """Check the ``name`` that an ``argument`` gives.

        Raises:
            ValueError: there is no such entry; the message lists those that there are.
        """
        if not isinstance(name, str) or name not in self:
            raise ValueError(
                f"{argument or self.kind} must be one of {', '.join(self)}, got {name!r}{did_you_mean(name, self)}"
            )

    def number(self, name: Any) -> int:
        """The number by which kernels know one of the package's own entries, or REGISTERED; raises as `require`."""
        self.require(name)
        return self.own.index(name) if name in self.own else REGISTERED

    def value(self, name: str, where: str, *arguments: Any) -> float:
        """The value of an entry that is a function; a registered one must return a finite number.

        Raises:
            ValueError: a registered one fails or returns anything else; the message names it, and tells ``where``.
        """
        if name in self.own:
            return self[name](*arguments)  # type: ignore[operator]
        value = asked(f"{self.kind} {name!r}", self[name], *arguments, where=f" {where}")  # type: ignore[arg-type]
        if not isinstance(value, numbers.Real) or not abs(value) < _GREATEST:  # type: ignore[operator]
            raise ValueError(f"{self.kind} {name!r} must return a finite number {where}, got {value!r:.300}")
        return float(value)


def asked(what: str, answer: Callable[..., Any], *arguments: Any, where: str = "") -> Any:
    """What a registered part answers; where it fails, a ValueError that begins with ``what``."""
    try:
        return answer(*arguments)
    except Exception as error:
        raise ValueError(f"{what} failed{where}: {type(error).__name__}: {error}") from error


_KINDS = {float: ("numbers", "fiuO"), int: ("whole numbers", "iu"), bool: ("True or False", "b")}


def array_of(what: str, value: Any, shape: tuple[int | None, ...], kind: type = float) -> np.ndarray:
    """A copy of ``value`` as an array of that ``kind``, float, int or bool, and ``shape``, where None is any length.

    Raises:
        ValueError: it is anything else; the message begins with ``what``.
    """
    words, kinds = _KINDS[kind]
    try:
        given = np.asarray(value)
        array: Any = given.astype(kind) if given.dtype.kind in kinds or not given.size else None
        array = None if kind is int and (array != given).any() else array  # an unsigned one beyond int64
    except (TypeError, ValueError, OverflowError):
        array = None
    sizes = () if array is None else array.shape
    if array is None or len(sizes) != len(shape) or any(n not in (None, m) for n, m in zip(shape, sizes, strict=True)):
        size = str(shape).replace("None", "n")
        raise ValueError(f"{what} must be {words} of shape {size}, got {value!r:.300}")
    return array


def did_you_mean(word: Any, known: Iterable[str]) -> str:
    """Completes an error's message: " (did you mean 'paper'?)"; nothing where no known word is near."""
    names = {one.lower(): one for one in known}
    near = difflib.get_close_matches(str(word)[:80].lower(), names, 1)
    return f" (did you mean {names[near[0]]!r}?)" if near else ""


REGISTRIES: list[Registry[Any]] = []  # all registries of this process
