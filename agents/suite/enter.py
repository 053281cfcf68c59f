"""`python -m agents enter`: play a suite and write the entry."""

import os
from dataclasses import dataclass, field
from pathlib import Path

from activeslam_gym.evaluation import Store
from agents import pretrained
from agents.suite import entry as entries
from agents.suite.manifest import Suite, suite
from agents.task import check, file_name
from agents.tools.arguments import given, within
from agents.tools.files import alone_in, writable_folder, write_json


@dataclass(frozen=True, kw_only=True)
class Args:
    """Play the test episodes of a suite, and write the entry: one JSON file with the score of every episode."""

    name: str
    """Of the entry, on the leaderboard."""
    policies: tuple[str, ...] = ()
    """The policy, as for compare; of a learner, the weights of every training seed."""
    suite: str = "development"
    """Name of the suite."""
    episodes: int | None = None
    """The first so many episodes of each scenario; all if not given."""
    note: str = ""
    """A sentence about it: what it is, and what it was trained on."""
    jobs: int = field(default_factory=lambda: os.cpu_count() or 1)
    """Processes."""
    out: Path = Path("results/entries")
    """Folder of the entry, NAME.json, and of its episodes: an interrupted command goes on where it was."""

    def __post_init__(self) -> None:
        given(self, "name", "policies")
        within(self, jobs=(1, 4096))
        if self.episodes is not None:
            within(self, episodes=(1, 10**6))
        if file_name(self.name) != self.name:
            raise ValueError(f"name: {self.name!r}; allowed: letters, digits, '_', '.' and '-'")


def main(args: Args) -> int:
    """Play and write; the exit status, 130 when interrupted. Raises ValueError for a bad argument."""
    of = suite(args.suite)
    count = args.episodes or of.episodes
    check(args.policies, [{"scenario": one} for one in of.scenarios])
    _check_training_seeds(args, of)
    writable_folder("out", args.out)
    wanted = entries.tasks(args.policies, of, count)
    print(
        f"{len(args.policies)} policies, {len(of.scenarios)} scenarios, {count} episodes each: {len(wanted)} episodes."
    )
    with alone_in(args.out):
        runs = entries.played(wanted, Store(args.out / "episodes"), args.jobs)
        if len(runs) < len(wanted):
            print("The same command goes on.")
            return 130
        path = args.out / f"{args.name}.json"
        write_json(path, entries.text_of(entries.made(args.name, args.policies, of, args.note, runs)))
    print(f"Written to {path}. Check it: python -m agents verify {path}")
    return 0


def _check_training_seeds(args: Args, of: Suite) -> None:
    learned = [one for one in args.policies if pretrained.path_of(one)]
    if learned and len(learned) != len(args.policies):
        raise ValueError(f"policies: {' '.join(args.policies)}; allowed: weights of one learner, or one other policy")
    if not learned and len(args.policies) > 1:
        raise ValueError(f"policies: {' '.join(args.policies)}; allowed: one, or the weights of a learner's seeds")
    if learned and len(learned) < of.training_seeds:
        print(f"From {len(learned)} training seeds; the leaderboard marks fewer than {of.training_seeds}.")
