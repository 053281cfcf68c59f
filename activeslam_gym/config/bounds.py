"""Bounds of a scenario's fields, which their types state (``PositiveFloat``, ...), and of other arguments."""

import math
import operator
import os
import sys
from collections.abc import Callable
from enum import Enum
from typing import Annotated, Any, NamedTuple, get_type_hints

from activeslam_gym.registry import did_you_mean

MOST_FRAMES = 10**9
"""The longest duration in frames."""


class Bound(NamedTuple):
    """A condition on the value of a field. Those of a type are tested in order, up to the first that fails."""

    allowed: str
    """Completes the message "scenario.pixel_std must be ..."."""
    holds: Callable[[Any], bool]
    """Whether a value meets it. The first bound of a type takes values of any type."""
    words: tuple[str, ...] = ()
    """What a mistyped value may have meant."""


def is_number(value: Any) -> bool:
    """Whether it is an int or a float, finite, and an int within the range of floats."""
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) <= sys.float_info.max


def is_tuple(value: Any, length: int | None, holds: Callable[[Any], bool] = lambda _: True) -> bool:
    """Whether it is a tuple of this length (None: of any), and ``holds`` is true of all members."""
    return isinstance(value, tuple) and length in (None, len(value)) and all(map(holds, value))


def among(*words: str) -> Bound:
    """One of these strings."""
    return Bound(f"one of {', '.join(words)}", lambda value: isinstance(value, str) and value in words, words)


def _number(allowed: str, holds: Callable[[Any], bool] = lambda x: True, none: bool = False) -> Bound:
    """A number; or None, if ``none`` is set."""
    return Bound(allowed, lambda value: (is_number(value) and holds(value)) or (none and value is None))


def _at_most(largest: int) -> Bound:
    return Bound(f"at most {largest}", lambda x: x <= largest)


def _is_box(value: Any) -> bool:
    """Whether it is two corners, the lowest and the highest along X, Y and Z."""
    return is_tuple(value, 2, lambda corner: is_tuple(corner, 3, is_number)) and all(map(operator.lt, *value))


def _is_moderate(value: Any) -> bool:
    """Whether squares and quotients of such numbers are finite and not zero; of tuples, all members."""
    if isinstance(value, tuple):
        return all(map(_is_moderate, value))
    return value is None or value == 0 or 1e-12 <= abs(value) <= 1e12


def _is_scene(value: Any) -> bool:
    return isinstance(value, str) or callable(value) or (isinstance(value, dict) and "path" in value)


_WHOLE = _number("a whole number", lambda x: isinstance(x, int))
_POSITIVE = _number("a positive number", lambda x: x > 0)
_NOT_NEGATIVE = _number("zero or a positive number", lambda x: x >= 0)
_POSITIVE_OR_NONE = _number("a positive number or None", lambda x: x > 0, none=True)
_FINITE_OR_NONE = _number("a finite number or None", none=True)
_AT_LEAST_2 = Bound("at least 2", lambda x: x >= 2)
_MODERATE = Bound("of a size from 1e-12 to 1e12", _is_moderate)
_XYZ = Bound("3 positive numbers", lambda value: is_tuple(value, 3, _POSITIVE.holds))
_PAIR = Bound("2 positive numbers", lambda value: is_tuple(value, 2, _POSITIVE.holds))
INCREASING = Bound("in increasing order", lambda pair: pair[0] < pair[1])
_COUNTS = Bound(
    "two whole numbers from 0 to 100, in no decreasing order",
    lambda value: is_tuple(value, 2, _WHOLE.holds) and 0 <= value[0] <= value[1] <= 100,
)
_BOXES = Bound(
    "boxes ((x, y, z), (x, y, z)), the lowest and the highest corner of each",
    lambda value: is_tuple(value, None, _is_box),
)

FiniteFloat = Annotated[float, _number("a finite number"), _MODERATE]
PositiveFloat = Annotated[float, _POSITIVE, _MODERATE]
NonNegativeFloat = Annotated[float, _NOT_NEGATIVE, _MODERATE]
PositiveFloatOrNone = Annotated[float | None, _POSITIVE_OR_NONE, _MODERATE]
FiniteFloatOrNone = Annotated[float | None, _FINITE_OR_NONE, _MODERATE]
ClutterRate = Annotated[float, _NOT_NEGATIVE, _MODERATE, _at_most(200)]
Probability = Annotated[float, _number("in [0, 1)", lambda x: 0 <= x < 1)]
Angle = Annotated[float, _POSITIVE, Bound("at most pi / 2", lambda x: x <= math.pi / 2)]
PositiveXYZ = Annotated[tuple[float, float, float], _XYZ, _MODERATE]
PositiveRange = Annotated[tuple[float, float], _PAIR, INCREASING, _MODERATE]
PositiveInt = Annotated[int, _WHOLE, _POSITIVE, _at_most(10**6)]
PointCount = Annotated[int, _WHOLE, _NOT_NEGATIVE, _at_most(1000)]
PositivePointCount = Annotated[int, _WHOLE, _POSITIVE, _at_most(1000)]
ParticleCount = Annotated[int, _WHOLE, _AT_LEAST_2, _at_most(10**4)]
CountRange = Annotated[tuple[int, int], _COUNTS]
Boxes = Annotated[tuple[tuple[tuple[float, float, float], tuple[float, float, float]], ...], _BOXES, _MODERATE]
Switch = Annotated[bool, Bound("True or False", lambda value: isinstance(value, bool))]
String = Annotated[str, Bound("a string", lambda value: isinstance(value, str))]
Part = Annotated[Any, Bound("a name, or an object that can be called", lambda x: isinstance(x, str) or callable(x))]
SceneOrMesh = Annotated[Any, Bound("a name, a mesh, or an object that can be called", _is_scene)]


class Settings:
    """Base of the frozen dataclasses with a scenario's fields: tests the bounds, then `_check`."""

    BOUNDS = dict[str, tuple[Bound, ...]]()

    def __init_subclass__(cls) -> None:
        hints = get_type_hints(cls, include_extras=True)
        cls.BOUNDS = {name: hint.__metadata__ for name, hint in hints.items()}

    def __post_init__(self) -> None:
        for name, bounds in self.BOUNDS.items():
            value = plain(getattr(self, name))
            object.__setattr__(self, name, value)
            for bound in bounds:
                self._demand(name, bound.holds(value), bound.allowed, bound.words)
        self._check()

    def _check(self) -> None:
        """Test conditions that bind several fields. An override calls this one first: each subject adds its own."""

    def _demand(self, name: str, holds: bool, allowed: str, words: tuple[str, ...] = ()) -> None:
        if not holds:
            value = getattr(self, name)
            raise ValueError(f"scenario.{name} must be {allowed}, got {value!r:.300}{did_you_mean(value, words)}")


def positive_number(name: str, value: Any, unit: str) -> float:
    """``value`` as a float, which may be infinite. ValueError, with ``name``: it is no positive number."""
    value = plain(value)
    if not (is_number(value) or (isinstance(value, float) and value == math.inf)) or value <= 0:
        raise ValueError(f"{name} must be a positive number of {unit}, got {value!r}")
    return float(value)


def whole_number(name: str, value: Any, least: int = 1) -> int:
    """``value`` as an int. ValueError, with ``name``: it is no whole number of ``least`` or more."""
    try:
        number = operator.index(value)
    except TypeError:
        number = least - 1
    if number < least or isinstance(value, bool):
        raise ValueError(f"{name} must be a whole number of {least} or more, got {value!r}")
    return number


def whole_multiple(name: str, value: Any, unit_name: str, unit: float, most: int = MOST_FRAMES) -> int:
    """``value / unit``, both [s]; 0.15 / 0.05 is 3. ValueError, with ``name``: it is not whole, or over ``most``."""
    seconds = positive_number(name, value, "seconds")
    if seconds == math.inf:
        raise ValueError(f"{name} must be a positive number of seconds, got {value!r}")
    count = round(min(seconds / unit, sys.float_info.max))  # the quotient of two floats may be infinite
    if count > most:
        raise ValueError(f"{name} must be at most {most} times {unit_name} ({unit:g} s), got {value!r}")
    if count < 1 or abs(seconds / unit - count) > 1e-6 * count:
        raise ValueError(f"{name} must be a whole multiple of {unit_name} ({unit:g} s), got {value!r}")
    return count


def plain(value: Any, levels: int = 3) -> Any:
    """The value with tuples for lists and arrays, Python's numbers for scalars of NumPy, values of enums' members, and
    strings for paths.

    An ellipsis replaces parts that are nested deeper than ``levels``, more than any field needs: messages stay short.
    """
    if hasattr(value, "tolist") and not callable(value):  # an array or a scalar of NumPy
        value = value.tolist()
    if isinstance(value, (list, tuple, dict)) and levels == 0:
        return ...
    if isinstance(value, (list, tuple)):
        return tuple(plain(part, levels - 1) for part in value)
    if isinstance(value, dict):
        return {name: plain(part, levels - 1) for name, part in value.items()}
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    return value.value if isinstance(value, Enum) else value
