"""Compare policies in the same held-out episodes: table, CSV, JSON and figures."""

import json
from dataclasses import asdict, dataclass, replace
from importlib.util import find_spec
from pathlib import Path

from activeslam_gym.evaluation import Episode, Store, row_of
from activeslam_gym.evaluation.code import LIBRARIES, package_versions
from agents.figures import FIGURES, save_figure
from agents.summary import Summary, grouped, headline, markdown, summarise, text
from agents.task import Task, check, collect, file_name
from agents.tools.arguments import SEEDS, Pages, Times, Workers, command_line, given, within
from agents.tools.files import alone_in, writable_folder, write_csv, write_json, write_text
from agents.tools.sections import publish, put_section


@dataclass(frozen=True, kw_only=True)
class Args(Workers, Times, Pages):
    """Compare policies in the same held-out episodes; write a table, CSV, JSON and figures."""

    policies: tuple[str, ...] = ("mi-constant", "mi-mi", "mi-fisher", "sweep")
    """Policies: names, weight files (.npz), models of Stable-Baselines3 (.zip) or 'package.module:policy'."""
    episodes: int = 8
    """Episodes of each policy in each scenario."""
    seed: int = 1_000_000
    """Seed of the first episode; the others follow it."""
    out: Path = Path("results/compare")
    """Folder of the results."""
    scenario: tuple[str, ...] = ("paper",)
    """Scenarios: names, fields as JSON ('{"pixel_std": 4.0}'), files of such JSON or 'package.module:name'."""
    reference: str = "mi-fisher"
    """Policy against which paired differences are taken, beside the one with the highest log score."""
    resume: bool = False
    """Reuse stored episodes of the same settings, code and policies, except those of a factory."""
    figures: bool = True
    """Draw figures, which needs matplotlib."""

    def __post_init__(self) -> None:
        super().__post_init__()
        within(self, episodes=(1, 10**6), seed=SEEDS)
        given(self, "policies", "scenario")
        if len(self.scenario) > 1 and self.report:
            raise ValueError(f"report: given with {len(self.scenario)} scenarios; allowed: with one")
        if self.reference not in {*self.names, Args.reference}:
            raise ValueError(f"reference: {self.reference!r} is not compared; allowed: {', '.join(self.names)}")

    @property
    def names(self) -> tuple[str, ...]:
        """The policies, each once."""
        return tuple(dict.fromkeys(self.policies))

    @property
    def draws(self) -> bool:
        """Whether figures are wanted, and can be drawn."""
        return self.figures and find_spec("matplotlib") is not None

    def tasks(self) -> list[Task]:
        """Seed by seed, so that an interrupted comparison has the same episodes of every policy."""
        settings = json.dumps(self.environment(self.scenario[0]), sort_keys=True)
        seeds = range(self.seed, self.seed + self.episodes)
        return [Task(name, seed, settings, whole=seed == self.seed) for seed in seeds for name in self.names]


def main(args: Args) -> int:
    """Compare in each scenario, and print; the exit status, 130 when interrupted.

    Raises ValueError for an unknown policy or a bad argument, before any episode; for episodes that fail, at the end.
    """
    names = list(dict.fromkeys(args.scenario))
    parts = [replace(args, scenario=(one,), out=args.out / file_name(one)) for one in names] if names[1:] else [args]
    args.check_pages("compare", "headline")
    writable_folder("out", args.out)
    check(task for part in parts for task in part.tasks())
    failed: dict[str, Exception] = {}
    for part in parts:
        print(f"{part.scenario[0]}: {', '.join(part.names)}; {part.episodes} episodes each.", flush=True)
        try:
            summary = compare(part)
        except (ValueError, ChildProcessError) as error:  # reported when the other scenarios are over
            failed[part.scenario[0]] = error
            continue
        if summary is None:
            print("Interrupted before the first episode was over: nothing to show.")
            return 130
        written = ", ".join(["episodes.csv", *(FIGURES if part.draws else ()), "summary.json", "summary.md"])
        print(f"\n{text(summary)}\n\nWritten to {part.out}/: {written}")
        print(f"All tables (errors, paired differences): {part.out}/summary.md")
        if not summary.settings["complete"]:
            return 130
    if failed:
        raise ValueError("; ".join(f"{scenario}: {error}" for scenario, error in failed.items()))
    return 0


def compare(args: Args) -> Summary | None:
    """Play what is missing in one scenario, write everything into `args.out`, and return the figures; None without any.

    Ctrl-C ends it early, with tables and figures of the episodes that are over. Raises ValueError where some episodes
    fail, after all others.
    """
    with alone_in(args.out):
        found: dict[Task, Episode] = {}
        try:
            collect(args.tasks(), Store(args.out / "episodes", args.workers), found, not args.resume)
        finally:  # where some failed, the others are written
            episodes = sorted(found.values(), key=lambda one: (args.names.index(one.policy), one.seed))
            summary = _written(episodes, args) if episodes else None
        return summary


def _written(episodes: list[Episode], args: Args) -> Summary:
    """The figures, written with everything else."""
    total = args.episodes * len(args.names)
    settings = {
        "policies": list(args.names),
        **{name: getattr(args, name) for name in ("episodes", "seed")},
        **args.environment(args.scenario[0]),
        "complete": len(episodes) == total,
        "versions": package_versions(LIBRARIES),
    }
    summary = summarise(episodes, args.reference, settings)
    if not settings["complete"]:
        summary.notes.append(f"Incomplete: {len(episodes)} of {total} episodes.")
    if args.figures and not args.draws:
        summary.notes.append("No figures: matplotlib is not installed (pip install -e '.[plot]').")
    write_csv(args.out / "episodes.csv", [row_of(one) for one in episodes])
    write_json(args.out / "summary.json", asdict(summary))
    write_text(args.out / "summary.md", markdown(summary))
    publish(args.report, "compare", markdown(summary), command_line("agents compare", args))
    for page in args.report:
        put_section(page, "headline", headline(summary))
    for name, draw in FIGURES.items():
        (args.out / name).unlink(missing_ok=True)  # that of an earlier comparison
        if args.draws:
            save_figure(draw(grouped(episodes)), args.out / name)
    return summary
