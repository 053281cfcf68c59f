"""Studies: each file makes a published page or table, from a list of episodes and a measure of them."""

import argparse
import contextlib
import json
import shlex
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from activeslam_gym.config import scenario_from
from activeslam_gym.evaluation import Episode, Measure, Store
from agents.policies import holds_code
from agents.task import Task, check, results, step_once
from agents.tools.arguments import SEEDS, made_scenario, scenario_argument
from agents.tools.files import writable_folder
from agents.tools.sections import page_with, provenance, put_section
from agents.tools.statistics import Estimate, bootstrap_interval

BATCH, CLUSTER_BATCH = 100, 10  # episodes at a time, in this process and in one of a cluster
NO_NUMBER = ("--jobs", "--cluster", "--out", "--report")  # options that decide no number
Name = TypeVar("Name")


def parser(name: str, description: str | None, section: str = "", **defaults: Any) -> argparse.ArgumentParser:
    """The arguments that studies share: ``policies``, ``rooms`` and ``seed`` with these defaults, and where it goes.

    ``section``: of a page, which ``--report`` names.
    """
    made = argparse.ArgumentParser(
        prog=f"python -m studies.{name}", description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    made.set_defaults(report=None)
    if "policies" in defaults:
        made.add_argument("--policies", nargs="+", default=defaults["policies"])
    made.add_argument(
        "--episodes", "--rooms", dest="rooms", metavar="N", type=number(1, 10**6), default=defaults["rooms"]
    )
    made.add_argument("--seed", type=number(*SEEDS), default=defaults["seed"], help="of the first episode")
    made.add_argument("--jobs", type=number(1, 4096), default=1, help="processes")
    message = "address of a cluster of Ray that plays in their place, such as 'auto'"
    made.add_argument("--cluster", dest="jobs", metavar="ADDRESS", default=argparse.SUPPRESS, help=message)
    made.add_argument("--out", type=folder, help="folder of the episodes, which are then not played again")
    if section:
        message = f"a page whose generated section {section!r} is made"
        made.add_argument("--report", type=partial(page_with_section, section), help=message)
    return made


def number(low: float, high: float, kind: Callable[[str], float] = int) -> Callable[[str], float]:
    """The type of an argument between bounds."""

    def read(text: str) -> float:
        with contextlib.suppress(ValueError):
            if low <= kind(text) <= high:
                return kind(text)
        raise argparse.ArgumentTypeError(f"{text!r}; allowed: {low:g} to {high:g}")

    return read


SECONDS = number(1.0, 36_000.0, float)  # of an episode


def folder(text: str) -> Path:
    """The type of an argument that names a folder to write to."""
    try:
        writable_folder("out", Path(text))
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error
    return Path(text)


def page_with_section(section: str, text: str) -> Path:
    """The type of an argument that names a page with a generated ``section``."""
    try:
        page_with(Path(text), section)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error
    return Path(text)


def settings_of(scenario: str, arguments: dict[str, Any] | None = None, **fields: Any) -> str:
    """A scenario, by name or as JSON, with other ``fields``, and ``arguments`` of its environment: as tasks have it."""
    made = scenario_from(made_scenario(scenario_argument(scenario)))
    return json.dumps({"scenario": asdict(replace(made, **fields)), **(arguments or {})}, sort_keys=True)


def tasks(policy: str, settings: str, seed: int, rooms: int, *measures: type[Measure]) -> list[Task]:
    """A task for each episode from ``seed`` on."""
    return [Task(policy, one, settings, measures=measures) for one in range(seed, seed + rooms)]


def played(
    groups: dict[Name, list[Task]], out: Path | None, batch: int = BATCH, jobs: int | str = 1
) -> dict[Name, list[Episode]]:
    """The episodes of groups of tasks, kept or played now, as a batch where policy and environment are the same.

    Raises ValueError for an unknown policy or a bad argument of an environment, before any episode.
    """
    every = list(dict.fromkeys(task for group in groups.values() for task in group))
    names, environments = ({getattr(task, part) for task in every} for part in ("policy", "settings"))
    check(sorted(names), list(map(json.loads, environments)))
    step_once([name for name in names if holds_code(name)], [json.loads(every[0].settings)], every[0].seed)
    batch = min(batch, CLUSTER_BATCH) if isinstance(jobs, str) else batch
    found = dict(results(every, Store(out, jobs), batch))
    return {name: [found[task] for task in group] for name, group in groups.items()}


def mean(values: np.ndarray) -> Estimate:
    """The mean over episodes without NaN, with the bootstrap's interval, which does not know of rare failures."""
    known = values[~np.isnan(values)]
    value = float(known.mean()) if len(known) else np.nan
    return Estimate(value, *bootstrap_interval(known, lambda drawn: drawn.mean(axis=1)), len(known), "mean")


def command_line(name: str, arguments: Sequence[str] | None) -> str:
    """The command, without the options that decide no number."""
    kept, skipped = ["python", "-m", f"studies.{name}"], False
    for one in sys.argv[1:] if arguments is None else arguments:
        skipped = one in NO_NUMBER if one.startswith("--") else skipped
        kept += [] if skipped else [one]
    return shlex.join(kept)


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
        print(f"{Path(sys.argv[0]).stem}: {error}", file=sys.stderr)
        sys.exit(2)
