"""`python -m agents verify`: replay an entry, and compare every score.

It shows that the scores are those of the policy. That the policy keeps the rules, a reader of its code has to see.
"""

import sys
from dataclasses import dataclass
from pathlib import Path
from random import sample
from typing import Annotated

import numpy as np
import tyro

from activeslam_gym.config import IMAGE_SCENARIOS
from activeslam_gym.evaluation import Store, row_of
from activeslam_gym.evaluation.code import machine, package_versions, processor
from agents import policies
from agents.suite import enter
from agents.suite.enter import Entry
from agents.suite.manifest import Suite, suite
from agents.task import check, collect
from agents.tools.arguments import Workers
from agents.tools.sections import in_a_line

TOLERANCE = 1e-5  # relative, and absolute [bit]: that of the recorded runs
IMAGE_SHARE = 0.1  # of the image episodes is replayed, others each time: an entrant cannot know them


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
    entry = enter.read(args.entry)
    of = suite(args.suite or entry.suite)
    names = [_beside(name, args.entry.parent) for name in entry.policies]
    sys.path.append(str(args.entry.parent.resolve()))  # the entrant's modules do not take the place of others
    _tell_of_other_versions(entry)
    if wrong := _differs(entry, of, names):
        _say(*wrong, f"{args.entry}: differs; nothing was replayed.")
        return 1
    if own := list(filter(policies.holds_code, names)):
        _say(f"This runs the entrant's code: {', '.join(own)}.")
    some = sample(range(entry.episodes), max(1, round(IMAGE_SHARE * entry.episodes)))
    places = enter.tasks(names, of, entry.episodes).items()
    chosen = {task: at for task, at in places if at[0] not in IMAGE_SCENARIOS or at[2] in some}
    check(chosen)
    runs = collect(list(chosen), Store(args.out, args.workers))
    differences = []
    for task, run in runs.items():
        scenario, policy, index = chosen[task]
        row, kept, lost = row_of(run), entry.gains(scenario)[policy, index], entry.lost[scenario][policy][index]
        same = np.isclose(row["log_score_gain"], kept, rtol=TOLERANCE, atol=TOLERANCE)
        if not same or row["lost"] != lost:
            now = f"{row['log_score_gain']:.6f}, lost {row['lost']}"
            where = f"{scenario}, {entry.policies[policy]}, episode {index}"
            differences.append(f"{where}: {kept:.6f}, lost {lost}; replayed: {now}")
    done = f"{len(runs)} of {len(of.scenarios) * len(names) * entry.episodes} episodes replayed"
    verdict = f"{done}, {len(differences)} with other scores: the entry {'differs' if differences else 'holds'}."
    if len(runs) < len(chosen):
        verdict = f"{done}. Run the same command to continue."
    _say(*differences, verdict)
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


def _differs(entry: Entry, of: Suite, names: list[str]) -> list[str]:
    """The lines in which the entry differs from its suite and from the files beside it."""
    expected = enter.decisive(entry.name, names, of) | {"scenarios": of.scenarios}
    expected["training"] = tuple(map(enter.cost_of, (name for name in names if name.endswith(".npz"))))
    stated = vars(entry) | {"scenarios": tuple(entry.scores)}
    found = [f"{name}: {stated[name]}; allowed: {value}" for name, value in expected.items() if stated[name] != value]
    return found + ([f"episodes: {entry.episodes}; allowed: {of.episodes}"] if entry.episodes > of.episodes else [])


def _tell_of_other_versions(entry: Entry) -> None:
    """Print what is not as on the entrant's machine."""
    versions = package_versions(enter.VERSIONS)
    others = [
        f"{one} {entry.versions.get(one)} → {now}" for one, now in versions.items() if entry.versions.get(one) != now
    ]
    if not entry.machine.startswith(f"{processor()}, "):
        others.append(f"{entry.machine} → {machine()}")
    if others:
        _say(f"Not as on the entrant's machine: {', '.join(others)}.")
