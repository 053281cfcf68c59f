"""Play every condition in every room, and keep the rows of a condition once it is complete."""

import json
from collections.abc import Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from agents.episode import Episode
from agents.policies import content
from agents.study.conditions import Condition
from agents.study.measures import VERSION, measures
from agents.study.observer import Notes, Observer
from agents.study.places import Placed
from agents.task import make_environment, run_policy
from agents.tools.files import reading, write_json
from agents.tools.machine import sources
from agents.tools.parallel import run_all

Row = dict[str, Any]

CURVES = ("log2_det_camera", "log2_det_map", "log2_det_total")
"""What is kept over time, at whole seconds."""


class Run(NamedTuple):
    """One run."""

    condition: Condition
    seed: int


class Rows(dict[tuple[str, str], list[Row]]):
    """(choice, policy) → a row for each room, by seed."""

    duration = 35.0
    """Of the simulation [s]: the paper's, or shorter for a quick look."""


def play(run: Run) -> tuple[Episode, Notes]:
    """Play one episode, in whichever process."""
    condition, observer = run.condition, Observer()
    env = make_environment(condition.environment())
    if condition.place:
        env = Placed(env, condition.place)
    named = condition.policy, condition.settings()
    return run_policy(condition.source, env, run.seed, *named, [observer.look]), observer.notes


def row_of(run: Run) -> Row:
    """The numbers of one run."""
    episode, notes = play(run)
    row = measures(episode, notes)
    if run.condition.curves:
        thin = episode.thinned()
        row["curve_time"] = thin.times.tolist()
        row |= {f"curve_{name}": getattr(thin, name).tolist() for name in CURVES}
    return row


def run_conditions(plan: Mapping[Condition, Sequence[int]], folder: Path, jobs: int) -> Rows:
    """The rows of every condition in its rooms, by their seeds; those that `folder` holds for the same among them.

    Conditions with equal settings are run once, in the rooms of the first of them, which must be in no fewer rooms
    than the others. Ctrl-C keeps the complete ones.
    """
    rows, missing = Rows(), []
    by_settings: dict[str, Condition] = {}
    for one, seeds in plan.items():
        if by_settings.setdefault(one.settings(), one) is one:
            if kept := _kept(one, seeds, folder):
                rows[one.choice, one.policy] = kept
            else:
                missing.append(one)
    tasks = [Run(one, seed) for one in missing for seed in plan[one]]
    gathered: dict[Condition, list[Row]] = {one: [] for one in missing}
    with closing(run_all(row_of, tasks, jobs)) as finished:
        for (one, _), row in finished:
            gathered[one].append(row)
            if len(gathered[one]) == len(plan[one]):
                rows[one.choice, one.policy] = _keep(one, gathered[one], plan[one], folder)
    for one, seeds in plan.items():
        first = by_settings[one.settings()]
        rows[one.choice, one.policy] = [row for row in rows[first.choice, first.policy] if row["seed"] in seeds]
    return rows


def _path(condition: Condition, folder: Path) -> Path:
    return folder / "runs" / f"{condition.name}.json"


def _key(condition: Condition, seeds: Sequence[int]) -> dict[str, Any]:
    """What rows must share to be those of a condition."""
    made = {"version": VERSION, "sources": sources(), "content": content(condition.source)}
    return made | {"settings": condition.settings(), "seeds": list(seeds), "curves": condition.curves}


def _keep(condition: Condition, rows: list[Row], seeds: Sequence[int], folder: Path) -> list[Row]:
    ordered = sorted(rows, key=lambda row: row["seed"])
    write_json(_path(condition, folder), {**_key(condition, seeds), "rows": ordered})
    return ordered


def _kept(condition: Condition, seeds: Sequence[int], folder: Path) -> list[Row] | None:
    """The rows of an earlier run with the same settings in the same rooms; null is NaN again."""
    path = _path(condition, folder)
    if not path.exists():
        return None
    try:
        with reading(path):
            kept = json.loads(path.read_text(encoding="utf-8"))
            if any(kept.get(name) != value for name, value in _key(condition, seeds).items()):
                return None
            return [{key: np.nan if value is None else value for key, value in row.items()} for row in kept["rows"]]
    except ValueError as damaged:
        print(f"Run again: {damaged}")
        return None
