"""The picture of the consistency report: average NEES over time. matplotlib is imported where it draws."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from agents.consistency.calibration import BAR_TIMES, QUANTITIES, Calibration, nees_bar
from agents.figures import grid_of_panels, legend_below, save_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = ("tab:blue", "tab:orange", "tab:green", "tab:purple")
LIMITS = (0.1, 30.0)
"""NEES per degree of freedom that is shown."""


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


def _curves(axes: Axes, one: Calibration, quantity: str, colour: str) -> None:
    """Average, median and bounds of one strategy with one initialiser."""
    curve = one.curves[quantity]
    axes.fill_between(curve["time"], curve["low"], curve["high"], color=colour, alpha=0.2, linewidth=0)
    axes.plot(curve["time"], curve["mean"], color=colour, linewidth=1.3, label=one.initialisation)
    axes.plot(curve["time"], curve["median"], "--", color=colour, linewidth=0.8)
