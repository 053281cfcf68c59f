"""Consistency report: does the filter's covariance mean what it says? Every strategy with both initialisers."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from activeslam_gym.config import INITIALISATIONS, scenario_from
from activeslam_gym.evaluation import Episode, honesty, outcome
from activeslam_gym.evaluation.code import LIBRARIES, package_versions
from agents.honesty import drawing, page
from agents.honesty.calibration import Calibration, calibrate, initialisation_of
from agents.honesty.witness import Witness
from agents.task import Task, check, play_until_interrupted, rehearse
from agents.tools.arguments import Rooms, command_line, given, times, times_within
from agents.tools.files import alone_in, write_csv, write_json, write_text, written
from agents.tools.sections import provenance, put_section


@dataclass(frozen=True)
class Args(Rooms):
    """Is the filter consistent? NEES, depth errors, associations and losses over rooms; report, CSV, JSON, figure."""

    policies: tuple[str, ...] = ("mi-constant", "mi-mi", "mi-fisher", "sweep", "random")
    """Names of policies, or 'package.module:factory' of your own, called as factory(env)."""
    initialisations: tuple[str, ...] = tuple(reversed(INITIALISATIONS))
    """Initialisers of features that each policy runs with."""
    episodes: int = 100
    """Rooms for each policy with each initialiser."""
    seed: int = field(default=2_000_000, kw_only=True)
    """Episode j is reset(seed=seed + j)."""
    out: Path = Path("results/consistency")
    """Folder of the results; finished episodes that it holds are not run again."""
    scenario: str = "paper"
    """Name of the scenario; under `clutter` only the share of lost runs has a bar."""
    duration: float = 35.0
    """Seconds of an episode."""
    times: tuple[float, ...] = (5.0, 15.0, 25.0, 35.0)
    """Seconds at which the NEES is told; those within the duration count."""
    report: tuple[Path, ...] = ()
    """Markdown files whose generated section "consistency" is made anew, for instance docs/HONESTY.md."""
    figures: bool = True
    """Draw the figure (needs matplotlib)."""

    def __post_init__(self) -> None:
        super().__post_init__()
        given(self, "policies", "initialisations")
        times(self, "times")

    @property
    def environments(self) -> list[dict[str, Any]]:
        """Arguments of the environments: the scenario's fields, with each initialiser."""
        fields = asdict(scenario_from(self.scenario))
        scenarios = [{**fields, "initialisation": name} for name in self.initialisations]
        return [{"scenario": scenario, "duration": self.duration} for scenario in scenarios]


def main(args: Args) -> int:
    """Make the report and print it; the exit status, 130 when interrupted. Raises ValueError for a bad argument."""
    total = args.episodes * len(args.policies) * len(args.initialisations)
    print(f"{total} episodes.")
    calibrations, complete = report(args)
    if not calibrations:
        print("Interrupted before the first episode was over: nothing to show.")
        return 130
    print(f"\n{page.text(calibrations)}\n\nWritten to {args.out}/: {', '.join(written(args.out))}")
    return 0 if complete else 130


def report(args: Args) -> tuple[list[Calibration], bool]:
    """Run everything and write it into `args.out`; the figures by policy and initialiser, and whether all is in.

    Ctrl-C ends it early, with a report of the episodes that are over. Raises ValueError for an unknown policy or
    initialiser or a bad argument of the environment, before any episode.
    """
    check(args.policies, args.environments)
    args.prepare("consistency")
    rehearse(args.policies, args.environments, args.seed)
    with alone_in(args.out):
        return _report(args)


def _report(args: Args) -> tuple[list[Calibration], bool]:
    tasks = _tasks(args)
    runs = play_until_interrupted(tasks, args.episode_store, args.jobs)
    told_at = times_within(args.times, args.duration)
    calibrations = [calibrate(group, told_at, args.scenario) for group in grouped(runs, args)]
    complete = len(runs) == len(tasks)
    if runs:
        _write(calibrations, runs, told_at, args, complete)
    return calibrations, complete


def grouped(runs: Sequence[Episode], args: Args) -> list[list[Episode]]:
    """The runs of each policy with each initialiser that has any, in the order of the arguments and by seed."""
    pairs = [(policy, initialisation) for policy in args.policies for initialisation in args.initialisations]
    ordered = sorted(runs, key=lambda run: run.seed)
    groups = [[run for run in ordered if (run.policy, initialisation_of(run)) == pair] for pair in pairs]
    return [group for group in groups if group]


def row(run: Episode, times: Sequence[float]) -> dict[str, Any]:
    """One line of runs.csv; NEES that no longer exist (the run is over) or not yet (nothing mapped) are empty."""
    whole = outcome(run, 1)
    kept = ("policy", "seed", "end_time", "lost", "log_score_gain", "landmarks_mapped", "distinct_landmarks")
    errors = run.notes["depth_errors"]
    return {
        **{name: whole[name] for name in kept},
        "initialisation": initialisation_of(run),
        **{f"{name}_{t:g}s": value for t in times for name, value in honesty(run, t).items()},
        **{name: int(value) for name, value in run.notes.items() if name != "depth_errors"},
        "depth_errors": len(errors),
        "depth_error_mean": float(errors.mean()) if len(errors) else float("nan"),
        "depth_error_rms": float((errors**2).mean() ** 0.5) if len(errors) else float("nan"),
    }


def _tasks(args: Args) -> list[Task]:
    """Room by room, so that an interrupted study has seen the same rooms with everything."""
    settings = [json.dumps(arguments, sort_keys=True) for arguments in args.environments]
    seeds = range(args.seed, args.seed + args.episodes)
    return [
        Task(policy, seed, one, measures=(Witness,)) for seed in seeds for policy in args.policies for one in settings
    ]


def _write(
    calibrations: Sequence[Calibration], runs: Sequence[Episode], times: Sequence[float], args: Args, complete: bool
) -> None:
    """Everything into `args.out`: runs.csv, report.json, report.md and, where matplotlib is, nees.png."""
    ordered = [run for group in grouped(runs, args) for run in group]
    write_csv(args.out / "runs.csv", [row(run, times) for run in ordered])
    plain = json.loads(json.dumps(asdict(args), default=str))
    settings = {**plain, "complete": complete, "versions": package_versions(LIBRARIES)}
    write_json(args.out / "report.json", {"settings": settings, "results": [asdict(one) for one in calibrations]})
    text = page.markdown(calibrations, settings)
    write_text(args.out / "report.md", text)
    if args.drawn:
        drawing.draw(calibrations, args.out / "nees.png")
    for path in args.report:
        section = text.replace("# ", "## ").replace("(nees.png)", "(images/nees.png)")
        put_section(path, "consistency", f"{provenance(command_line('consistency', args))}\n\n{section}")
        if args.drawn:
            drawing.draw(calibrations, path.parent / "images" / "nees.png")
