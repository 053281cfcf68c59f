"""The page of the study: its settings, the pictures, and tables of the claims with their verdicts."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from activeslam_gym.metrics import LOST_POSITION_ERROR
from agents.study.claims import CLAIMS
from agents.study.conditions import CHOICES, LIVE, SINGLES, STRATEGIES, Row, Rows, while_alive
from agents.study.verdicts import FEWEST_ROOMS, Finding, under_choices
from agents.tools.machine import code
from agents.tools.sections import listed, table
from agents.tools.statistics import Column

FIGURES = (
    Column("lost", "% lost", "share", 100.0, 0),
    Column("landmarks_mapped", "Landmarks mapped"),
    Column("log_score_gain", "Log score, bits", digits=0),
    Column("alive_rms", "Orientation RMS, ° (alive)", scale=180.0 / np.pi, digits=2),
    Column("stay_share", "`stay`, % of motions", scale=100.0, digits=0),
)
PICTURES = {
    "figure1": "Figure 1. A camera with two degrees of freedom and three landmarks (`agents/study/toy.py`).",
    "figure2_maps": "Figure 2 a–c. Final maps and trajectories, from above.",
    "figure2_entropies": "Figure 2 d–f. log₂\\|P\\| of camera, map and total.",
    "figure3_errors": "Figure 3. Errors of position and orientation with 2σ bounds.",
    "figure5_live": "Figure 5. The live system, simulated: entropies, and the commands of the first minute.",
    "sensitivity": "What the open choices do to the differences between the strategies.",
}

READING = """\
**How to read it.** Each figure is a median over the same rooms with the same noise, or a share of the rooms; a
difference is taken room by room. Intervals are exact 95 % intervals over rooms: of medians by order statistics, of
shares by Clopper and Pearson. *Holds* and *does not hold* are said only where the whole interval, of {fewest} rooms or
more, is on one side of the bound (zero for a difference); otherwise *not shown*. There are about {count} intervals
here and no correction for their number: expect a few to miss. A number that the paper states is one run's: it is
*within our spread* if it lies in the central 95 % of our rooms.

**Lost runs** (position error over {lost} m, or no positive definite covariance) are never dropped silently. The time of
the 14th landmark, or of the first loop closure, counts as the full duration where it was not seen, be the run lost or
just slow. log₂\\|P\\| at the 14th landmark is compared at the most landmarks, 14 at most, that both strategies reached
in that room. Errors and entropies at the end leave out rooms in which one of the two was lost; the note says how many.
Everything else is measured until the run's end.

**Measures.** *Visited alone*: log₂\\|P\\| of the camera and the oldest mapped landmarks, of the same dimension for both
strategies; *unvisited counted*: with the others of the 27 at their prior. A *loop closure*: a fiducial or feature is
matched again after 5 s without; its drop is the change of log₂\\|P\\| in the second from it on against that in the
second before, where that has no closure of its own. *Lateral*: right, left, up, down, as four of seven commands are by
chance. *After an initialisation / a mapping*: the command that follows a motion period in which a feature was
initialised / reached σ/depth < 0.3. `hand-held` is that scenario; `calm` is the same with 1 px of noise, ± 9° of swing,
and a filter that assumes 2 m/s² and 1 rad/s²: its detections have no appearance, by which the paper's live system
distinguishes its features."""

PIXELS = """\
## The live system, from rendered pixels

A simulated person in a rendered room, as the [live system](live.md) sees it: one who follows the advice, one who moves
at random, and one that stays. By a command of its own, `python -m agents live`, which `make figures` runs too.

<!-- generated: live-claims -->
<!-- end: live-claims -->"""
"""`agents.advising` fills it in."""


def markdown(rows: Rows, findings: Sequence[Finding], settings: dict[str, Any]) -> str:
    """The whole page."""
    return "\n\n".join(
        [
            "# The paper's study",
            f"<!-- generated: study -->\n{_settings(settings)}",
            "## Claims",
            f"{_claims_table(findings)}\n<!-- end: study -->",
            READING.format(count=round(len(findings), -1), fewest=FEWEST_ROOMS, lost=LOST_POSITION_ERROR),
            PIXELS,
            "## Pictures",
            f"Chosen by rule, not by beauty: {settings['chosen']}",
            *(f"![{caption}](images/study/{name}.png)\n\n{caption}" for name, caption in PICTURES.items()),
            "## Choices that the paper leaves open",
            table(["Choice", "What it is"], [[f"`{choice.name}`", choice.meaning] for choice in CHOICES]),
            "## Every claim under every choice",
            _sensitivity_tables(findings),
            "## Every condition",
            _conditions_table(rows),
            "",
        ]
    )


def _settings(settings: dict[str, Any]) -> str:
    rooms = f"{settings['episodes']} rooms, seeds {settings['seed']} … {settings['seed'] + settings['episodes'] - 1}"
    return (
        "The experiments of *Active Control for Single Camera SLAM* (ICRA 2006) over many rooms, beside what the paper "
        f"says.\n\nCommand: `{settings['command']}` (or `make figures`), which wrote all but section V. "
        f"{rooms}, for the paper's strategies and what single claims need; the first {settings['choice_episodes']} of "
        f"them for the other choices. {settings['machine']}; {listed(settings['versions'])}, {code()}."
    )


def _claims_table(findings: Sequence[Finding]) -> str:
    """A line for each measure of each claim: the main choice, and the verdicts under the others."""
    rows = []
    for claim in CLAIMS:
        own = [finding for finding in findings if finding.claim == claim.key]
        for i, measure in enumerate(dict.fromkeys(finding.measure for finding in own)):
            same = [finding for finding in own if finding.measure == measure]
            first = same[0]
            words, where = (claim.words, claim.where) if i == 0 else ("", "")
            figure = first.text + (f" ({first.note})" if first.note else "")
            rows.append([words, where, measure, figure, f"**{first.verdict}**", under_choices(same)])
    return table(["The paper says", "Where", "Ours", "Figure [95 %]", "Verdict", "Over the choices"], rows)


def _sensitivity_tables(findings: Sequence[Finding]) -> str:
    """A row a choice, a column a claim, of the claims that were judged under every choice."""
    names = [choice.name for choice in CHOICES]
    keys = [claim.key for claim in CLAIMS if {f.choice for f in findings if f.claim == claim.key} >= set(names)]
    by_key = {(f.claim, f.choice): f for f in findings}
    tables = []
    for half in (keys[::2], keys[1::2]):  # against (i), against (ii)
        heads = [by_key[key, names[0]].measure for key in half]
        of_choice = {name: [by_key[key, name] for key in half] for name in names}
        rows = [[f"`{name}`", *(f"{one.text}: {one.verdict}" for one in found)] for name, found in of_choice.items()]
        tables.append(table(["Choice", *heads], rows))
    return "\n\n".join(tables)


def _conditions_table(rows: Rows) -> str:
    """Lost runs and the usual figures of every condition."""
    pairs = [(choice.name, strategy) for choice in CHOICES for strategy in STRATEGIES]
    pairs += [(one.choice, one.policy) for one in SINGLES if (one.choice, one.policy) not in pairs]
    cells = []
    for choice, policy in pairs:
        runs: list[Row] = [
            {**row, "alive_rms": rms}
            for row, rms in zip(rows[choice, policy], while_alive(rows[choice, policy], "orientation_rms"))
        ]
        name = "mi (gaze scripted)" if policy == LIVE else policy
        cells.append([f"`{choice}`", name, *(column.text(column.of(runs)) for column in FIGURES)])
    return table(["Choice", "Policy", *(column.title for column in FIGURES)], cells)
