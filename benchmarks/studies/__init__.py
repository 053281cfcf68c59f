"""Studies: each a list of policies, scenarios and measures, and a table of what the store has of them."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from activeslam_gym.evaluation import Episode, Store
from agents.task import Task, results

PERIOD = 0.25
"""Gaze period of the studies [s]."""
SCENARIOS = ("office", "corridor", "rooms", "clusters", "corner", "sprint", "noisy", "mixed")
NEES = ("position_nees", "orientation_nees", "landmark_nees")
BATCH = 100
"""Episodes at a time."""


def parser(name: str, what: str, policies: Sequence[str], rooms: int) -> argparse.ArgumentParser:
    """The arguments that every study has."""
    made = argparse.ArgumentParser(prog=f"python -m benchmarks.studies.{name}", description=what)
    made.add_argument("--policies", nargs="+", default=policies)
    made.add_argument("--rooms", type=int, default=rooms, help="for each policy")
    made.add_argument("--out", type=Path, help="folder of the episodes, of which none is played twice")
    return made


def episodes(tasks: Sequence[Task], out: Path | None, batch: int = BATCH) -> dict[Task, Episode]:
    """Every task with its episode, kept or played now, as a batch where policy and environment are the same."""
    return dict(results(tasks, Store(out), batch=batch))
