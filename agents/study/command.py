"""`python -m agents study`: run everything, judge every claim, draw the figures and write the page."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from activeslam_gym.evaluation.code import LIBRARIES
from agents.study import drawing, page
from agents.study.claims import findings_of
from agents.study.conditions import DEFAULT, LIVE, LIVE_CHOICES, STRATEGIES, Condition, conditions
from agents.study.runs import Row, Rows, run_conditions, task_of
from agents.study.verdicts import Finding
from agents.task import check, rehearse, results
from agents.tools.arguments import Rooms, at_least, command_line
from agents.tools.files import alone_in, write_csv, write_json, write_text
from agents.tools.machine import machine, versions

RULE = (
    "the simulation's room {room} has the median of the log score gained by the three strategies together, among the "
    "rooms in which none of them was lost; each live run has the median of its own."
)


@dataclass(frozen=True)
class Args(Rooms):
    """The paper's study: its figures redrawn from our runs, and a verdict on each of its claims."""

    episodes: int = 100
    """Rooms for the paper's strategies and for what single claims need."""
    choice_episodes: int = 50
    """Rooms, the first of these, for the other choices that the paper leaves open."""
    out: Path = Path("results/figures")
    """Folder of the results; finished episodes that it holds are not run again."""
    duration: float | None = None
    """Seconds of an episode, for a quick look; the paper's if not given."""
    figures: bool = True
    """Draw the figures (needs matplotlib)."""

    def __post_init__(self) -> None:
        super().__post_init__()
        at_least(self, choice_episodes=1)

    def plan(self) -> dict[Condition, list[int]]:
        """What is run, and the seeds of its rooms."""
        todo = conditions()
        if self.duration is not None:
            todo = [replace(one, duration=self.duration) for one in todo]
        seeds = list(range(self.seed, self.seed + self.episodes))
        return {one: seeds if one.every_room else seeds[: self.choice_episodes] for one in todo}


@dataclass(frozen=True)
class Study:
    """What came of it."""

    rows: Rows
    findings: list[Finding]
    drawn: drawing.Drawn
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
    room = median_room(rows)
    by_key = {(one.choice, one.policy): one for one in plan}
    drawn = {name: task_of(by_key[DEFAULT, name], room) for name in STRATEGIES}
    drawn |= {choice: task_of(by_key[choice, LIVE], median_alive([rows[choice, LIVE]])) for choice in LIVE_CHOICES}
    whole = dict(results([replace(task, whole=True) for task in drawn.values()], args.episode_store, args.jobs))
    strategies, live = (
        {name: whole[replace(drawn[name], whole=True)] for name in names} for names in (STRATEGIES, LIVE_CHOICES)
    )
    return Study(rows, findings_of(rows), drawing.Drawn(strategies, live), _settings(args, room))


def median_room(rows: Rows) -> int:
    """Seed of the room with the median log score of the three strategies together, where none was lost (if any)."""
    return median_alive([rows[DEFAULT, name] for name in STRATEGIES])


def median_alive(together: Sequence[Sequence[Row]]) -> int:
    """Seed of the room with the median log score of one or several strategies, where none was lost (if any)."""
    alive = [runs for runs in zip(*together, strict=True) if not any(run["lost"] for run in runs)]
    return _median_seed(list(zip(*alive)) or together)


def _median_seed(together: Sequence[Sequence[Row]]) -> int:
    """Seed of the room in the middle of the order by the log score of one or several strategies together."""
    scored = [(sum(run["log_score_gain"] for run in runs), runs[0]["seed"]) for runs in zip(*together, strict=True)]
    return sorted(scored)[len(scored) // 2][1]


def write(study: Study, args: Args) -> None:
    """Everything into `args.out`; the page links its pictures as it will in docs/."""
    findings = [asdict(finding) | {"text": finding.text} for finding in study.findings]
    write_json(args.out / "study.json", {"settings": study.settings, "findings": findings})
    write_csv(args.out / "study.csv", [_flat(finding) for finding in study.findings])
    named = [{"choice": pair[0], "policy": pair[1], **row} for pair, rows in study.rows.items() for row in rows]
    write_csv(args.out / "rows.csv", [{k: v for k, v in row.items() if not isinstance(v, list)} for row in named])
    for name, episode in (study.drawn.strategies | study.drawn.live).items():
        episode.write_trajectories(args.out / "trajectories", name)
    if args.drawn:
        drawing.draw_all(study.rows, study.findings, study.drawn, args.out / "images" / "study")
    write_text(args.out / "STUDY.md", page.markdown(study.rows, study.findings, study.settings))


def _flat(finding: Finding) -> dict[str, Any]:
    """A line of study.csv."""
    names = ("claim", "choice", "measure", "verdict", "scale", "note")
    return {name: getattr(finding, name) for name in names} | asdict(finding.estimate)


def _settings(args: Args, room: int) -> dict[str, Any]:
    """What was run, where and with which versions, as plain values."""
    return {
        "command": command_line("study", args),
        "episodes": args.episodes,
        "seed": args.seed,
        "duration": args.duration,
        "chosen": RULE.format(room=room),
        "choice_episodes": min(args.choice_episodes, args.episodes),
        "machine": machine(),
        "versions": versions(LIBRARIES),
    }
