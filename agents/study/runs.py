"""Play every condition in every room, and take the numbers of every episode."""

from collections.abc import Mapping, Sequence
from typing import Any

from activeslam_gym.evaluation import Episode, Store
from agents.study.conditions import Condition
from agents.study.measures import Observer
from agents.task import Task, results

Row = dict[str, Any]

CURVES = ("log2_det_camera", "log2_det_map", "log2_det_total")
"""What a row has over time, at whole seconds."""


class Rows(dict[tuple[str, str], list[Row]]):
    """(choice, policy) → a row for each room, by seed."""

    duration = 35.0
    """Of the simulation [s]: the paper's, or shorter for a quick look."""


def task_of(condition: Condition, seed: int) -> Task:
    """The episode of a condition in a room."""
    return Task(condition.source, seed, condition.settings(), measures=(Observer,))


def run_conditions(plan: Mapping[Condition, Sequence[int]], store: Store, jobs: int) -> Rows:
    """The rows of every condition in its rooms, by their seeds. Conditions with equal settings share episodes."""
    tasks = dict.fromkeys(task_of(one, seed) for one, seeds in plan.items() for seed in seeds)
    found = {task: row_of(episode) for task, episode in results(list(tasks), store, jobs)}
    return Rows(
        {(one.choice, one.policy): [found[task_of(one, seed)] for seed in sorted(seeds)] for one, seeds in plan.items()}
    )


def row_of(episode: Episode) -> Row:
    """The numbers of an episode, and its curves."""
    row = {name: value.tolist() for name, value in episode.notes.items()} | {"curve_time": episode.times.tolist()}
    return row | {f"curve_{name}": getattr(episode, name).tolist() for name in CURVES}
