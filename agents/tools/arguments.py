"""What the commands take and check; a ValueError names the argument, its value and what is allowed."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True, kw_only=True)
class Rooms:
    """What every command takes that plays many rooms."""

    seed: int = 1_000_000
    """Episode j is reset(seed=seed + j)."""
    jobs: int = field(default_factory=lambda: os.cpu_count() or 1)
    """Processes."""

    def __post_init__(self) -> None:
        """Raises ValueError for a number that is less than it may be."""
        at_least(self, episodes=1, seed=0, jobs=1)


def at_least(args: Any, **least: int) -> None:
    """Raise ValueError where an argument is less than it may be."""
    for name, bound in least.items():
        if getattr(args, name) < bound:
            raise ValueError(f"{name}: {getattr(args, name)}; allowed: {bound} or more")


def positive(args: Any, *names: str) -> None:
    """Raise ValueError where an argument is not above zero."""
    for name in names:
        if not getattr(args, name) > 0:
            raise ValueError(f"{name} must be positive, got {getattr(args, name)!r}")


def given(args: Any, *names: str) -> None:
    """Raise ValueError where a list of names is empty."""
    for name in names:
        if not getattr(args, name):
            raise ValueError(f"{name}: none given; allowed: one name or more")


def times_within(times: Sequence[float], duration: float) -> list[float]:
    """Those within the duration, and its end."""
    return sorted({*(time for time in times if time < duration), duration})


def scenario_argument(text: str) -> str | dict[str, Any]:
    """A scenario as the command line gives it: a name, or a JSON object of fields. Raises ValueError for bad JSON."""
    if not text.lstrip().startswith("{"):
        return text
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        raise ValueError(f"scenario: {text!r} is no JSON object ({error})") from error
