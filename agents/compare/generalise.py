"""`python -m agents generalise`: the same policies, without retraining, where they were not trained."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from activeslam_gym.config import SCENARIOS
from agents.compare import command
from agents.summary import ERRORS, LEARNED, Summary
from agents.task import check
from agents.tools.arguments import Pages, Rooms, first_room
from agents.tools.files import write_json, write_text
from agents.tools.sections import Table
from agents.tools.statistics import LEGEND, MISSING

CONDITIONS: dict[str, str] = {
    "default": "paper",
    "60 landmarks": json.dumps({"landmark_count": 60}),
    "hall": "hall",
    "clutter": "clutter",
    "1 px": json.dumps({"pixel_std": 1.0}),
    "4 px": json.dumps({"pixel_std": 4.0}),
}
"""Name → scenario: the default, a denser room, a large one, 5 % missed and 2 false detections a frame, other noise."""


@dataclass(frozen=True, kw_only=True)
class Args(Rooms, Pages):
    """Run policies where they were not trained: denser and larger rooms, clutter, other noise; write one table."""

    policies: tuple[str, ...] = ("ppo", "generalist", "orbit", "mi-constant", "mi-fisher", "sweep")
    """Names of policies, as for compare."""
    episodes: int = 50
    out: Path = Path("results/generalise")
    scenarios: tuple[str, ...] = ()
    """Named scenarios in place of the conditions, each in rooms of its own: `seed` counts from its first, and
    1 000 000 is that one."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if unknown := [name for name in self.scenarios if name not in SCENARIOS]:
            raise ValueError(f"scenarios: {', '.join(unknown)}; allowed: {', '.join(SCENARIOS)}")

    def comparisons(self) -> dict[str, command.Args]:
        """Name of each condition → its comparison."""
        conditions = {name: name for name in self.scenarios} or CONDITIONS
        seeds = {name: first_room(name, self.seed) if self.scenarios else self.seed for name in conditions}
        return {
            name: command.part_of(self, name, seeds[name], policies=self.policies, scenario=(scenario,))
            for name, scenario in conditions.items()
        }


def main(args: Args) -> int:
    """Run the command; the exit status, 130 when interrupted. Raises ValueError for a bad argument."""
    comparisons = args.comparisons()
    check(args.policies, [one.environment for one in comparisons.values()])
    args.check_pages("generalise")
    args.prepare()
    if (summaries := command.compare_each(comparisons)) is None:
        return 130
    found = shares_of_best({name: one.medians for name, one in summaries.items()})
    text = f"{table(summaries).markdown()}\n\n{LEGEND}\n\n{found.title}:\n\n{found.markdown()}"
    write_text(args.out / "generalise.md", text + "\n")
    write_json(args.out / "generalise.json", {name: asdict(summary) for name, summary in summaries.items()})
    args.publish("generalise", generalise=text)
    print(f"\n{text}\n\nWritten to {args.out}/")
    return 0


def table(summaries: dict[str, Summary]) -> Table:
    """A row for each condition and policy."""
    columns = (*LEARNED, *ERRORS[:2])
    rows = [
        [condition, policy, *(one.text(figures[one.key]) for one in columns)]
        for condition, summary in summaries.items()
        for policy, figures in summary.policies.items()
    ]
    return Table("", ["condition", "policy", *(column.heading for column in columns)], rows)


def shares_of_best(medians: Mapping[str, Mapping[str, float]]) -> Table:
    """Policies × conditions, from condition → policy → median log score: its share of the best one; a dash under 0."""
    rows: dict[str, list[str]] = {}
    for of_policy in medians.values():
        best = max(of_policy.values())
        for policy, median in of_policy.items():
            rows.setdefault(policy, [policy]).append(f"{median / best:.2f}" if best > 0 else MISSING)
    return Table("Share of the best policy's median log score gain", ["policy", *medians], list(rows.values()))
