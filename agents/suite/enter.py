"""`python -m agents enter`: play a suite and write the entry."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from activeslam_gym.evaluation import Store
from agents import policies, pretrained
from agents.learn.card import read_card
from agents.suite import entry as entries
from agents.suite.manifest import Suite, suite
from agents.task import check, play_until_interrupted, step_once
from agents.tools.arguments import Workers, given, within
from agents.tools.files import alone_in, writable_folder, write_json


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
    """Folder in which NAME/entry.json is written and finished episodes are kept for the next time."""

    def __post_init__(self) -> None:
        super().__post_init__()
        within(self, **({} if self.episodes is None else {"episodes": (1, 10**6)}))
        given(self, "name", "policies")
        entries.check_name(self.name)
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
        environments = [of.environment(one) for one in of.scenarios]
        check(names, environments)
        path = folder / entries.FILE
        if kept := entries.finished(path, args.name, names, of, count):
            write_json(path, asdict(replace(kept, note=args.note)))
            print(f"{path} is of this BEHAVIOUR and these policies already. To play it again, delete it.")
            return 0
        wanted = entries.tasks(names, of, count)
        step_once(names, environments, wanted[0].seed)
        print(f"{len(names)} policies, {len(of.scenarios)} scenarios, {count} episodes each: {len(wanted)} episodes.")
        episodes = play_until_interrupted(wanted, Store(args.out / entries.EPISODES, args.workers))
        if len(episodes) < len(wanted):
            print("Run the same command to continue.")
            return 130
        found = {(one.policy, one.settings, one.seed): one for one in episodes}
        runs = [found[task.policy, task.settings, task.seed] for task in wanted]
        write_json(path, asdict(entries.made(args.name, names, of, args.note, runs)))
    print(f"Written to {path}. Check it: python -m agents verify {path}")
    return 0


def _check_policies(args: Args, of: Suite) -> None:
    """Raise ValueError unless they are one policy, or several of a learner."""
    kinds = {"file" if policies.file_of(one) else "own" if ":" in one else "baseline" for one in args.policies}
    contents = [policies.content(one) for one in args.policies if policies.file_of(one)]
    if len(kinds) > 1 or (kinds == {"baseline"} and len(args.policies) > 1):
        raise ValueError(f"policies: {' '.join(args.policies)}; allowed: one, or those of one learner's training seeds")
    if len(set(args.policies)) < len(args.policies) or len(set(contents)) < len(contents):
        raise ValueError(f"policies: {' '.join(args.policies)}: two are the same; allowed: each training seed once")
    if kinds != {"baseline"} and len(args.policies) < of.training_seeds:
        print(f"{len(args.policies)} of {of.training_seeds} training seeds; the leaderboard says so of a learner.")


def _beside(names: Sequence[str], folder: Path) -> list[str]:
    """The policies' names; of files, those of their copies in the entry's folder, of weights with their cards."""
    beside, files = list(names), []
    for i, name in enumerate(names):  # all are read before any is written: they may lie in that folder
        if path := policies.file_of(name):
            beside[i] = str(folder / f"policy-{i}{path.suffix}")
            files.append((Path(beside[i]), path.read_bytes(), read_card(path) if pretrained.path_of(name) else None))
    for copy, content, card in files:
        copy.write_bytes(content)
        if card is not None:
            write_json(copy.with_suffix(".json"), card)
    return beside
