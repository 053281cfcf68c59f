"""Parts by name or as objects: scenes, sensors, estimators, criteria and rewards, the package's own and a user's."""

import difflib
import numbers
from collections.abc import Callable, Iterable, Mapping
from functools import reduce
from importlib import import_module
from typing import Any

import numpy as np

FOREIGN = -1  # in place of its number: a part that is not one of the package's own
_GREATEST = 1e300  # a foreign function's values are below it, so that differences and sums of them are finite


def part_of(argument: str, given: Any, own: Mapping[str, Any], *others: str) -> Any:
    """The part that an ``argument`` gives: an object as it is, or by name: one of ``own``, or 'package.module:name'.

    Raises:
        ValueError: there is no such part; the message lists those that there are, and ``others`` that a caller takes.
    """
    if isinstance(given, str) and given in own:
        return own[given]
    if isinstance(given, str) and ":" in given:
        module, _, name = given.partition(":")
        try:
            return reduce(getattr, name.split("."), import_module(module))
        except Exception as error:
            why = f"{type(error).__name__}: {error}"
            raise ValueError(f"{argument}: {given!r} cannot be imported ({why})") from error
    if isinstance(given, str) or not callable(given):
        allowed = f"one of {', '.join((*own, *others))}, 'package.module:name', or an object that can be called"
        raise ValueError(f"{argument} must be {allowed}, got {given!r}{did_you_mean(given, own)}")
    return given


def number_of(argument: str, given: Any, own: Mapping[str, Any]) -> int:
    """The number by which kernels know one of ``own``, or FOREIGN; raises as `part_of`."""
    part_of(argument, given, own)
    return list(own).index(given) if isinstance(given, str) and given in own else FOREIGN


def name_of(part: Any) -> str:
    """The name of a part, for messages: 'package.module:name' of a class or a function."""
    if isinstance(part, str):
        return part
    name = getattr(part, "__qualname__", None)
    return f"{part.__module__}:{name}" if name else repr(part)[:80]


def number_from(what: str, function: Callable[..., Any], *arguments: Any, where: str) -> float:
    """The value of a foreign function, a finite number.

    Raises:
        ValueError: it fails, or returns anything else; the message begins with ``what``, and tells ``where``.
    """
    value = asked(what, function, *arguments, where=f" {where}")
    value = value.item() if isinstance(value, np.generic) else value  # one of 32 bits overflows beside the greatest
    if not isinstance(value, numbers.Real) or not abs(value) < _GREATEST:  # type: ignore[operator]
        raise ValueError(f"{what} must return a finite number {where}, got {value!r:.300}")
    return float(value)


def asked(what: str, answer: Callable[..., Any], *arguments: Any, where: str = "") -> Any:
    """What a foreign part answers; where it fails, a ValueError that begins with ``what``."""
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
