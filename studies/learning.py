"""Learning curves: log score and failures in validation episodes against decisions, of trainings by `agents train`.

    python -m agents train --scenario office --seed 0 --out results/curves/office/ppo-0
    python -m studies.learning --folders results/curves --policies greedy-plus mi-mi generalist

Folders of a scenario that differ in the last part of their name, after "-", are seeds of one curve. Each scenario has a
panel. The policies play the validation episodes once, and stand as lines. An episode ends when it is lost, as in the
validation of `agents train`.
"""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path

import numpy as np

import baselines
from agents.figures import legend_below, save_figure, several_panels
from agents.learn.recipe import CURVE
from agents.summary import Aggregate, aggregate
from agents.tools.files import reading
from agents.tools.sections import table
from studies import Study, run

HEADER = ("scenario", "learner", "seeds", "decisions to reach the best baseline", "log score at the end", "failures, %")
Curves = Mapping[str, Mapping[str, list[np.ndarray]]]
"""By scenario and learner: of each seed (n, 3) decisions, log score [bit] and share of failures."""


def read_curves(folders: Sequence[Path]) -> Curves:
    """The curves in ``folders`` and below them. Raises ValueError where one has none."""
    curves: dict[str, dict[str, list[np.ndarray]]] = {}
    if empty := [str(folder) for folder in folders if not any(folder.rglob(CURVE))]:
        raise ValueError(f"folders: {', '.join(empty)}; allowed: those with a {CURVE} in them, of `agents train`")
    for path in sorted(path for folder in folders for path in folder.rglob(CURVE)):
        with reading(path), path.open(newline="") as file:
            rows = list(csv.DictReader(file))
        for scenario in dict.fromkeys(row["scenario"] for row in rows):
            own = [row for row in rows if row["scenario"] == scenario]
            values = [[float(row[key]) for key in ("decisions", "log_score", "failures")] for row in own]
            learner = path.parent.name.rpartition("-")[0] or path.parent.name
            curves.setdefault(scenario, {}).setdefault(learner, []).append(np.array(values))
    return curves


def rows_of(curves: Curves, policies: Mapping[str, Mapping[str, Aggregate]]) -> list[list[str]]:
    """Rows of the table: seeds in the median, and their range."""
    rows = []
    for scenario, learners in curves.items():
        computed = (one.value for name, one in policies[scenario].items() if name in baselines.names())
        best = max(computed, default=np.inf)
        for learner, seeds in learners.items():
            reached = [next((int(n) for n, score, _ in one if score >= best), None) for one in seeds]
            known = [one for one in reached if one is not None]
            when = f"{np.median(known):,.0f}" if len(known) == len(seeds) else f"{len(known)} of {len(seeds)} seeds do"
            ends, failed = (np.array([one[-1, k] for one in seeds]) for k in (1, 2))
            span = f"{np.median(ends):.0f}" + (f" [{ends.min():.0f}, {ends.max():.0f}]" if len(seeds) > 1 else "")
            rows.append([f"`{scenario}`", learner, str(len(seeds)), when, span, f"{100.0 * failed.mean():.1f}"])
    return rows


def draw(curves: Curves, policies: Mapping[str, Mapping[str, Aggregate]], path: Path) -> None:
    """A panel for each scenario, three in a row: the seeds of each learner, and the policies as lines."""
    figure, grid = several_panels(len(curves), (6.0, 3.2), 3)
    colours = {name: f"C{k}" for k, name in enumerate(dict.fromkeys(one for own in curves.values() for one in own))}
    for axes, (scenario, learners) in zip(grid, curves.items()):
        for learner, seeds in learners.items():
            for j, one in enumerate(seeds):
                axes.plot(one[:, 0], one[:, 1], color=colours[learner], linewidth=1.2, label=None if j else learner)
        for style, (policy, score) in zip(cycle(("--", ":", "-.", (0, (1, 4)))), policies[scenario].items()):
            axes.axhline(score.value, color="0.4", linestyle=style, linewidth=1.0, label=policy)
        axes.set(title=scenario, xlabel="decisions", ylabel="log score [bit], validation")
    legend_below(figure, grid[:1], 3)
    save_figure(figure, path)


@dataclass(frozen=True, kw_only=True)
class Args(Study):
    """Learning curves of trainings, beside policies in the same validation episodes."""

    folders: tuple[Path, ...]
    """Folders of `agents train`, or that hold such."""
    section = "learning"
    policies: tuple[str, ...] = ("greedy-plus", "mi-mi", "best-sequence", "generalist")
    """Policies that play the validation episodes too."""
    episodes: int = 64
    """Validation episodes of the policies."""


def main(args: Args) -> None:
    """Read the curves, play the policies, print the table and draw the figure."""
    curves = read_curves(args.folders)
    policies: dict[str, dict[str, Aggregate]] = {}
    scores = []
    for scenario in curves:
        played = args.in_validation(scenario, args.policies, True)
        policies[scenario] = {name: aggregate([one.gain for one in own], "IQM") for name, own in played.items()}
        scores += [[f"`{scenario}`", f"`{name}`", one.text(1.0, 0)] for name, one in policies[scenario].items()]
    others = table(("scenario", "policy", "log score"), scores)
    args.publish(f"{table(HEADER, rows_of(curves, policies))}\n\n{others}")
    for place in [page.parent / "images" for page in args.report] or [args.out or Path("results")]:
        draw(curves, policies, place / "learning.png")


if __name__ == "__main__":
    run(Args, main)
