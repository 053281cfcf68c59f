"""An entry: a policy, or a learner's policies of several training seeds, and its score in every episode of a suite."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activeslam_gym.evaluation import Episode, Store, outcome
from activeslam_gym.evaluation.code import LIBRARIES, package_sources, package_versions
from agents import policies, pretrained
from agents.suite.manifest import Suite
from agents.task import Task, play_until_interrupted
from agents.tools.files import reading
from agents.tools.machine import machine

FOLDER = Path(__file__).with_name("entries")
COST = ("command", "scenario", "seed", "steps_trained", "seconds_trained", "machine")  # of a card, what training took
PACKAGES = ("activeslam_gym", "baselines")  # whose sources decide a score, beside the policy's own


@dataclass(frozen=True)
class Entry:
    """What is in an entry's file. P policies, one of each training seed; E episodes of each scenario."""

    name: str
    suite: str
    manifest: str  # its digest
    commit: str  # of the draw of the test seeds
    behaviour: int
    policies: tuple[str, ...]  # P names; a file of weights beside the entry's file, or a path from where it was made
    contents: tuple[str, ...]  # P digests of the policies' own files
    sources: dict[str, str]  # digests of `PACKAGES`
    versions: dict[str, str]
    machine: str
    training: tuple[dict[str, Any], ...]  # of each learned policy, `COST`
    note: str  # what the author says of it
    scores: dict[str, list[list[float]]]  # scenario → (P, E) log score gained [bit]
    lost: dict[str, list[list[int]]]  # scenario → (P, E) 1 where the belief was lost at some time

    @property
    def episodes(self) -> int:
        """Of each scenario."""
        return len(next(iter(self.scores.values()))[0])

    def gains(self, scenario: str) -> NDArray[np.float64]:
        """The scores (P, E) in a scenario [bit]."""
        return np.array(self.scores[scenario])

    def failed(self, scenario: str) -> NDArray[np.bool_]:
        """(P, E): lost, or sure and wrong, which is a score under 0."""
        return (np.array(self.lost[scenario]) > 0) | (self.gains(scenario) < 0.0)


def made(name: str, names: Sequence[str], suite: Suite, note: str, runs: dict[Task, Episode]) -> Entry:
    """The entry of the ``runs``, which are of `tasks`."""
    scenarios = list(dict.fromkeys(one.settings for one in runs))
    rows = {
        settings: [
            [outcome(run) for one, run in runs.items() if (one.policy, one.settings) == (policy, settings)]
            for policy in names
        ]
        for settings in scenarios
    }
    told = {json.loads(settings)["scenario"]: row for settings, row in rows.items()}
    return Entry(
        name=name,
        suite=suite.name,
        manifest=suite.digest,
        commit=suite.commit,
        behaviour=suite.behaviour,
        policies=tuple(names),
        contents=tuple(policies.content(policy) for policy in names),
        sources={package: package_sources(package) for package in PACKAGES},
        versions=package_versions(LIBRARIES),
        machine=machine(),
        training=tuple(_cost(policy) for policy in names if pretrained.path_of(policy)),
        note=note,
        scores={one: [[row["log_score_gain"] for row in of_policy] for of_policy in row] for one, row in told.items()},
        lost={one: [[row["lost"] for row in of_policy] for of_policy in row] for one, row in told.items()},
    )


def tasks(names: Sequence[str], suite: Suite, episodes: int) -> list[Task]:
    """Every episode of an entry: by scenario, policy and index."""
    return [
        Task(policy, seed, json.dumps({"scenario": scenario}))
        for scenario in suite.scenarios
        for policy in names
        for seed in suite.seeds(scenario, episodes)
    ]


def played(wanted: Sequence[Task], store: Store, jobs: int) -> dict[Task, Episode]:
    """The tasks with their episodes, in their order; fewer where it was interrupted."""
    episodes = play_until_interrupted(wanted, store, jobs)
    found = {(one.policy, one.settings, one.seed): one for one in episodes}
    keyed = {task: (task.policy, task.settings, task.seed) for task in wanted}
    return {task: found[key] for task, key in keyed.items() if key in found}


def text_of(entry: Entry) -> dict[str, Any]:
    """As a dict for JSON."""
    return asdict(entry)


def read(path: Path) -> Entry:
    """The entry in a file.

    Raises:
        ValueError: there is none, or it is damaged: a field is missing or unknown, or its scores do not fit together.
    """
    with reading(path):
        given = json.loads(path.read_text(encoding="utf-8"))
        known = {field.name for field in fields(Entry)}
        if wrong := sorted(known ^ given.keys()):
            raise ValueError(f"missing or unknown: {', '.join(wrong)}")
        values: dict[str, Any] = {key: tuple(value) if key in TUPLES else value for key, value in given.items()}
        entry = Entry(**values)
        shapes = {np.shape(scores) for table in (entry.scores, entry.lost) for scores in table.values()}
        if entry.scores.keys() != entry.lost.keys() or shapes != {(len(entry.policies), entry.episodes)}:
            raise ValueError(f"scores and lost are of {len(entry.policies)} policies, shapes {shapes}")
        if not all(np.isfinite(entry.gains(one)).all() for one in entry.scores):
            raise ValueError("scores are not all finite")
        return entry


TUPLES = ("policies", "contents", "training")


def _cost(policy: str) -> dict[str, Any]:
    from agents.learn.card import read_card

    path = pretrained.path_of(policy)
    assert path is not None
    card = read_card(path)
    return {name: card[name] for name in COST if name in card}
