"""`python -m agents consistency`: whether the filter is consistent, for every strategy with both initialisers."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from activeslam_gym.config import INITIALISATIONS, scenario_from
from activeslam_gym.evaluation import Episode, honesty, outcome
from activeslam_gym.evaluation.code import LIBRARIES, package_versions
from agents.consistency import page
from agents.consistency.calibration import Calibration, calibrate, initialisation_of
from agents.consistency.witness import Witness
from agents.task import Task, check, play_until_interrupted, rehearse
from agents.tools.arguments import Figures, Pages, Rooms, given, made_scenario, scenario_argument, times_within
from agents.tools.files import alone_in, write_csv, write_json, write_text

INITIALISERS = tuple(reversed(INITIALISATIONS))  # each policy runs with both
TIMES = (5.0, 15.0, 25.0, 35.0)  # at which the NEES is read, within the duration [s]


@dataclass(frozen=True, kw_only=True)
class Args(Rooms, Pages, Figures):
    """Is the filter consistent? NEES, depth errors, associations and losses over rooms; report, CSV, JSON, figure."""

    policies: tuple[str, ...] = ("mi-constant", "mi-mi", "mi-fisher", "sweep", "random")
    """Names of policies, or 'package.module:factory' of your own, called as factory(env)."""
    episodes: int = 100
    seed: int = 2_000_000
    out: Path = Path("results/consistency")
    scenario: str = "paper"
    """The scenario, as for compare; under `clutter` only the share of lost runs has a bar."""
    duration: float = 35.0
    """Seconds of an episode."""

    def __post_init__(self) -> None:
        super().__post_init__()
        given(self, "policies")

    @property
    def told_at(self) -> list[float]:
        """Seconds at which the NEES is told."""
        return times_within(TIMES, self.duration)

    @property
    def environments(self) -> list[dict[str, Any]]:
        """Arguments of the environments: the scenario's fields, with each initialiser; a step is a frame."""
        fields = asdict(scenario_from(made_scenario(scenario_argument(self.scenario))))
        step = fields["frame_time"]
        scenarios = [{**fields, "initialisation": name} for name in INITIALISERS]
        return [{"scenario": scenario, "gaze_period": step, "duration": self.duration} for scenario in scenarios]

    def tasks(self) -> list[Task]:
        """Room by room, so that an interrupted report has seen the same rooms with everything."""
        settings = [json.dumps(arguments, sort_keys=True) for arguments in self.environments]
        rooms = ((seed, policy) for seed in self.seeds for policy in self.policies)
        return [Task(policy, seed, one, measures=(Witness,)) for seed, policy in rooms for one in settings]


def main(args: Args) -> int:
    """Make the report and print it; the exit status, 130 when interrupted. Raises ValueError for a bad argument."""
    print(f"{args.episodes * len(args.policies) * len(INITIALISERS)} episodes.")
    calibrations, complete = report(args)
    if not calibrations:
        print("Interrupted before the first episode was over: nothing to show.")
        return 130
    written = sorted(path.name for path in args.out.iterdir() if path.is_file())
    print(f"\n{page.text(calibrations, args.told_at)}\n\nWritten to {args.out}/: {', '.join(written)}")
    return 0 if complete else 130


def report(args: Args) -> tuple[list[Calibration], bool]:
    """Run everything and write it into `args.out`; the figures by policy and initialiser, and whether all is in.

    Ctrl-C ends it early, with a report of the episodes that are over. Raises ValueError for an unknown policy or a bad
    argument of the environment, before any episode.
    """
    check(args.policies, args.environments)
    args.check_pages("consistency")
    args.prepare()
    rehearse(args.policies, args.environments, args.seed)
    with alone_in(args.out):
        tasks = args.tasks()
        runs = play_until_interrupted(tasks, args.episode_store, args.jobs)
        complete, groups = len(runs) == len(tasks), grouped(runs, args)
        calibrations = [calibrate(group, args.told_at, args.scenario) for group in groups]
        if groups:
            write_csv(args.out / "runs.csv", [row(run, args.told_at) for group in groups for run in group])
            _write(calibrations, args, complete)
    return calibrations, complete


def grouped(runs: Sequence[Episode], args: Args) -> list[list[Episode]]:
    """The runs of each policy with each initialiser that has any, in the order of the arguments and by seed."""
    pairs = [(policy, initialisation) for policy in args.policies for initialisation in INITIALISERS]
    groups: dict[tuple[str, str], list[Episode]] = {pair: [] for pair in pairs}
    for run in sorted(runs, key=lambda run: run.seed):
        groups[run.policy, initialisation_of(run)].append(run)
    return [group for group in groups.values() if group]


def row(run: Episode, times: Sequence[float]) -> dict[str, Any]:
    """One line of runs.csv; a NEES is empty where the run is over or nothing is mapped."""
    whole = outcome(run)
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


def _write(calibrations: Sequence[Calibration], args: Args, complete: bool) -> None:
    """report.json, report.md and, where matplotlib is, nees.png into `args.out`; the section into the pages."""
    settings = {**asdict(args), "complete": complete, "versions": package_versions(LIBRARIES)}
    write_json(args.out / "report.json", {"settings": settings, "results": [asdict(one) for one in calibrations]})
    text = page.markdown(calibrations, args.told_at, settings)
    write_text(args.out / "report.md", text)
    args.publish("consistency", consistency=text.replace("# ", "## ").replace("(nees.png)", "(images/nees.png)"))
    pictures = [args.out / "nees.png", *(path.parent / "images" / "nees.png" for path in args.report)]
    for picture in pictures if args.drawn else ():
        page.draw(calibrations, picture)
