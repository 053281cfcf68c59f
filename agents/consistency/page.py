"""The consistency report as tables, for the terminal and in Markdown, and its picture."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import activeslam_gym
from activeslam_gym.config import Scenario
from activeslam_gym.metrics import LOST_POSITION_ERROR
from agents.consistency.calibration import BAR_TIMES, FAR, QUANTITIES, Calibration, nees_bar
from agents.figures import grid_of_panels, legend_below, save_figure
from agents.tools.sections import Table, listed
from agents.tools.statistics import FEW_ROOMS, LEGEND, Column

COLOURS = ("tab:blue", "tab:orange", "tab:green", "tab:purple")
LIMITS = (0.1, 30.0)  # NEES per degree of freedom that is shown

DEPTH = (
    Column("depth error, mean", "mean", digits=2),
    Column("depth error, std", "std", digits=2),
    Column("depth error, far", f"beyond {FAR:g} σ, %", scale=100.0, digits=2),
)
LABELS = (
    Column("wrong associations", "wrong associations, %", scale=100.0, digits=3),
    Column("duplicates", "duplicates, %", scale=100.0),
    Column("lost", "lost, %", scale=100.0),
    Column("log score gain", "log score, bits"),
)
MEASURED = f"""\
- NEES: eᵀ P⁻¹ e over its 3 degrees of freedom, of the position, of the orientation, and the mean over the mapped \
features that stand for a true landmark (the oldest of each landmark). Averages and medians are over all runs, lost \
ones too, which go on; a landmark NEES exists where something is mapped.
- χ²: 95 % bounds of the average over so many independent runs if the filter is consistent. For landmarks a run's map \
counts as 3 degrees of freedom, as if its features shared one error: the widest that the bounds can be.
- Depth error: at the frame in which a feature becomes a point, after the update and the conversion. Along the line of \
sight m from the feature's anchor to the estimated point: the true distance between landmark and camera minus the \
estimated one, over the filter's standard deviation of it, mᵀ (P_yy − P_yp − P_py + P_pp) m. The landmark is that of \
the detection that initialised the feature; features without one are left out. Mean and standard deviation of the \
errors of all runs together.
- Wrong associations: matches of a fiducial with anything else, or of a feature with anything but the landmark that \
initialised it (all, if that was clutter), among all matches but initialisations, all runs together.
- Duplicates: features that at some frame had their landmark in common with an older feature of the map, among all \
that stood for a landmark, all runs together.
- Lost: a true position error over {LOST_POSITION_ERROR} m, or a covariance that is not positive definite, at some time.
- Log score: log₂ N(truth | belief), end minus start, median over all runs, lost ones too."""


def text(calibrations: Sequence[Calibration], times: Sequence[float]) -> str:
    """The tables in aligned plain text."""
    return "\n\n".join([*(table.aligned() for table in tables(calibrations, times)), _verdict(calibrations)])


def markdown(calibrations: Sequence[Calibration], times: Sequence[float], settings: dict[str, Any]) -> str:
    """The same in Markdown, with the settings and the definitions."""
    parts = [f"## {table.title}\n\n{table.markdown()}" for table in tables(calibrations, times)]
    head = f"# Consistency\n\n{_settings(settings)}\n\n![NEES over time](nees.png)"
    return "\n\n".join([head, *parts, "## Bars", _verdict(calibrations), "## What is measured", MEASURED]) + "\n"


def tables(calibrations: Sequence[Calibration], times: Sequence[float]) -> list[Table]:
    """The NEES at each time, then the rest."""
    found = [_nees_table(calibrations, f"{time:g}") for time in times]
    for title, columns, counted in (
        ("Standardised depth error at conversion", DEPTH, {"errors": "depth_errors", "conversions": "conversions"}),
        ("Associations, duplicates, lost runs and log score", LABELS, {"runs": "runs"}),
    ):
        header = ["strategy, initialiser", *(column.title for column in columns), *counted]
        rows = []
        for one in calibrations:
            cells = [one.figures[column.key].text(column.scale, column.digits) for column in columns]
            counts = one.counts | {"runs": one.runs}
            rows.append([one.name, *cells, *(str(counts[name]) for name in counted.values())])
        found.append(Table(title, header, rows))
    return found


def _nees_table(calibrations: Sequence[Calibration], time: str) -> Table:
    header = ["strategy, initialiser", *(title for quantity in QUANTITIES for title in (quantity, "median", "χ²"))]
    rows = []
    for one in calibrations:
        cells = [one.name]
        for name in (f"NEES of {quantity} at {time} s" for quantity in QUANTITIES):
            low, high = one.chi2_bounds[name]
            cells += [one.figures[name].text(), one.figures[f"median {name}"].text(), f"{low:.2f}–{high:.2f}"]
        rows.append([*cells, str(one.figures[f"NEES of position at {time} s"].figure.rooms)])
    return Table(f"Average NEES per degree of freedom at {time} s", [*header, "runs"], rows)


def _verdict(calibrations: Sequence[Calibration]) -> str:
    """How many bars are met, and which are not; then the limits of the figures."""
    lines = []
    for one in calibrations:
        judged = {name: found for name, found in one.figures.items() if found.met is not None}
        missed = [f"{name} ({found.figure.value:.3g})" for name, found in judged.items() if not found.met]
        line = f"{one.name}: {len(judged) - len(missed)} of {len(judged)} bars met"
        lines.append(f"- {line}{'; not met: ' + ', '.join(missed) if missed else ''}")
    notes = [LEGEND, f"The default initialiser is {Scenario().initialisation}: the bars are meant for it."]
    if (runs := min(one.runs for one in calibrations)) < FEW_ROOMS:
        notes.append(f"From {runs} room(s): fewer than {FEW_ROOMS} give a hint, no finding.")
    return "\n\n".join(["\n".join(lines), *notes])


def _settings(settings: dict[str, Any]) -> str:
    seed, last = settings["seed"], settings["seed"] + settings["episodes"] - 1
    run = f"Scenario `{settings['scenario']}`, {settings['duration']:g} s, rooms {seed} … {last}, unknown association"
    complete = "" if settings["complete"] else " Interrupted: not all rooms are in."
    return f"{run}. activeslam_gym {activeslam_gym.__version__}, {listed(settings['versions'])}.{complete}"


def draw(calibrations: Sequence[Calibration], path: Path) -> Path:
    """A row for each quantity, a column for each strategy, a colour for each initialiser; the path of the picture.

    Lines: the average over the runs alive (dashed: the median). Bands in colour: χ² bounds of the average. Grey: the
    bars, at their times.
    """
    strategies = list(dict.fromkeys(one.strategy for one in calibrations))
    colours = dict(zip(dict.fromkeys(one.initialisation for one in calibrations), COLOURS))
    figure, grid = grid_of_panels(len(QUANTITIES), len(strategies), (3.4, 2.5), sharex=True, sharey=True)
    for row, quantity in zip(grid, QUANTITIES):
        for axes, strategy in zip(row, strategies):
            for one in (one for one in calibrations if one.strategy == strategy):
                _curves(axes, one, quantity, colours[one.initialisation])
            axes.axhline(1.0, color="black", linewidth=0.5)  # where a filter is consistent
            for time in BAR_TIMES:
                if bar := nees_bar(strategy, time):
                    axes.vlines(time, max(bar.low, LIMITS[0]), bar.high, color="grey", alpha=0.5, linewidth=4.0)
            axes.set(yscale="log", ylim=LIMITS)
        row[0].set_ylabel(f"NEES of {quantity}")
    for top, bottom, strategy in zip(grid[0], grid[-1], strategies):
        top.set_title(strategy)
        bottom.set_xlabel("time, s")
    legend_below(figure, grid[0, :1])
    title = "NEES per degree of freedom over the runs alive: average, median (dashed), 95 % χ² band, bars (grey)"
    figure.suptitle(title)
    return save_figure(figure, path)


def _curves(axes: Any, one: Calibration, quantity: str, colour: str) -> None:
    """Average, median and bounds of one strategy with one initialiser."""
    curve = one.curves[quantity]
    axes.fill_between(curve["time"], curve["low"], curve["high"], color=colour, alpha=0.2, linewidth=0)
    axes.plot(curve["time"], curve["mean"], color=colour, linewidth=1.3, label=one.initialisation)
    axes.plot(curve["time"], curve["median"], "--", color=colour, linewidth=0.8)
