"""Studies: each file makes a published page or table, from a list of episodes and a measure of them."""

import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

from activeslam_gym.config import benchmark_seed, fields_of
from activeslam_gym.evaluation import Episode, Store
from agents.learn.recipe import scenario_of, trained_scenario
from agents.task import Task, check, results
from agents.tools.arguments import SEEDS, Pages, Workers, command_line, within
from agents.tools.files import writable_folder
from agents.tools.sections import publish

BATCH = 20  # episodes at a time
Name = TypeVar("Name")


@dataclass(frozen=True, kw_only=True)
class Command:
    """A study's command."""

    section = ""
    """The study's name, and the section of the page."""

    @classmethod
    def command(cls) -> str:
        """The module to run."""
        return f"studies.{cls.section}"


@dataclass(frozen=True, kw_only=True)
class Page(Command, Pages):
    """Where a study's text goes."""

    def __post_init__(self) -> None:
        self.check_pages(self.section)

    def publish(self, text: str) -> None:
        """Print a text, and put it into the pages, under its command."""
        print(text)
        publish(self.report, self.section, text, command_line(self.command(), self))


@dataclass(frozen=True, kw_only=True)
class Study(Page, Workers):
    """The arguments that studies share."""

    episodes: int = 100
    """Episodes of each policy."""
    jobs: int = 1
    """Number of processes."""
    out: Path | None = None
    """Folder in which finished episodes are kept for the next time."""

    def __post_init__(self) -> None:
        Page.__post_init__(self)
        Workers.__post_init__(self)
        within(self, episodes=(1, 10**6), seed=SEEDS)
        if self.out:
            writable_folder("out", self.out)

    def played(self, groups: dict[Name, list[Task]], batch: int = BATCH) -> dict[Name, list[Episode]]:
        """The episodes of groups of tasks, kept or played now, ``batch`` together of the same policy and environment.

        Raises ValueError for an unknown policy or a bad argument of an environment, before any episode.
        """
        every = list(dict.fromkeys(task for group in groups.values() for task in group))
        check(every)
        found = dict(results(every, Store(self.out, self.workers), batch))
        return {name: [found[task] for task in group] for name, group in groups.items()}

    def in_validation(self, scenario: str, policies: Sequence[str], end_when_lost: bool) -> dict[str, list[Episode]]:
        """Of each policy the first validation episodes of a scenario, as it is trained in."""
        sensor, first = trained_scenario(scenario).sensor, benchmark_seed(scenario, validation=True)
        settings = settings_of(scenario, {"end_when_lost": end_when_lost}, sensor=sensor)
        groups = {policy: tasks(policy, settings, first, self.episodes) for policy in policies}
        return self.played(groups, 1 if end_when_lost else BATCH)  # episodes of a batch end together


def settings_of(scenario: str, arguments: dict[str, Any] | None = None, **fields: Any) -> str:
    """A scenario, by name or as JSON, with other ``fields``, and ``arguments`` of its environment: as tasks have it."""
    made = replace(scenario_of(scenario), **fields)
    return json.dumps({"scenario": fields_of(made), **(arguments or {})}, sort_keys=True)


def tasks(policy: str, settings: str, seed: int, count: int, *measures: type[Any]) -> list[Task]:
    """A task for each of ``count`` episodes from ``seed`` on."""
    return [Task(policy, one, settings, measures=measures) for one in range(seed, seed + count)]


P = TypeVar("P", bound=Command)


def run(args: type[P], main: Callable[[P], None], arguments: Sequence[str] | None = None) -> None:
    """Read the command line and run a study; a mistake is reported in a line, with the exit status 2; Ctrl-C is 130."""
    name = f"python -m {args.command()}"
    try:
        import tyro

        main(tyro.cli(args, prog=name, args=arguments))
    except KeyboardInterrupt:
        sys.exit(130)
    except (ValueError, OSError, ImportError) as error:
        hint = "; pip install --editable '.[compare]'" if getattr(error, "name", None) == "tyro" else ""
        print(f"{name}: {error}{hint}", file=sys.stderr)
        sys.exit(2)
