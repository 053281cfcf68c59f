"""`python -m agents generalise`: the same policies, without retraining, where they were not trained."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path

from activeslam_gym.config import SCENARIOS
from agents.compare import command
from agents.summary import ERRORS, LEARNED, Summary
from agents.tables import Table, pipes, shown, titled
from agents.task import check
from agents.tools.arguments import Rooms, command_line, first_room
from agents.tools.files import write_json, write_text
from agents.tools.sections import provenance, put_section
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


SHARES = "Share of the best policy's median log score gain"


@dataclass(frozen=True)
class Args(Rooms):
    """Run policies where they were not trained: denser and larger rooms, clutter, other noise; write one table."""

    policies: tuple[str, ...] = ("ppo", "ppo-mixed", "orbit", "mi-constant", "mi-fisher", "sweep")
    """Names of policies, as for compare."""
    episodes: int = 50
    """Rooms for each policy and condition."""
    out: Path = Path("results/generalise")
    """Folder of the results; what it holds of the same rooms is not run again."""
    scenarios: tuple[str, ...] = ()
    """Named scenarios in place of the conditions, each in rooms of its own: `seed` counts from its first, and
    1 000 000 is that one."""
    report: tuple[Path, ...] = ()
    """Markdown files whose generated section "generalise" is made anew, for instance RESULTS.md."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if unknown := [name for name in self.scenarios if name not in SCENARIOS]:
            raise ValueError(f"scenarios: {', '.join(unknown)}; allowed: {', '.join(SCENARIOS)}")

    @property
    def conditions(self) -> dict[str, str]:
        """Name → scenario."""
        return {name: name for name in self.scenarios} or CONDITIONS


def main(args: Args) -> int:
    """Run the command; the exit status, 130 when interrupted. Raises ValueError for a bad argument."""
    comparisons = {name: _comparison(args, name, scenario) for name, scenario in args.conditions.items()}
    check(args.policies, [one.environment for one in comparisons.values()])
    args.prepare("generalise")
    if (summaries := command.compare_each(comparisons)) is None:
        return 130
    text = f"{pipes(table(summaries))}\n\n{LEGEND}\n\n{SHARES}:\n\n{pipes(shares(summaries))}"
    write_text(args.out / "generalise.md", text + "\n")
    write_json(args.out / "generalise.json", {name: asdict(summary) for name, summary in summaries.items()})
    for page in args.report:
        put_section(page, "generalise", f"{provenance(command_line('generalise', args))}\n\n{text}")
    print(f"\n{text}\n\nWritten to {args.out}/")
    return 0


def table(summaries: dict[str, Summary]) -> Table:
    """A row for each condition and policy."""
    columns = (*LEARNED, *ERRORS[:2])
    rows = [
        [condition, policy, *shown(figures, columns)]
        for condition, summary in summaries.items()
        for policy, figures in summary.policies.items()
    ]
    first = next(iter(next(iter(summaries.values())).policies.values()))
    header = ["condition", "policy", *(titled(column, first[column.key]) for column in columns)]
    return Table("Where they were not trained", header, rows)


def shares(summaries: dict[str, Summary]) -> Table:
    """Policies × conditions: the median log score gain over that of the best; a dash where the best has none."""
    rows: dict[str, list[str]] = {}
    for summary in summaries.values():
        medians = {policy: figures["log_score_gain_median"].value for policy, figures in summary.policies.items()}
        best = max(medians.values())
        for policy, median in medians.items():
            rows.setdefault(policy, [policy]).append(f"{median / best:.2f}" if best > 0 else MISSING)
    return Table(SHARES, ["policy", *summaries], list(rows.values()))


def _comparison(args: Args, name: str, scenario: str) -> command.Args:
    """The comparison in one condition, which leaves its own page, summary.md, in a folder of its own."""
    same = {key: getattr(args, key) for key in ("policies", "episodes", "jobs")}
    seed = first_room(name, args.seed) if name in args.scenarios else args.seed
    out = args.out / name.replace(" ", "-")
    store = args.store or args.out / "episodes"
    return command.Args(**same, seed=seed, out=out, store=store, scenario=scenario, resume=True, figures=False)
