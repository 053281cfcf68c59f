"""`python -m agents enter`: play a suite and write the entry.

An entry is a policy, or a learner's policies of several training seeds, with its score in every episode of a suite: a
folder of its name with ``entry.json`` and, for learned policies, their weights.
"""

import json
import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from inspect import formatannotation
from pathlib import Path
from typing import Any, get_args, get_origin

import numpy as np
from numpy.typing import NDArray

from activeslam_gym.evaluation import Episode, Store, row_of
from activeslam_gym.evaluation.code import LIBRARIES, machine, package_versions
from activeslam_gym.files import text_of
from agents import policies
from agents.learn.weights import path_of, read_card
from agents.suite.manifest import Suite, suite
from agents.task import Task, check, collect
from agents.tools.arguments import Workers, given, within
from agents.tools.files import alone_in, reading, writable_folder, write_json

FOLDER, FILE = Path(__file__).with_name("entries"), "entry.json"
EPISODES = "episodes"  # folder of the store, beside those of entries
VERSIONS = ("activeslam-gym", *LIBRARIES)
COST = ("command", "scenario", "seed", "total_steps", "seconds", "steps_trained", "seconds_trained", "machine")
"""What an entry has of the cards of its weights."""


@dataclass(frozen=True)
class Entry:
    """What is in an entry's file. P policies, one of each training seed; E episodes of each scenario."""

    name: str
    suite: str
    manifest: str  # its digest
    commit: str  # of the draw of the test seeds
    behaviour: int
    policies: tuple[str, ...]  # P names; of weights, the file beside the entry's
    contents: tuple[str, ...]  # P digests of the policies' own files
    versions: dict[str, str]  # of `VERSIONS`
    machine: str
    training: tuple[dict[str, Any], ...]  # of each learned policy, `COST`
    note: str  # what the author says of it
    scores: dict[str, list[list[float]]]  # scenario → (P, E) log score gained [bit]
    lost: dict[str, list[list[int]]]  # scenario → (P, E) 1 where the belief was lost at some time

    @property
    def episodes(self) -> int:
        """The number of episodes of each scenario."""
        return len(next(iter(self.scores.values()))[0])

    def first(self, count: int) -> "Entry":
        """With the first ``count`` episodes of each scenario alone."""
        scores = {scenario: [row[:count] for row in rows] for scenario, rows in self.scores.items()}
        lost = {scenario: [row[:count] for row in rows] for scenario, rows in self.lost.items()}
        return replace(self, scores=scores, lost=lost)

    def gains(self, scenario: str) -> NDArray[np.float64]:
        """The scores (P, E) in a scenario [bit]."""
        return np.array(self.scores[scenario])

    def failed(self, scenario: str) -> NDArray[np.bool_]:
        """(P, E): lost, or overconfident, which is a score under 0."""
        return (np.array(self.lost[scenario]) > 0) | (self.gains(scenario) < 0.0)


@dataclass(frozen=True, kw_only=True)
class Args(Workers):
    """Play the test episodes of a suite, and write the entry: its weights, and the score of every episode."""

    name: str = ""
    """Name of the entry on the leaderboard."""
    policies: tuple[str, ...] = ()
    """The policy, named as for compare, or one policy for each training seed of a learner."""
    suite: str = "development"
    """Suite: a name, or a manifest of your own (NAME.json)."""
    episodes: int | None = None
    """Episodes of each scenario, from the first on; all if not given, as the leaderboard requires."""
    note: str = ""
    """A sentence on the leaderboard about what the policy is and how it was trained."""
    out: Path = Path("results/entries")
    """Folder in which NAME/entry.json is written and finished episodes are kept. An entry in it is played again for
    another BEHAVIOUR, suite, name or weights alone: delete it after a change of code or of a baseline's table."""

    def __post_init__(self) -> None:
        super().__post_init__()
        within(self, episodes=(1, 10**6))
        given(self, "name", "policies")
        check_name(self.name)
        if not self.note.isprintable():
            raise ValueError(f"note: {self.note!r}; allowed: one line of printable text")


def main(args: Args) -> int:
    """Play and write; the exit status, 130 when interrupted. Raises ValueError for a bad argument."""
    of, folder = suite(args.suite), args.out / args.name
    count = of.played(args.episodes)
    _check_policies(args, of)
    writable_folder("out", folder)
    with alone_in(folder):
        names = _beside(args.policies, folder)
        path = folder / FILE
        if kept := finished(path, args.name, names, of, count):
            write_json(path, asdict(replace(kept, note=args.note)))
            print(f"{path} is of this BEHAVIOUR and these policies already, by their names and weights.")
            print("A change of code is not seen. To play it again, delete it.")
            return 0
        wanted = list(tasks(names, of, count))
        check(wanted)
        print(f"{len(names)} policies, {len(of.scenarios)} scenarios, {count} episodes each: {len(wanted)} episodes.")
        found = collect(wanted, Store(args.out / EPISODES, args.workers))
        if len(found) < len(wanted):
            print("Run the same command to continue.")
            return 130
        write_json(path, asdict(made(args.name, names, of, args.note, [found[task] for task in wanted])))
    print(f"Written to {path}. Check it: python -m agents verify {path}")
    return 0


def _check_policies(args: Args, of: Suite) -> None:
    """Raise ValueError unless they are one policy, or several of a learner."""
    kinds = {"file" if policies.file_of(one) else "own" if ":" in one else "baseline" for one in args.policies}
    contents = [policies.content(one) for one in args.policies if policies.file_of(one)]
    if folders := [one for one in args.policies if one.startswith("rllib:")]:
        raise ValueError(f"policies: {folders[0]!r}; allowed: files, modules or names, which an entry can hold")
    if len(kinds) > 1 or (kinds == {"baseline"} and len(args.policies) > 1):
        raise ValueError(f"policies: {' '.join(args.policies)}; allowed: one, or those of one learner's training seeds")
    if len(set(args.policies)) < len(args.policies) or len(set(contents)) < len(contents):
        raise ValueError(f"policies: {' '.join(args.policies)}: two are the same; allowed: each training seed once")
    if kinds != {"baseline"} and len(args.policies) < of.training_seeds:
        print(f"{len(args.policies)} of {of.training_seeds} training seeds; the leaderboard says so of a learner.")


def _beside(names: Sequence[str], folder: Path) -> list[str]:
    """The policies' names; of files, those of their copies in the entry's folder, with their cards."""
    beside, files = list(names), []
    for i, name in enumerate(names):  # all are read before any is written: they may lie in that folder
        if path := policies.file_of(name):
            beside[i] = str(folder / f"policy-{i}{path.suffix}")
            period = policies.period_of(name)
            card = read_card(path) if path_of(name) else {"decision_period": period} if period else None
            files.append((Path(beside[i]), path.read_bytes(), card))
    for copy, content, card in files:
        copy.write_bytes(content)
        copy.with_suffix(".json").unlink(missing_ok=True)  # of an entry before
        if card is not None:
            write_json(copy.with_suffix(".json"), card)
    return beside


def tasks(names: Sequence[str], suite: Suite, episodes: int) -> dict[Task, tuple[str, int, int]]:
    """Every episode of an entry, with its place in it: the scenario, and the numbers of policy and episode."""
    return {
        Task(policy, seed, json.dumps(suite.environment(scenario))): (scenario, i, k)
        for scenario in suite.scenarios
        for i, policy in enumerate(names)
        for k, seed in enumerate(suite.seeds(scenario, episodes))
    }


def made(name: str, names: Sequence[str], suite: Suite, note: str, runs: Sequence[Episode]) -> Entry:
    """The entry of the ``runs`` of all `tasks` of the policies ``names``, in their order.

    Raises:
        ValueError: a score is not finite.
    """
    rows = [row_of(run) for run in runs]
    if wrong := [row for row in rows if not np.isfinite(row["log_score_gain"])]:
        raise ValueError(f"policies: {wrong[0]['policy']!r}, seed {wrong[0]['seed']}: its score is not finite")

    def by_scenario(key: str) -> dict[str, Any]:
        values = np.reshape([row[key] for row in rows], (len(suite.scenarios), len(names), -1))
        return dict(zip(suite.scenarios, values.tolist()))

    return Entry(
        **decisive(name, names, suite),
        versions=package_versions(VERSIONS),
        machine=machine(),
        training=tuple(map(cost_of, filter(path_of, names))),
        note=note,
        scores=by_scenario("log_score_gain"),
        lost=by_scenario("lost"),
    )


def finished(path: Path, name: str, names: Sequence[str], suite: Suite, episodes: int) -> Entry | None:
    """The entry in the file, if it is of these policies, which hold no code, suite, ``episodes`` and `BEHAVIOUR`."""
    try:
        kept = read(path)
    except ValueError:
        return None
    is_same = kept.episodes == episodes and decisive(name, names, suite).items() <= vars(kept).items()
    return kept if is_same and not any(map(policies.holds_code, names)) else None


def decisive(name: str, names: Sequence[str], suite: Suite) -> dict[str, Any]:
    """The fields of an entry that decide its scores, but for versions and the processor."""
    return {
        "name": name,
        "suite": suite.name,
        "manifest": suite.digest,
        "commit": suite.commit,
        "behaviour": suite.behaviour,
        "policies": tuple(Path(one).name if one.endswith(policies.FILES) else one for one in names),
        "contents": tuple(map(policies.content, names)),
    }


def cost_of(policy: str) -> dict[str, Any]:
    """What the card of weights in a file says of their training."""
    card = read_card(Path(policy))
    return {name: card[name] for name in COST if name in card}


def check_name(name: str) -> None:
    """Raise ValueError for a name that no entry may have."""
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,99}", name) or name.lower() == EPISODES:
        allowed = f"100 letters, digits and, not in front, '_', '-', '.'; but not {EPISODES!r}"
        raise ValueError(f"name: {name[:200]!r}; allowed: {allowed}")


def read(path: Path) -> Entry:
    """The entry in a file.

    Raises:
        ValueError: there is none, or it is damaged: a field is missing or unknown, or what it says does not fit.
    """
    with reading(path):
        given = json.loads(text_of(path, 2**26))
        if wrong := sorted({field.name for field in fields(Entry)} ^ given.keys()):
            raise ValueError(f"missing or unknown: {', '.join(wrong)}")
        for field in fields(Entry):
            if not _is(given[field.name], field.type):
                allowed = formatannotation(field.type)
                raise ValueError(f"{field.name}: {str(given[field.name])[:80]}; allowed: {allowed}")
        values: dict[str, Any] = {name: tuple(one) if isinstance(one, list) else one for name, one in given.items()}
        entry = Entry(**values)
        check_name(entry.name)
        count, tables = len(entry.policies), [np.array(list(one.values())) for one in (entry.scores, entry.lost)]
        sizes = {one.shape for one in tables}
        if entry.scores.keys() != entry.lost.keys() or sizes != {(len(entry.scores), count, entry.episodes)}:
            raise ValueError(f"scores and lost are of {count} policies, and of the shapes {sizes}")
        if not np.isfinite(tables[0]).all() or not np.isin(tables[1], (0, 1)).all():
            raise ValueError("scores must be finite numbers, and lost 0 or 1")
        files = [one for one, name in zip(entry.contents, entry.policies) if name.endswith(policies.FILES)]
        if len(entry.contents) != count or len(set(files)) < len(files):
            raise ValueError(f"contents: {len(entry.contents)} of {count} policies, or two files are the same")
        if len(entry.training) != sum(name.endswith(".npz") for name in entry.policies):
            raise ValueError(f"training: {len(entry.training)}; allowed: one of each policy in a file of weights")
        return entry


def _is(value: Any, kind: Any) -> bool:
    """Whether a value of JSON, with all its parts, is of the type of a field."""
    if get_origin(kind) is dict:
        return isinstance(value, dict) and all(_is(part, get_args(kind)[1]) for part in value.values())
    if get_origin(kind):
        return isinstance(value, list) and all(_is(part, get_args(kind)[0]) for part in value)
    return kind is Any or (isinstance(value, (int, float) if kind is float else kind) and not isinstance(value, bool))
