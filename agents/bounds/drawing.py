"""The bounds as a picture: a panel for each scenario, a row for each policy. matplotlib is imported where it draws."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from agents.figures import grid_of_panels, save_figure
from agents.tools.statistics import estimate

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PANEL = (7.0, 0.34)
"""Width of a panel, and height of a row, inches."""


def draw(results: Mapping[str, Mapping[str, Mapping[int, float]]], path: Path) -> Path:
    """Draw scenario → policy → seed → log score into `path`: each room a dot, medians with their intervals."""
    rows = max(len(found) for found in results.values())
    figure, panels = grid_of_panels(len(results), 1, (PANEL[0], 1.2 + PANEL[1] * rows))
    for axes, (scenario, found) in zip(panels[:, 0], results.items()):
        _panel(axes, scenario, found)
    return save_figure(figure, path)


def _panel(axes: Axes, scenario: str, found: Mapping[str, Mapping[int, float]]) -> None:
    """One scenario, the first policy at the top, with a line at its median."""
    names = list(found)
    for y, name in enumerate(names):
        values = np.array(list(found[name].values()))
        median = estimate(values, "median")
        axes.plot(values, np.full(len(values), y), ".", color="tab:blue", alpha=0.35, markersize=4)
        axes.plot([median.low, median.high], [y, y], color="black", linewidth=2.0)
        axes.plot(median.value, y, "d", color="black", markersize=6)
    base = float(np.median(list(found[names[0]].values())))
    axes.axvline(base, color="tab:red", linewidth=0.8, linestyle="--")
    lowest = min(np.quantile(list(runs.values()), 0.1) for runs in found.values())
    highest = max(max(runs.values()) for runs in found.values())
    axes.set_xlim(lowest - 0.05 * (highest - lowest), highest + 0.05 * (highest - lowest))
    axes.set_yticks(range(len(names)), names, fontsize=8)
    axes.invert_yaxis()
    axes.set(title=scenario, xlabel="log score gained, bits (dots: rooms; diamonds: medians, with intervals)")
