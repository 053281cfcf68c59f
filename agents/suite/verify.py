"""`python -m agents verify`: replay an entry, and compare every score.

It shows that the scores are those of the policy. That the policy keeps the rules, a reader of its code has to see.
"""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from activeslam_gym.config import IMAGE_SCENARIOS
from activeslam_gym.evaluation import Store, outcome
from activeslam_gym.evaluation.code import package_versions, processor
from agents import policies
from agents.suite import entry as entries
from agents.suite.entry import Entry
from agents.suite.manifest import Suite, suite
from agents.task import Task, check, play_until_interrupted, step_once
from agents.tools.arguments import Workers
from agents.tools.machine import machine
from agents.tools.sections import in_a_line

TOLERANCE = 1e-5  # relative, and absolute [bit]: that of the recorded runs
IMAGE_SHARE = 0.1  # of the image episodes is replayed
MOST_SHOWN = 10  # differences that are shown one by one


@dataclass(frozen=True, kw_only=True)
class Args(Workers):
    """Replay an entry's point episodes, and a tenth of its image episodes, and compare every score."""

    entry: Annotated[Path, tyro.conf.Positional] = Path("entry.json")
    """The file entry.json, with weights or modules beside it."""
    suite: str = ""
    """Manifest of the suite (NAME.json), if it is your own."""
    out: Path = Path("results/verified")
    """Folder in which replayed episodes are kept, so that the command can be resumed."""


def main(args: Args) -> int:
    """Verify; the exit status: 0, 1 where something differs, 130 when interrupted. Raises ValueError as `read` does."""
    entry = entries.read(args.entry)
    of = suite(args.suite or entry.suite)
    names = [_beside(name, args.entry.parent) for name in entry.policies]
    sys.path.append(str(args.entry.parent.resolve()))  # the entrant's modules do not take the place of others
    if wrong := _of_another_suite(entry, of) or _changed(entry, names):
        _say(*wrong, f"{args.entry}: differs; nothing was replayed.")
        return 1
    if own := list(filter(policies.holds_code, names)):
        _say(f"This runs the entrant's code: {', '.join(own)}.")
    environments = [of.environment(one) for one in of.scenarios]
    check(names, environments)
    chosen = _chosen(entry, of, names)
    step_once(names, environments, next(iter(chosen)).seed)
    runs = play_until_interrupted(list(chosen), Store(args.out, args.workers))
    places = {(task.policy, task.settings, task.seed): place for task, place in chosen.items()}
    differences = []
    for run in runs:
        scenario, policy, index = places[run.policy, run.settings, run.seed]
        row, kept, lost = outcome(run), entry.gains(scenario)[policy, index], entry.lost[scenario][policy][index]
        same = np.isclose(row["log_score_gain"], kept, rtol=TOLERANCE, atol=TOLERANCE)
        if not same or row["lost"] != lost:
            now = f"{row['log_score_gain']:.6f}, lost {row['lost']}"
            where = f"{scenario}, {entry.policies[policy]}, episode {index}"
            differences.append(f"{where}: {kept:.6f}, lost {lost}; replayed: {now}")
    more = [f"… and {len(differences) - MOST_SHOWN} more."] if len(differences) > MOST_SHOWN else []
    done = f"{len(runs)} of {len(of.scenarios) * len(names) * entry.episodes} episodes replayed"
    verdict = f"{done}, {len(differences)} with other scores: the entry {'differs' if differences else 'holds'}."
    if len(runs) < len(chosen):
        verdict = f"{done}. Run the same command to continue."
    _say(*differences[:MOST_SHOWN], *more, verdict)
    return 130 if len(runs) < len(chosen) else int(bool(differences))


def _say(*lines: str) -> None:
    """Print the lines; no text of an entry can make another line."""
    print("\n".join(map(in_a_line, lines)), flush=True)


def _beside(name: str, folder: Path) -> str:
    """A policy's name; of weights, their path in the entry's folder.

    Raises:
        ValueError: they are not there.
    """
    if not name.endswith(policies.FILES):
        return name
    path = folder / Path(name).name
    if not path.is_file():
        raise ValueError(f"policies: {name!r} is not in {str(folder)!r}; allowed: an entry with its weights beside it")
    return str(path)


def _of_another_suite(entry: Entry, of: Suite) -> list[str]:
    """The lines in which the entry differs from its suite."""
    pairs = {"manifest": of.digest, "commit": of.commit, "behaviour": of.behaviour}
    found = [
        f"{name}: {getattr(entry, name)!r}; the suite {of.name!r} has {value!r}"
        for name, value in pairs.items()
        if getattr(entry, name) != value
    ]
    if tuple(entry.scores) != of.scenarios:
        found.append(f"scenarios: {', '.join(entry.scores)}; the suite has {', '.join(of.scenarios)}")
    if entry.episodes > of.episodes:
        found.append(f"episodes: {entry.episodes}; the suite has {of.episodes}")
    return found


def _changed(entry: Entry, names: list[str]) -> list[str]:
    """The policies and costs that are not those of the files here. Of other versions a line is printed."""
    versions = package_versions(entries.VERSIONS)
    others = [
        f"{one} {entry.versions.get(one)} → {now}" for one, now in versions.items() if entry.versions.get(one) != now
    ]
    if not entry.machine.startswith(f"{processor()}, "):
        others.append(f"{entry.machine} → {machine()}")
    if others:
        _say(f"Not as on the entrant's machine: {', '.join(others)}.")
    pairs = zip(entry.policies, entry.contents, map(policies.content, names))
    wrong = [f"{name}: its files are not the entry's ({kept} → {now})" for name, kept, now in pairs if kept != now]
    weights = [name for name in names if name.endswith(".npz")]
    if list(entry.training) != [entries.cost_of(name) for name in weights]:
        wrong.append("training: not that of the weights' cards")
    return wrong


def _chosen(entry: Entry, of: Suite, names: list[str]) -> dict[Task, tuple[str, int, int]]:
    """The episodes to replay, each with its place in the entry: scenario, policy, index."""
    shape = len(of.scenarios), len(names), entry.episodes
    tasks = np.reshape(np.array(entries.tasks(names, of, entry.episodes), dtype=object), shape)
    rng, chosen = np.random.default_rng(), {}  # other episodes each time: an entrant cannot know them
    for s, policy in np.ndindex(*shape[:2]):
        scenario = of.scenarios[s]
        count = shape[2] if scenario not in IMAGE_SCENARIOS else max(1, round(IMAGE_SHARE * shape[2]))
        for index in np.sort(rng.permutation(shape[2])[:count]).tolist():
            chosen[tasks[s, policy, index]] = (scenario, policy, index)
    return chosen
