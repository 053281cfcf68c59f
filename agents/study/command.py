"""`python -m agents study`: run everything, judge every claim, draw the figures and write the page."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

from activeslam_gym.evaluation import Episode
from activeslam_gym.evaluation.code import LIBRARIES
from agents.study import drawing, page
from agents.study.claims import findings_of
from agents.study.conditions import (
    DEFAULT,
    LIVE,
    LIVE_CHOICES,
    STRATEGIES,
    Condition,
    Row,
    Rows,
    conditions,
    run_conditions,
)
from agents.study.verdicts import Finding
from agents.task import check, rehearse, results
from agents.tools.arguments import Figures, Rooms, command_line, within
from agents.tools.files import alone_in, write_csv, write_json, write_text
from agents.tools.machine import machine, versions

RULE = (
    "the simulation's room {room} has the median of the log score gained by the three strategies together, among the "
    "rooms in which none of them was lost; each live run has the median of its own."
)


@dataclass(frozen=True, kw_only=True)
class Args(Rooms, Figures):
    """The paper's study: its figures redrawn from our runs, and a verdict on each of its claims."""

    episodes: int = 100
    """Rooms for the paper's strategies and for single claims."""
    choice_episodes: int = 50
    """Rooms, the first of these, for the other choices that the paper leaves open."""
    out: Path = Path("results/figures")
    duration: float | None = None
    """Seconds of an episode, for a quick look; the paper's if not given."""

    def __post_init__(self) -> None:
        super().__post_init__()
        within(self, choice_episodes=(1, 10**6))

    def plan(self) -> dict[Condition, Sequence[int]]:
        """Condition → the seeds of its rooms."""
        todo = [one if self.duration is None else replace(one, duration=self.duration) for one in conditions()]
        return {one: self.seeds if one.every_room else self.seeds[: self.choice_episodes] for one in todo}


class Study(NamedTuple):
    """The results."""

    rows: Rows
    findings: list[Finding]
    drawn: dict[str, Episode]  # strategy, or choice of the live system → its run in the chosen room, whole
    settings: dict[str, Any]


def main(args: Args) -> int:
    """Make the study and print its verdicts; the exit status, 130 when interrupted."""
    args.prepare()
    plan = args.plan()
    check((), [one.environment() for one in plan])
    print(f"{args.episodes} rooms, {len(plan)} conditions.")
    try:
        with alone_in(args.out):
            study = run(args)
            write(study, args)
    except KeyboardInterrupt:
        print("Interrupted; the episodes that are over are kept, and the same command goes on from them.")
        return 130
    for finding in study.findings:
        print(f"{finding.verdict:>13}  {finding.claim}, {finding.choice}: {finding.measure}: {finding.text}")
    print(f"\nWritten to {args.out}/: STUDY.md, study.json, study.csv, rows.csv, images/study/, trajectories/")
    return 0


def run(args: Args) -> Study:
    """Run what is missing, judge, and run the chosen rooms once more, whole, to be drawn."""
    plan = args.plan()
    for one in {one.source: one for one in plan}.values():
        rehearse([one.source], [one.environment()], args.seed)
    rows = run_conditions(plan, args.episode_store, args.jobs)
    rows.duration = args.duration or rows.duration
    room = median_room(*(rows[DEFAULT, name] for name in STRATEGIES))
    drawn = {(DEFAULT, name): room for name in STRATEGIES}
    drawn |= {(choice, LIVE): median_room(rows[choice, LIVE]) for choice in LIVE_CHOICES}
    conditions = {(one.choice, one.policy): one for one in plan}
    tasks = {pair: replace(conditions[pair].task(seed), whole=True) for pair, seed in drawn.items()}
    whole = dict(results(list(tasks.values()), args.episode_store, args.jobs))
    named = {policy if choice == DEFAULT else choice: whole[task] for (choice, policy), task in tasks.items()}
    settings = {
        "command": command_line("study", args),
        **{name: getattr(args, name) for name in ("episodes", "seed", "duration")},
        "chosen": RULE.format(room=room),
        "choice_episodes": min(args.choice_episodes, args.episodes),
        "machine": machine(),
        "versions": versions(LIBRARIES),
    }
    return Study(rows, findings_of(rows), named, settings)


def median_room(*together: Sequence[Row]) -> int:
    """Seed of the room with the median log score of one or several strategies, where none was lost (if any)."""
    rooms = list(zip(*together, strict=True))
    alive = [runs for runs in rooms if not any(run["lost"] for run in runs)]
    scored = sorted((sum(run["log_score_gain"] for run in runs), runs[0]["seed"]) for runs in alive or rooms)
    return scored[len(scored) // 2][1]


def write(study: Study, args: Args) -> None:
    """Everything into `args.out`; the page links its pictures as it will in docs/."""
    findings = [asdict(finding) | {"text": finding.text} for finding in study.findings]
    write_json(args.out / "study.json", {"settings": study.settings, "findings": findings})
    names = ("claim", "choice", "measure", "verdict", "scale", "note")
    flat = [{name: one[name] for name in names} | one["estimate"] for one in findings]
    write_csv(args.out / "study.csv", flat)
    named = [{"choice": pair[0], "policy": pair[1], **row} for pair, rows in study.rows.items() for row in rows]
    write_csv(args.out / "rows.csv", [{k: v for k, v in row.items() if not isinstance(v, list)} for row in named])
    for name, episode in study.drawn.items():
        episode.write_trajectories(args.out / "trajectories", name)
    if args.drawn:
        drawing.draw_all(study.rows, study.findings, study.drawn, args.out / "images" / "study")
    write_text(args.out / "STUDY.md", page.markdown(study.rows, study.findings, study.settings))
