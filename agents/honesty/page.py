"""The consistency report as tables, for the terminal and in Markdown."""

from collections.abc import Callable, Sequence
from typing import Any

import activeslam_gym
from activeslam_gym.config import Scenario
from activeslam_gym.metrics import LOST_POSITION_ERROR
from agents.honesty.calibration import FAR, QUANTITIES, Calibration
from agents.summary import FEW_ROOMS
from agents.tables import Table, aligned, pipes
from agents.tools.sections import listed
from agents.tools.statistics import LEGEND

MEASURED = (
    "NEES: eᵀ P⁻¹ e over its 3 degrees of freedom, of the position, of the orientation, and the mean over the mapped "
    "features that stand for a true landmark (the oldest of each landmark). Averages and medians are over all runs, "
    "lost ones too, which go on; a landmark NEES exists where something is mapped.",
    "χ²: 95 % bounds of the average over so many independent runs if the filter is consistent. For landmarks a run's "
    "map counts as 3 degrees of freedom, as if its features shared one error: the widest that the bounds can be.",
    "Depth error: at the frame in which a feature becomes a point, after the update and the conversion. Along the line "
    "of sight m from the feature's anchor to the estimated point: the true distance between landmark and camera minus "
    "the estimated one, over the filter's standard deviation of it, mᵀ (P_yy − P_yp − P_py + P_pp) m. The landmark is "
    "the one that the detection of its birth was of; features without one are left out. Mean and standard deviation "
    "of the errors of all runs together.",
    "Wrong associations: matches of a fiducial with anything else, or of a feature with anything but what it was born "
    "of (all, if that was clutter), among all matches but births, all runs together.",
    "Duplicates: features that at some frame had their landmark in common with an older feature of the map, among all "
    "that stood for a landmark, all runs together.",
    f"Lost: a true position error over {LOST_POSITION_ERROR} m, or a covariance that is not positive definite, at some "
    "time.",
    "Log score: log₂ N(truth | belief), end minus start, median over all runs, lost ones too.",
)


def text(calibrations: Sequence[Calibration]) -> str:
    """The tables in aligned plain text."""
    parts = [f"{table.title}\n{aligned(table)}" for table in tables(calibrations)]
    return "\n\n".join([*parts, _verdict(calibrations), LEGEND, *_notes(calibrations)])


def markdown(calibrations: Sequence[Calibration], settings: dict[str, Any]) -> str:
    """The same in Markdown, with what was run and what is measured."""
    parts = [f"## {table.title}\n\n{pipes(table)}" for table in tables(calibrations)]
    notes = "\n".join(f"- {line}" for line in MEASURED)
    verdict = "\n\n".join((_verdict(calibrations), LEGEND, *_notes(calibrations)))
    head = f"# Consistency\n\n{_what_was_run(settings)}\n\n![NEES over time](nees.png)"
    return "\n\n".join([head, *parts, "## Bars", verdict, "## What is measured", notes]) + "\n"


def tables(calibrations: Sequence[Calibration]) -> list[Table]:
    """The NEES at each time, then the rest."""
    return [
        *(_nees_table(calibrations, time) for time in calibrations[0].nees),
        _table("Standardised depth error at conversion", DEPTH, calibrations),
        _table("Associations, duplicates, lost runs and log score", LABELS, calibrations),
    ]


def _nees_table(calibrations: Sequence[Calibration], time: str) -> Table:
    header = ["strategy, initialiser"]
    for quantity in QUANTITIES:
        header += [quantity, "median", "χ²"]
    rows = []
    for one in calibrations:
        cells = [_name(one)]
        for quantity in QUANTITIES:
            low, high = one.chi2_bounds[time][quantity]
            median = one.nees_median[time][quantity].text(digits=2)
            cells += [one.nees[time][quantity].text(), median, f"{low:.2f}–{high:.2f}"]
        rows.append([*cells, str(one.nees[time]["position"].figure.rooms)])
    return Table(f"Average NEES per degree of freedom at {time} s", [*header, "runs"], rows)


DEPTH: dict[str, Callable[[Calibration], object]] = {
    "mean": lambda one: one.depth_mean.text(),
    "std": lambda one: one.depth_std.text(),
    f"beyond {FAR:g} σ, %": lambda one: one.depth_far.text(100.0, 2),
    "errors": lambda one: one.counts["depth_errors"],
    "conversions": lambda one: one.counts["conversions"],
}
LABELS: dict[str, Callable[[Calibration], object]] = {
    "wrong associations, %": lambda one: one.wrong.text(100.0, 3),
    "duplicates, %": lambda one: one.duplicates.text(100.0),
    "lost, %": lambda one: one.lost.text(100.0, 1),
    "log score, bits": lambda one: one.log_score_gain.text(),
    "runs": lambda one: one.runs,
}
"""Title → cell, of the tables after those of the NEES."""


def _table(title: str, columns: dict[str, Callable[[Calibration], object]], rows: Sequence[Calibration]) -> Table:
    cells = [[_name(one), *(str(cell(one)) for cell in columns.values())] for one in rows]
    return Table(title, ["strategy, initialiser", *columns], cells)


def _verdict(calibrations: Sequence[Calibration]) -> str:
    """How many bars are met, and which are not."""
    lines = []
    for one in calibrations:
        judged = {name: found for name, found in one.findings.items() if found.met is not None}
        missed = [f"{name} ({found.figure.value:.3g})" for name, found in judged.items() if not found.met]
        line = f"{_name(one)}: {len(judged) - len(missed)} of {len(judged)} bars met"
        lines.append(f"- {line}{'; not met: ' + ', '.join(missed) if missed else ''}")
    return "\n".join(lines)


def _notes(calibrations: Sequence[Calibration]) -> list[str]:
    """What limits the figures."""
    notes = [f"The default initialiser is {Scenario().initialisation}: the bars are meant for it."]
    if (runs := min(one.runs for one in calibrations)) < FEW_ROOMS:
        notes.append(f"From {runs} room(s): fewer than {FEW_ROOMS} give a hint, no finding.")
    return notes


def _what_was_run(settings: dict[str, Any]) -> str:
    seed, last = settings["seed"], settings["seed"] + settings["episodes"] - 1
    run = f"Scenario `{settings['scenario']}`, {settings['duration']:g} s, rooms {seed} … {last}, unknown association"
    complete = "" if settings["complete"] else " Interrupted: not all rooms are in."
    return f"{run}. activeslam_gym {activeslam_gym.__version__}, {listed(settings['versions'])}.{complete}"


def _name(one: Calibration) -> str:
    return f"{one.strategy}, {one.initialisation}"
