"""Arguments that commands share, and their checks; a ValueError names the argument, its value and the allowed ones."""

import json
import os
import shlex
from dataclasses import dataclass, field, fields
from importlib import import_module
from pathlib import Path
from typing import Any

from activeslam_gym.config import ASKED, fields_of, scenario_from
from agents.tools.files import reading
from agents.tools.sections import page_with

SEEDS = (0, 2**62)  # bounds of a seed: the episodes after it have seeds too
NO_NUMBER = ("jobs", "cluster", "out", "report", "resume", "figures")  # arguments that decide no number


@dataclass(frozen=True, kw_only=True)
class Workers:
    """Where episodes are played."""

    jobs: int = field(default_factory=lambda: os.cpu_count() or 1)
    """Number of processes."""
    cluster: str = ""
    """Address of a Ray cluster that plays the episodes: 'auto' on one of its machines, 'ray://HEAD:10001' from
    elsewhere, 'local' for one on this machine."""

    def __post_init__(self) -> None:
        """Raises ValueError for a number outside its bounds."""
        within(self, jobs=(1, 4096))

    @property
    def workers(self) -> int | str:
        """As a `Store` takes them."""
        return self.cluster or self.jobs


@dataclass(frozen=True, kw_only=True)
class Times:
    """How long a step and an episode are."""

    gaze_period: float | None = None
    """Seconds of a step; the scenario's if not given."""
    duration: float | None = None
    """Seconds of an episode; the scenario's if not given."""

    def environment(self, scenario: str) -> dict[str, Any]:
        """Arguments of the environment, for a scenario of the command line."""
        return {
            "scenario": scenario_argument(scenario),
            "gaze_period": self.gaze_period,
            "duration": self.duration,
        }


@dataclass(frozen=True, kw_only=True)
class Pages:
    """Generated sections of pages that people write."""

    report: tuple[Path, ...] = ()
    """Markdown pages in which this command rewrites its generated sections."""

    def check_pages(self, *sections: str) -> None:
        """Raises ValueError where a page has none of these sections."""
        for page in self.report:
            page_with(page, *sections)


def command_line(module: str, args: Any) -> str:
    """The command of a ``module`` that `args` are of: how many episodes, and whatever else decides its numbers and is
    no default."""
    given = []
    for one in sorted(fields(args), key=lambda field: (field.name == "seed", field.name != "policies")):
        value = getattr(args, one.name)
        of_episodes = one.name in ("episodes", "seed") and value is not None
        if of_episodes or (one.name not in NO_NUMBER and value != one.default):
            several = value if isinstance(value, tuple) else (value,)
            texts = [f"{part:.15g}" if isinstance(part, float) else shlex.quote(str(part)) for part in several]
            given.append(f"--{one.name.replace('_', '-')} {' '.join(texts)}")
    return " ".join([f"python -m {module}", *given])


def within(args: Any, **bounds: tuple[float, float]) -> None:
    """Raise ValueError where an argument lies outside its bounds; one that is None, or absent, does not."""
    for name, (low, high) in bounds.items():
        value = getattr(args, name, None)
        if value is not None and not low <= value <= high:
            raise ValueError(f"{name}: {value!r}; allowed: {low} to {high}")


def given(args: Any, *names: str) -> None:
    """Raise ValueError where a list of names is empty."""
    for name in names:
        if not getattr(args, name):
            raise ValueError(f"{name}: none given; allowed: one name or more")


def scenario_argument(text: str) -> str | dict[str, Any]:
    """A scenario of the command line, as `made_scenario` takes it in every process.

    ``text`` is a name, 'package.module:name', a JSON object of fields, or a file of one (room.json). Raises ValueError
    for bad JSON or an unknown name.
    """
    given = text
    if text.endswith(".json"):
        with reading(Path(text)):
            given = Path(text).read_text(encoding="utf-8")
    elif not text.lstrip().startswith("{"):
        return text if text in ASKED or ":" in text else fields_of(scenario_from(text))  # one that this process added
    try:
        if not isinstance(fields := json.loads(given), dict):
            raise ValueError(type(fields).__name__)
        return fields
    except (ValueError, RecursionError) as error:  # the latter where it is nested too deeply
        raise ValueError(f"scenario: {text[:80]!r} is no JSON object ({error})") from error


def made_scenario(scenario: Any) -> Any:
    """A scenario as an environment takes it; 'package.module:name' becomes what the module has or registers by it.

    Raises ValueError where the module has no such scenario, or fails.
    """
    if not isinstance(scenario, str) or ":" not in scenario:
        return scenario
    module, _, name = scenario.partition(":")
    try:
        found = getattr(import_module(module), name, name)
        return scenario_from(found() if callable(found) else found)
    except (Exception, SystemExit) as error:
        allowed = "'package.module:name' of a Scenario, its fields, a function that returns one, or a name that it adds"
        message = next(iter(str(error).splitlines()), "")
        raise ValueError(f"scenario: {scenario!r}: {type(error).__name__}: {message}; allowed: {allowed}") from error
