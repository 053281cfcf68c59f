"""`python -m agents verify`: play an entry again, and compare every score."""

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from activeslam_gym.evaluation import Store, outcome
from activeslam_gym.evaluation.code import package_sources
from agents import policies
from agents.suite import entry as entries
from agents.suite.entry import Entry
from agents.suite.manifest import Suite, suite
from agents.task import SIGHTED, Task, check
from agents.tools.arguments import within

TOLERANCE = 1e-5  # relative, and absolute [bit]: that of the recorded runs
IMAGE_SHARE = 0.1  # of image episodes is played again
MOST_SHOWN = 10  # differences that are told one by one


@dataclass(frozen=True, kw_only=True)
class Args:
    """Play an entry's point episodes again, and a tenth of its image episodes, and compare every score."""

    entry: Annotated[Path, tyro.conf.Positional]
    """The entry's file."""
    jobs: int = field(default_factory=lambda: os.cpu_count() or 1)
    """Processes."""

    def __post_init__(self) -> None:
        within(self, jobs=(1, 4096))


def main(args: Args) -> int:
    """Verify; the exit status: 0, 1 where something differs, 130 when interrupted. Raises ValueError as `read` does."""
    entry = entries.read(args.entry)
    of, names = suite(entry.suite), [_found(name, args.entry.parent) for name in entry.policies]
    print(f"This runs the entrant's code: {', '.join(names)}.", flush=True)
    wrong = [*_of_another_suite(entry, of), *_changed(entry, names)]
    check(names, [{"scenario": one} for one in entry.scores])
    chosen = _chosen(entry, of, names)
    runs = entries.played(list(chosen), Store(), args.jobs)
    differences = []
    for task, run in runs.items():
        scenario, policy, index = chosen[task]
        row, kept = outcome(run), entry.scores[scenario][policy][index]
        same = np.isclose(row["log_score_gain"], kept, rtol=TOLERANCE, atol=TOLERANCE)
        if not same or row["lost"] != entry.lost[scenario][policy][index]:
            told = f"{kept:.6f}, lost {entry.lost[scenario][policy][index]}"
            now = f"{row['log_score_gain']:.6f}, lost {row['lost']}"
            differences.append(f"{scenario}, {entry.policies[policy]}, episode {index}: {told}; played again: {now}")
    print("\n".join([*wrong, *differences[:MOST_SHOWN]]))
    if len(differences) > MOST_SHOWN:
        print(f"… and {len(differences) - MOST_SHOWN} more.")
    if len(runs) < len(chosen):
        print(f"Interrupted: {len(runs)} of {len(chosen)} episodes were played again.")
        return 130
    verdict = "differs" if wrong or differences else "is as it says"
    print(f"{args.entry}: {verdict}; {len(runs)} episodes played again, {len(differences)} of other scores.")
    return int(bool(wrong or differences))


def _found(name: str, folder: Path) -> str:
    """A policy's name; of weights that lie beside the entry's file, their path."""
    beside = folder / Path(name).name
    return str(beside) if name.endswith(".npz") and beside.is_file() else name


def _of_another_suite(entry: Entry, of: Suite) -> list[str]:
    """What the entry says of the suite, where the suite says something else."""
    pairs = {"manifest": of.digest, "commit": of.commit, "behaviour": of.behaviour}
    told = [
        f"{name}: {getattr(entry, name)!r}; of the suite {of.name!r}: {value!r}"
        for name, value in pairs.items()
        if getattr(entry, name) != value
    ]
    if set(entry.scores) != set(of.scenarios):
        told.append(f"scenarios: {', '.join(entry.scores)}; of the suite: {', '.join(of.scenarios)}")
    return told


def _changed(entry: Entry, names: list[str]) -> list[str]:
    """Digests that are not those of the files here. Another version of this code may still give the same scores."""
    sources = {package: package_sources(package) for package in entry.sources}
    if sources != entry.sources:
        print("The code here is not the entry's; its scores are compared with those of the code here.")
    pairs = zip(entry.policies, entry.contents, map(policies.content, names), strict=True)
    return [
        f"{name}: its files are not those of the entry ({kept} → {now})" for name, kept, now in pairs if kept != now
    ]


def _chosen(entry: Entry, of: Suite, names: list[str]) -> dict[Task, tuple[str, int, int]]:
    """The episodes to play again, each with its place in the entry: scenario, policy, index."""
    tasks = entries.tasks(names, of, entry.episodes)
    count, places = entry.episodes, {}
    for i, task in enumerate(tasks):
        scenario, policy = of.scenarios[i // (len(names) * count)], i // count % len(names)
        if scenario in entry.scores:
            places[task] = (scenario, policy, i % count)
    draw = np.random.default_rng()  # drawn anew each time: an entrant cannot know them
    return {task: place for task, place in places.items() if place[0] not in SIGHTED or draw.random() < IMAGE_SHARE}
