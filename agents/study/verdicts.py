"""From figures over rooms to verdicts on the paper's claims."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from agents.study.conditions import Array
from agents.tools.statistics import TAILS, Estimate, Statistic, estimate

Side = Literal["above", "below"]
FEWEST_ROOMS = 10  # with fewer rooms an interval is no ground for a verdict
HOLDS, FAILS, OPEN = "holds", "does not hold", "not shown"
WITHIN, OUTSIDE = "within our spread", "outside our spread"  # of a number that the paper states of its one run


@dataclass(frozen=True)
class Finding:
    """A figure and the verdict on it, of one claim under one choice."""

    measure: str  # words for the figure, with its unit
    estimate: Estimate
    verdict: str  # one of the words above
    scale: float = 1.0  # the figure is printed times this
    digits: int = 1
    note: str = ""  # limits of the figure, for instance rooms left out
    choice: str = ""  # the reading, where the paper leaves it open
    claim: str = ""  # key of the claim; `claims.findings_of` fills it in

    @property
    def text(self) -> str:
        """The figure with its interval."""
        return self.estimate.text(self.scale, self.digits)


def judge(figure: Estimate, side: Side, bound: float = 0.0) -> str:
    """Whether the figure is on the claimed side of the bound: said only where its whole interval is on one side."""
    if figure.rooms < FEWEST_ROOMS or not np.isfinite([figure.low, figure.high]).all():
        return OPEN
    if figure.low <= bound <= figure.high:
        return OPEN
    return HOLDS if (figure.low > bound) == (side == "above") else FAILS


def judge_draw(values: Array, stated: float) -> str:
    """Whether the paper's one draw lies within the central 95 % of our rooms; NaN rooms are left out."""
    if np.count_nonzero(~np.isnan(values)) < FEWEST_ROOMS:
        return OPEN
    low, high = np.nanquantile(values, TAILS)
    return WITHIN if low <= stated <= high else OUTSIDE


def judged(
    choice: str,
    measure: str,
    values: Array,
    side: Side,
    bound: float = 0.0,
    scale: float = 1.0,
    digits: int = 1,
    statistic: Statistic = "median",
) -> Finding:
    """The finding on a figure over rooms, which the claim puts on one `side` of a `bound`; NaN rooms are left out."""
    figure = estimate(values, statistic)
    left_out = len(values) - figure.rooms
    note = f"{left_out} of {len(values)} rooms left out" if left_out else ""
    return Finding(measure, figure, judge(figure, side, bound), scale, digits, note, choice)


def one_draw(choice: str, measure: str, values: Array, stated: float, note: str, digits: int = 1) -> Finding:
    """The finding on a number that the paper states of its one run, beside the median of our rooms."""
    verdict = judge_draw(values, stated)
    return Finding(measure, estimate(values, "median"), verdict, digits=digits, note=note, choice=choice)


def under_choices(findings: Sequence[Finding]) -> str:
    """The verdicts of one claim over all choices in a line: `holds: a, b; not shown: c`."""
    order = (HOLDS, OPEN, FAILS, WITHIN, OUTSIDE)
    choices = {verdict: [one.choice for one in findings if one.verdict == verdict] for verdict in order}
    told = [f"{verdict}: {', '.join(names)}" for verdict, names in choices.items() if names]
    if len(told) > 1:
        return "; ".join(told)
    return f"{findings[0].verdict} under every choice" if len(findings) > 1 else ""
