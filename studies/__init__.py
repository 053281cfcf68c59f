"""Studies: each file makes a published page or table, from a list of episodes and a measure of them."""

import json
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from activeslam_gym.config import scenario_from
from activeslam_gym.evaluation import Episode, Measure, Store
from agents.task import Task, check, results
from agents.tools.arguments import SEEDS, Workers, made_scenario, scenario_argument, within
from agents.tools.files import writable_folder
from agents.tools.sections import page_with, provenance, put_section
from agents.tools.statistics import Estimate, bootstrap_interval

BATCH = 20  # episodes at a time
Name = TypeVar("Name")


@dataclass(frozen=True, kw_only=True)
class Study(Workers):
    """The arguments that studies share."""

    section = ""
    """Of the page that ``report`` names."""
    episodes: int = 100
    """Episodes of each policy."""
    seed: int = 1_000_000
    """Seed of the first episode."""
    jobs: int = 1
    """Number of processes."""
    out: Path | None = None
    """Folder in which finished episodes are kept for the next time."""
    report: Path | None = None
    """Page in which the generated section is rewritten."""

    def __post_init__(self) -> None:
        super().__post_init__()
        within(self, episodes=(1, 10**6), **({} if self.seed is None else {"seed": SEEDS}))
        if self.out:
            writable_folder("out", self.out)
        if self.report:
            page_with(self.report, self.section)


def settings_of(scenario: str, arguments: dict[str, Any] | None = None, **fields: Any) -> str:
    """A scenario, by name or as JSON, with other ``fields``, and ``arguments`` of its environment: as tasks have it."""
    made = scenario_from(made_scenario(scenario_argument(scenario)))
    return json.dumps({"scenario": asdict(replace(made, **fields)), **(arguments or {})}, sort_keys=True)


def tasks(policy: str, settings: str, seed: int, count: int, *measures: type[Measure]) -> list[Task]:
    """A task for each of ``count`` episodes from ``seed`` on."""
    return [Task(policy, one, settings, measures=measures) for one in range(seed, seed + count)]


def played(groups: dict[Name, list[Task]], out: Path | None, workers: int | str = 1) -> dict[Name, list[Episode]]:
    """The episodes of groups of tasks, kept or played now, as a batch where policy and environment are the same.

    Raises ValueError for an unknown policy or a bad argument of an environment, before any episode.
    """
    every = list(dict.fromkeys(task for group in groups.values() for task in group))
    check(every)
    found = dict(results(every, Store(out, workers), BATCH))
    return {name: [found[task] for task in group] for name, group in groups.items()}


def mean(values: np.ndarray) -> Estimate:
    """The mean over episodes without NaN, with the bootstrap's interval, which does not know of rare failures."""
    known = values[~np.isnan(values)]
    value = float(known.mean()) if len(known) else np.nan
    return Estimate(value, *bootstrap_interval(known, lambda drawn: drawn.mean(axis=1)), len(known), "mean")


def publish(page: Path | None, name: str, text: str, command: str) -> None:
    """Print a text, and put it into the section ``name`` of a ``page``, under its command."""
    print(text)
    if page:
        put_section(page, name, f"{provenance(command)}\n\n{text}")


def run(main: Callable[[], None]) -> None:
    """Run a study as a command: a mistake is told in a line, with the exit status 2; Ctrl-C is 130."""
    try:
        main()
    except KeyboardInterrupt:
        sys.exit(130)
    except (ValueError, OSError, ImportError) as error:
        print(f"python -m studies.{Path(sys.argv[0]).stem}: {error}", file=sys.stderr)
        sys.exit(2)
