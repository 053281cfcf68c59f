"""Is the filter consistent? Lost episodes, wrong matches and NEES, of each policy and variant of the filter.

    python -m studies.consistency --episodes 100 --report docs/consistency.md

The variants are the default, the default with known data association, and the paper's depth particles. Every episode is
played to its end, lost or not. With ``--report`` the page has the table, its folder `images` the figure `nees.png`, and
`consistency.csv` beside it the NEES at single times.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, Literal

import numpy as np

from activeslam_gym import config
from activeslam_gym.evaluation import Episode
from agents.figures import grid_of_panels, legend_below, save_figure
from agents.summary import Aggregate, aggregate, bootstrap_interval
from agents.tools.files import write_csv
from agents.tools.sections import table
from studies import Study, run, settings_of, tasks
from studies.measures import Matches, mean_nees, nees

POLICIES = ("orbit", "mi-mi", "mi-fisher", "joint-mi", "mi-constant", "sweep", "random", "stay")
VARIANTS: dict[str, dict[str, Any]] = {
    "inverse depth": {},
    "known association": {"association": config.KNOWN},
    "depth particles": {"initialisation": config.DEPTH_PARTICLES},
}
TIMES = (5.0, 15.0, 25.0, 35.0)  # of the CSV [s]
NEES = ("position_nees", "orientation_nees", "landmark_nees")
HEADER = ("policy", "variant", "lost, %", "wrong matches, %", "NEES of the pose", "NEES of landmarks")
DRAWN = ("mi-constant", "mi-mi", "mi-fisher", "sweep")
FIGURE = """![NEES over time, a line for each variant](images/nees.png)

*Around each line: the 95 % interval of the mean over episodes. It holds 1 where the filter is consistent.*"""
Runs = Mapping[tuple[str, Any], list[Episode]]  # by policy and variant


def wrong_matches(runs: Sequence[Episode]) -> float:
    """Share of all matches that are wrong by the hidden labels."""
    wrong = sum(run.events["wrong_matches"].sum() for run in runs)
    return float(wrong / max(sum(run.notes["matches"] for run in runs), 1))


def mean(values: np.ndarray) -> Aggregate:
    """The mean over episodes without NaN, with the bootstrap's interval, which does not know of rare failures."""
    known = values[~np.isnan(values)]
    value = float(known.mean()) if len(known) else np.nan
    return Aggregate(value, *bootstrap_interval(known, lambda drawn: drawn.mean(axis=1)), len(known), "mean")


def row_of(policy: str, variant: str, runs: Sequence[Episode]) -> list[str]:
    """A row of the table; a NEES is the mean over the seconds of an episode."""
    cells = [mean(values).text(1.0, 2) for values in mean_nees(runs)]
    lost = aggregate([run.lost for run in runs], "share").text(100.0)
    return [f"`{policy}`", variant, lost, f"{100.0 * wrong_matches(runs):.3f}", *cells]


def line_of(policy: str, variant: str, runs: Sequence[Episode]) -> dict[str, Any]:
    """A line of the CSV."""
    gain = np.array([run.gain for run in runs])
    at = {time: np.abs(runs[0].times - time).argmin() for time in TIMES if time <= runs[0].times[-1]}
    return {
        **{"policy": policy, "variant": variant, "episodes": len(runs), "lost": sum(run.lost for run in runs)},
        **{"reset": int(sum(run.events["restarts"].any() for run in runs)), "wrong_matches": wrong_matches(runs)},
        **{"log_score_median": float(np.median(gain)), "log_score_under_0": int((gain < 0.0).sum())},
        **{
            f"{x}_{t:g}s": aggregate([getattr(run, x)[k] for run in runs], "mean").value
            for t, k in at.items()
            for x in NEES
        },
    }


def draw(runs: Runs, path: Path) -> None:
    """Mean NEES over time with its 95 % interval, which holds 1 where the filter is consistent.

    No band by χ² (Bar-Shalom et al. 2001, section 5.4): the mean of correlated NEES has no fixed degrees of freedom. Of
    position and orientation, ν = 18 / (3 + ‖ρ‖²), for their correlations ρ (3, 3). In simulated studies of consistent
    filters, 93 % of the intervals hold 1.
    """
    shown = [policy for policy in dict.fromkeys(policy for policy, _ in runs) if policy in DRAWN]
    figure, grid = grid_of_panels(2, max(len(shown), 1), (3.2, 2.4), sharex=True, sharey=True)
    for (policy, variant), group in ((key, group) for key, group in runs.items() if key[0] in shown):
        for name, axes, values in zip(("pose", "landmarks"), grid[:, shown.index(policy)], nees(group)):
            means = [mean(at_a_time) for at_a_time in values.T]
            figure_of = np.array([(one.value, one.low, one.high) for one in means]).T
            (line,) = axes.plot(group[0].times, figure_of[0], label=variant, linewidth=1.2)
            axes.fill_between(group[0].times, *figure_of[1:], color=line.get_color(), alpha=0.2, linewidth=0.0)
            axes.axhline(1.0, color="0.5", linewidth=0.8, zorder=0)
            axes.set(yscale="log", ylim=(0.3, 30.0), title=policy, ylabel=f"NEES of {name}", xlabel="time, s")
            axes.label_outer()
    legend_below(figure, grid[0, :1])
    save_figure(figure, path)


@dataclass(frozen=True, kw_only=True)
class Args(Study):
    """Lost episodes, wrong matches and NEES, of each policy and variant of the filter."""

    section = "consistency"
    policies: tuple[str, ...] = POLICIES
    """Policies, named as for compare."""
    seed: int = 2_000_000
    """Seed of the first episode."""
    scenario: str = "paper"
    """Scenario: a name, or fields as JSON."""
    variants: tuple[Literal["inverse depth", "known association", "depth particles"], ...] = tuple(VARIANTS)  # type: ignore
    """Variants of the filter."""


def main(args: Args) -> None:
    """Play, print the table, and regenerate the page."""
    settings = {variant: settings_of(args.scenario, **VARIANTS[variant]) for variant in args.variants}
    pairs = product(args.policies, args.variants)
    groups = {pair: tasks(pair[0], settings[pair[1]], args.seed, args.episodes, Matches) for pair in pairs}
    runs = args.played(groups)
    for page in args.report:
        draw(runs, page.parent / "images" / "nees.png")
        write_csv(page.with_name("consistency.csv"), [line_of(*key, group) for key, group in runs.items()])
    rows = [row_of(*key, group) for key, group in runs.items()]
    args.publish(f"{table(HEADER, rows)}\n\n{FIGURE}")


if __name__ == "__main__":
    run(Args, main)
