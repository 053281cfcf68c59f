"""The bounds as a picture: a panel for each scenario, a row for each policy. matplotlib is imported where it draws."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from agents.figures import grid_of_panels, save_figure
from agents.tools.statistics import estimate


def draw(results: Mapping[str, Mapping[str, Mapping[int, float]]], path: Path) -> Path:
    """Draw scenario → policy → seed → log score into `path`: each room a dot, medians with their intervals.

    The first policy is at the top of a panel, with a line at its median.
    """
    height = 1.2 + 0.34 * max(len(found) for found in results.values())
    figure, panels = grid_of_panels(len(results), 1, (7.0, height))
    for axes, (scenario, found) in zip(panels[:, 0], results.items()):
        scores = [np.array(list(of_policy.values())) for of_policy in found.values()]
        medians = [estimate(values, "median") for values in scores]
        for y, (values, median) in enumerate(zip(scores, medians)):
            axes.plot(values, np.full(len(values), y), ".", color="tab:blue", alpha=0.35, markersize=4)
            axes.plot([median.low, median.high], [y, y], color="black", linewidth=2.0)
            axes.plot(median.value, y, "d", color="black", markersize=6)
        axes.axvline(medians[0].value, color="tab:red", linewidth=0.8, linestyle="--")
        lowest, highest = min(np.quantile(values, 0.1) for values in scores), max(values.max() for values in scores)
        axes.set_xlim(lowest - 0.05 * (highest - lowest), highest + 0.05 * (highest - lowest))
        axes.set_yticks(range(len(found)), list(found), fontsize=8)
        axes.invert_yaxis()
        axes.set(title=scenario, xlabel="log score gained, bits (dots: rooms; diamonds: medians, with intervals)")
    return save_figure(figure, path)
