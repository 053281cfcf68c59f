"""The study's pictures: the paper's figures 1, 2, 3 and 5 from our runs. matplotlib is imported where it draws."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from activeslam_gym import Motion
from activeslam_gym.evaluation import TARGET, Episode
from agents import figures
from agents.study import toy
from agents.study.claims import STATED
from agents.study.conditions import CHOICES, DEFAULT, LIVE, LIVE_CHOICES, STRATEGIES, Row, Rows, column
from agents.study.measures import FIRST_MINUTE
from agents.study.verdicts import HOLDS, Finding

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FOREST = {
    "faster-mi-constant": "14th landmark, s\n(iii) − (i)",
    "faster-mi-mi": "14th landmark, s\n(iii) − (ii)",
    "entropy-mi-constant-ladder_visited": "log₂|P| then, visited\n(iii) − (i)",
    "entropy-mi-mi-ladder_visited": "log₂|P| then, visited\n(iii) − (ii)",
    "orientation-mi-constant": "orientation RMS, °\n(iii) − (i)",
    "orientation-mi-mi": "orientation RMS, °\n(iii) − (ii)",
}
"""Claim → title of its panel in the picture of the sensitivities."""


def draw_all(rows: Rows, findings: Sequence[Finding], drawn: Mapping[str, Episode], folder: Path) -> None:
    """Draw every figure into `folder`; `drawn`: the whole runs of strategies and of the live system's choices.

    Raises ImportError where matplotlib is missing.
    """
    by_policy = {f"{numeral} {name}": [drawn[name]] for name, numeral in STRATEGIES.items()}
    pictures = {
        "figure1": figure_1(),
        "figure2_maps": figures.maps(by_policy),
        "figure2_entropies": figure_2_entropies(rows, drawn),
        "figure3_errors": figures.errors(by_policy),
        "figure5_live": figure_5(rows, drawn),
        "sensitivity": sensitivity(findings),
    }
    for name, figure in pictures.items():
        figures.save_figure(figure, folder / f"{name}.png", dpi=80)


def figure_1() -> Figure:
    """The toy: mutual information at every place, the moves of one step, and the best of them."""
    figure, grid = figures.grid_of_panels(1, 4, (3.3, 3.2), sharex=True, sharey=True)
    xs, ys = np.linspace(-2.2, 2.0, 57), np.linspace(-1.2, 2.2, 47)
    panels = product(toy.VIEWS.items(), toy.SHAPES.items())
    for axes, ((view, half_view), (shape, isotropic)) in zip(grid.flat, panels):
        scene = toy.Toy(isotropic=isotropic, half_view=half_view)
        bits = toy.information(scene, np.stack(np.meshgrid(xs, ys), axis=-1))
        axes.pcolormesh(xs, ys, bits, vmax=np.quantile(bits, 0.98), cmap="viridis", shading="nearest", rasterized=True)
        axes.plot(*scene.step * toy.direction(np.linspace(0, 2 * np.pi, 60)).T, color="white", linewidth=0.8)
        head = 2.2 * scene.step * toy.direction(toy.best_direction(scene))
        axes.annotate("", xy=tuple(head), xytext=(0, 0), arrowprops={"color": "white", "width": 1.0, "headwidth": 6.0})
        axes.plot(0, 0, "ws", markersize=5)
        for i, y in enumerate(scene.landmarks):
            axes.plot(*y, "o", color="tab:red", markersize=5)
            axes.annotate(str(i + 1), tuple(y), textcoords="offset points", xytext=(5, 4), color="white")
        axes.set_title(f"{view}, {shape}", fontsize=8)
        axes.set(aspect="equal", xlabel="m", xlim=(xs[0], xs[-1]), ylim=(ys[0], ys[-1]))
    figure.suptitle("Figure 1: mutual information of a move (bright: much); arrow: the best 30 cm", fontsize=10)
    return figure


def figure_2_entropies(rows: Rows, drawn: Mapping[str, Episode]) -> Figure:
    """Figure 2 d–f: log₂|P| over time in the chosen room, band over the rooms, and the paper's 14th landmark."""
    figure, grid = figures.grid_of_panels(1, len(STRATEGIES), (4.0, 3.2), sharex=True, sharey=True)
    for axes, (name, numeral) in zip(grid.flat, STRATEGIES.items()):
        episode = drawn[name]
        _entropies(axes, episode, rows[DEFAULT, name])
        axes.plot(*STATED[name], "kx", markersize=9, markeredgewidth=2, label="paper's 14th")
        if len(episode.landmark_times) >= TARGET:
            ours = episode.landmark_times[TARGET - 1], episode.landmark_log2_det[TARGET - 1]
            axes.plot(*ours, "o", mfc="none", mec="black", ms=9, label="our 14th")
        axes.set(title=f"{numeral} {name}", xlabel="time, s")
    grid[0, 0].set_ylabel("log₂|P|, unvisited counted")
    figures.legend_below(figure, grid.flat)
    rooms, drawn_room = len(rows[DEFAULT, "mi-mi"]), drawn["mi-mi"].seed
    title = f"Figure 2 d–f: room {drawn_room}; dashed, bands: mean and 10–90 % of {rooms} rooms"
    figure.suptitle(title, fontsize=10)
    return figure


def figure_5(rows: Rows, drawn: Mapping[str, Episode]) -> Figure:
    """Figure 5: the live system's entropies over the frames, and its commands of the first minute."""
    figure, grid = figures.grid_of_panels(2, len(LIVE_CHOICES), (5.4, 3.0))
    for (above, below), choice in zip(grid.T, LIVE_CHOICES):
        episode, lost = drawn[choice], 100.0 * np.mean(column(rows[choice, LIVE], "lost"))
        _entropies(above, episode, rows[choice, LIVE])
        above.set(title=f"{choice}: room {episode.seed}; {lost:.0f} % of all runs are lost", xlabel="time, s")
        _commands(below, episode)
    grid[0, 0].set_ylabel("log₂|P|, unvisited counted")
    figures.legend_below(figure, grid[0, :1])
    title = "Figure 5: entropies of the live system (dashed, band: mean and 10–90 % of the runs alive) and its commands"
    figure.suptitle(title, fontsize=10)
    return figure


def sensitivity(findings: Sequence[Finding]) -> Figure:
    """Paired differences with their intervals, under every choice."""
    figure, grid = figures.grid_of_panels(1, len(FOREST), (2.1, 3.6), sharey=True)
    names = [choice.name for choice in reversed(CHOICES)]
    for axes, (claim, title) in zip(grid.flat, FOREST.items()):
        for finding in findings:
            if finding.claim == claim and np.isfinite(finding.estimate.low):
                found, y = finding.estimate, names.index(finding.choice)
                colour = "tab:green" if finding.verdict == HOLDS else "tab:grey"
                axes.plot([found.low, found.high], [y, y], color=colour, linewidth=2)
                axes.plot(found.value, y, "o", color=colour, markersize=4)
        axes.axvline(0.0, color="black", linewidth=0.6)
        axes.set_title(title, fontsize=8)
        axes.tick_params(labelsize=7)
    grid[0, 0].set_yticks(range(len(names)), names, fontsize=8)
    figure.suptitle("Paired differences with 95 % intervals; green: the claim holds", fontsize=10)
    return figure


def _entropies(axes: Axes, episode: Episode, rows: Sequence[Row]) -> None:
    """Lines of one run, mean and bands over the rooms."""
    curves = {part: [(row["curve_time"], row[f"curve_log2_det_{part}"]) for row in rows] for part in figures.PARTS}
    figures.entropy_panel(axes, episode, {part: figures.at_common_times(of_part) for part, of_part in curves.items()})


def _commands(axes: Axes, episode: Episode) -> None:
    """The commands over the first minute, as the paper draws them."""
    read = np.flatnonzero(episode.motion_read & (episode.times[:-1] < FIRST_MINUTE))
    if episode.lost:
        axes.set_title("lost: its commands until then", fontsize=9, color=figures.LOST)
    axes.step(episode.times[read], episode.actions[read, 0], where="post", color="tab:blue", linewidth=1.0)
    axes.set_yticks(range(len(Motion)), [motion.name for motion in Motion], fontsize=7)
    axes.set(xlabel="time, s", xlim=(0.0, FIRST_MINUTE), ylim=(-0.5, len(Motion) - 0.5))
