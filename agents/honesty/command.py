"""Consistency report: does the filter's covariance mean what it says? Every strategy with both initialisers."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, field, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from activeslam_gym.config import INITIALISATIONS, scenario_from
from agents import consistency_tables, nees_figure
from agents import policies as policy_sources
from agents.calibration import Calibration, calibrate
from agents.compare import Task, make_environment, times_within, versions, written
from agents.files import write_csv, write_json, write_text
from agents.outcome import honesty, outcome
from agents.parallel import run_all
from agents.report import provenance, put_section
from agents.witness import WatchedRun, watch


@dataclass(frozen=True)
class Args:
    """Is the filter consistent? NEES, depth errors, associations and losses over rooms; report, CSV, JSON, figure."""

    policies: tuple[str, ...] = ("mi-constant", "mi-mi", "mi-fisher", "sweep", "random")
    """Names of policies, or 'package.module:factory' of your own, called as factory(env)."""
    initialisations: tuple[str, ...] = tuple(reversed(INITIALISATIONS))
    """Initialisers of features that each policy runs with."""
    episodes: int = 100
    """Rooms for each policy with each initialiser."""
    seed: int = 2_000_000
    """Episode j is reset(seed=seed + j)."""
    out: Path = Path("results/consistency")
    """Folder of the results."""
    scenario: str = "paper"
    """Name of the scenario; under `clutter` only the share of lost runs has a bar."""
    duration: float = 35.0
    """Seconds of an episode."""
    times: tuple[float, ...] = (5.0, 15.0, 25.0, 35.0)
    """Seconds at which the NEES is told; those within the duration count."""
    jobs: int = field(default_factory=lambda: os.cpu_count() or 1)
    """Processes."""
    report: tuple[Path, ...] = ()
    """Markdown files whose generated section "consistency" is made anew, for instance docs/HONESTY.md."""
    figures: bool = True
    """Draw the figure (needs matplotlib)."""

    def __post_init__(self) -> None:
        for name, least in (("episodes", 1), ("seed", 0), ("jobs", 1)):
            if getattr(self, name) < least:
                raise ValueError(f"{name}: {getattr(self, name)}; allowed: {least} or more")
        for name in ("policies", "initialisations"):
            if not getattr(self, name):
                raise ValueError(f"{name}: none given; allowed: one name or more")

    @property
    def command(self) -> str:
        """What runs this."""
        return f"python -m agents consistency --episodes {self.episodes} --seed {self.seed} --scenario {self.scenario}"

    def environment(self, initialisation: str) -> dict[str, Any]:
        """Arguments of the environment: the scenario's fields, with this initialiser."""
        fields = {**asdict(scenario_from(self.scenario)), "initialisation": initialisation}
        return {"scenario": fields, "duration": self.duration}


def main(args: Args) -> int:
    """Make the report and print it; the exit status: 2 for a bad argument, 130 when interrupted."""
    try:
        check(args)
    except ValueError as error:
        print(f"consistency: {error}", file=sys.stderr)
        return 2
    total = args.episodes * len(args.policies) * len(args.initialisations)
    print(f"{total} episodes. The first run compiles, which takes a while.")
    calibrations, complete = report(args)
    if not calibrations:
        print("Interrupted before the first episode was over: nothing to show.")
        return 130
    print(f"\n{consistency_tables.text(calibrations)}\n\nWritten to {args.out}/: {', '.join(written(args.out))}")
    return 0 if complete else 130


def report(args: Args) -> tuple[list[Calibration], bool]:
    """Run everything and write it into `args.out`; the figures by policy and initialiser, and whether all is in.

    Ctrl-C ends it early, with a report of the episodes that are over. Raises ValueError for an unknown policy or
    initialiser or a bad argument of the environment, before anything is run.
    """
    check(args)
    tasks = _tasks(args)
    _rehearse(args)
    runs = _run_until_interrupted(tasks, args.jobs)
    times = times_within(args.times, args.duration)
    calibrations = [calibrate(group, times, args.scenario) for group in grouped(runs, args)]
    complete = len(runs) == len(tasks)
    if runs:
        _write(calibrations, runs, times, args, complete)
    return calibrations, complete


def check(args: Args) -> None:
    """Raise ValueError for an unknown policy or initialiser, or a bad argument of the environment."""
    for name in args.policies:
        policy_sources.factory(name)
    for initialisation in args.initialisations:
        make_environment(args.environment(initialisation)).close()


def grouped(runs: Sequence[WatchedRun], args: Args) -> list[list[WatchedRun]]:
    """The runs of each policy with each initialiser that has any, in the order of the arguments and by seed."""
    pairs = [(policy, initialisation) for policy in args.policies for initialisation in args.initialisations]
    ordered = sorted(runs, key=lambda run: run.episode.seed)
    groups = [[run for run in ordered if (run.episode.policy, run.initialisation) == pair] for pair in pairs]
    return [group for group in groups if group]


def row(run: WatchedRun, times: Sequence[float]) -> dict[str, Any]:
    """One line of runs.csv; NEES that no longer exist (the run is over) or not yet (nothing mapped) are empty."""
    said, whole = run.testimony, outcome(run.episode, 1)
    kept = ("policy", "seed", "end_time", "lost", "log_score_gain", "landmarks_mapped", "distinct_landmarks")
    errors = said.depth_errors
    return {
        **{name: whole[name] for name in kept},
        "initialisation": run.initialisation,
        **{f"{name}_{t:g}s": value for t in times for name, value in honesty(run.episode, t).items()},
        **{name: value for name, value in asdict(said).items() if name != "depth_errors"},
        "depth_errors": len(errors),
        "depth_error_mean": float(errors.mean()) if len(errors) else float("nan"),
        "depth_error_rms": float((errors**2).mean() ** 0.5) if len(errors) else float("nan"),
    }


def _tasks(args: Args) -> list[Task]:
    """Room by room, so that an interrupted study has seen the same rooms with everything."""
    settings = [json.dumps(args.environment(name), sort_keys=True) for name in args.initialisations]
    seeds = range(args.seed, args.seed + args.episodes)
    return [Task(policy, seed, one, whole=False) for seed in seeds for policy in args.policies for one in settings]


def _rehearse(args: Args) -> None:
    """A second of everything in this process, so that the kernels are compiled once, before processes start."""
    for task in _tasks(replace(args, episodes=1, duration=min(args.duration, 1.0))):
        watch(task)


def _run_until_interrupted(tasks: Sequence[Task], jobs: int) -> list[WatchedRun]:
    """All runs, or those that were over at Ctrl-C."""
    runs: list[WatchedRun] = []
    try:
        with closing(run_all(watch, tasks, jobs)) as finished:
            for _, run in finished:
                runs.append(run)
    except KeyboardInterrupt:
        print("Interrupted; the report is of the episodes that are over.")
    return runs


def _write(
    calibrations: Sequence[Calibration], runs: Sequence[WatchedRun], times: Sequence[float], args: Args, complete: bool
) -> None:
    """Everything into `args.out`: runs.csv, report.json, report.md and, where matplotlib is, nees.png."""
    ordered = [run for group in grouped(runs, args) for run in group]
    write_csv(args.out / "runs.csv", [row(run, times) for run in ordered])
    settings = {
        **asdict(args),
        "out": str(args.out),
        "report": [str(page) for page in args.report],
        "complete": complete,
        "versions": versions(),
    }
    write_json(args.out / "report.json", {"settings": settings, "results": [c.as_dict() for c in calibrations]})
    text = consistency_tables.markdown(calibrations, settings)
    write_text(args.out / "report.md", text)
    drawn = args.figures and find_spec("matplotlib") is not None
    if drawn:
        nees_figure.draw(calibrations, args.out / "nees.png")
    for page in args.report:
        section = text.replace("# ", "## ").replace("(nees.png)", "(images/nees.png)")
        put_section(page, "consistency", f"{provenance(args.command)}\n\n{section}")
        if drawn:
            nees_figure.draw(calibrations, page.parent / "images" / "nees.png")
