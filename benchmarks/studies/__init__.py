"""Studies: each a list of policies, scenarios and measures, and a table of their episodes."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TypeVar

from activeslam_gym.evaluation import Episode, Measure, Store
from agents.task import Task, results

SCENARIOS = ("office", "corridor", "rooms", "clusters", "corner", "sprint", "noisy", "mixed")
NEES = ("position_nees", "orientation_nees", "landmark_nees")
BATCH = 100  # episodes at a time
Name = TypeVar("Name")


def parser(name: str, what: str, policies: Sequence[str], rooms: int) -> argparse.ArgumentParser:
    """The arguments that every study has."""
    made = argparse.ArgumentParser(prog=f"python -m benchmarks.studies.{name}", description=what)
    made.add_argument("--policies", nargs="+", default=policies)
    made.add_argument("--rooms", type=int, default=rooms, help="for each policy")
    made.add_argument("--out", type=Path, help="folder of the episodes, of which none is played twice")
    return made


def tasks(policy: str, settings: str, seed: int, rooms: int, *measures: type[Measure]) -> list[Task]:
    """A task for each room from ``seed`` on."""
    return [Task(policy, one, settings, measures=measures) for one in range(seed, seed + rooms)]


def played(groups: dict[Name, list[Task]], out: Path | None, batch: int = BATCH) -> dict[Name, list[Episode]]:
    """The episodes of groups of tasks, kept or played now, as a batch where policy and environment are the same."""
    found = dict(results([task for group in groups.values() for task in group], Store(out), batch=batch))
    return {name: [found[task] for task in group] for name, group in groups.items()}
