"""Play every condition in every room, and keep the rows of a condition once it is complete."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from agents import policies
from agents.compare import make_environment
from agents.evaluate import Episode, run_episode
from agents.files import write_json
from agents.machine import sources
from agents.parallel import run_all
from agents.study.conditions import Condition
from agents.study.measures import VERSION, measures
from agents.study.observer import Notes, Observer
from agents.study.places import Placed

Row = dict[str, Any]

CURVES = ("log2_det_camera", "log2_det_map", "log2_det_total")
"""What is kept over time, at whole seconds."""


@dataclass(frozen=True)
class Task:
    """One run."""

    condition: Condition
    seed: int


class Rows(dict[tuple[str, str], list[Row]]):
    """(choice, policy) → a row for each room, by seed."""

    duration = 35.0
    """Of the simulation [s]: the paper's, or shorter for a quick look."""


def play(task: Task) -> tuple[Episode, Notes]:
    """Run one episode, in whichever process."""
    condition = task.condition
    env = make_environment({"scenario": condition.scenario_fields(), "duration": condition.duration})
    watched = Observer(Placed(env, condition.place) if condition.place else env)
    policy = policies.resolve(condition.source, watched, task.seed)
    episode = run_episode(watched, policy, task.seed, condition.policy, condition.settings())
    watched.close()
    return episode, watched.notes


def row_of(task: Task) -> Row:
    """The numbers of one run."""
    episode, notes = play(task)
    row = measures(episode, notes)
    if task.condition.curves:
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
            kept = _kept(one, seeds, folder)
            if kept is None:
                missing.append(one)
            else:
                rows[one.choice, one.policy] = kept
    tasks = [Task(one, seed) for one in missing for seed in plan[one]]
    gathered: dict[Condition, list[Row]] = {one: [] for one in missing}
    with closing(run_all(row_of, tasks, jobs)) as finished:
        for task, row in finished:
            condition = task.condition
            gathered[condition].append(row)
            if len(gathered[condition]) == len(plan[condition]):
                rows[condition.choice, condition.policy] = _keep(
                    condition, gathered[condition], plan[condition], folder
                )
    for one, seeds in plan.items():
        first = by_settings[one.settings()]
        rows[one.choice, one.policy] = [row for row in rows[first.choice, first.policy] if row["seed"] in seeds]
    return rows


def rehearse(conditions: Sequence[Condition], seed: int) -> None:
    """A second of every source in this process, so that the kernels are compiled once, before processes start."""
    for one in {one.source: one for one in conditions}.values():
        play(Task(replace(one, duration=1.0), seed))


def _path(condition: Condition, folder: Path) -> Path:
    return folder / "runs" / f"{condition.name}.json"


def _key(condition: Condition, seeds: Sequence[int]) -> dict[str, Any]:
    """What rows must share to be those of a condition."""
    names = {"version": VERSION, "sources": sources(), "settings": condition.settings()}
    return {**names, "seeds": list(seeds), "curves": condition.curves}


def _keep(condition: Condition, rows: list[Row], seeds: Sequence[int], folder: Path) -> list[Row]:
    ordered = sorted(rows, key=lambda row: row["seed"])
    contents = {**_key(condition, seeds), "rows": ordered}
    write_json(_path(condition, folder), contents)
    return ordered


def _kept(condition: Condition, seeds: Sequence[int], folder: Path) -> list[Row] | None:
    """The rows of an earlier run with the same settings in the same rooms; null is NaN again."""
    path = _path(condition, folder)
    if not path.exists():
        return None
    contents = json.loads(path.read_text(encoding="utf-8"))
    if any(contents.get(name) != value for name, value in _key(condition, seeds).items()):
        return None
    return [{key: np.nan if value is None else value for key, value in row.items()} for row in contents["rows"]]
