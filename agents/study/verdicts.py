"""From the rows of two policies in the same rooms to a verdict on what the paper says of them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from agents.tools.statistics import TAILS, Estimate, Statistic, estimate

Array = NDArray[np.float64]
Row = dict[str, Any]
Side = Literal["above", "below"]

FEWEST_ROOMS = 10
"""With fewer rooms an interval is no ground for a verdict."""
HOLDS, FAILS, OPEN = "holds", "does not hold", "not shown"
WITHIN, OUTSIDE = "within our spread", "outside our spread"
"""Of a number that the paper states of its one run."""


@dataclass(frozen=True)
class Finding:
    """One claim under one choice."""

    claim: str
    """Key of the claim; `claims.findings_of` fills it in."""
    choice: str
    """What was chosen where the paper leaves it open."""
    measure: str
    """What our figure is, in words with its unit."""
    estimate: Estimate
    verdict: str
    """One of the words above."""
    scale: float = 1.0
    """The figure is printed times this."""
    digits: int = 1
    note: str = ""
    """What a reader has to know beside the figure: rooms left out, say."""

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


def judge_draw(values: Sequence[float], stated: float) -> str:
    """Whether the paper's one draw lies within the central 95 % of our rooms; NaN rooms are left out."""
    if np.count_nonzero(~np.isnan(values)) < FEWEST_ROOMS:
        return OPEN
    low, high = np.nanquantile(values, TAILS)
    return WITHIN if low <= stated <= high else OUTSIDE


def column(rows: Sequence[Row], name: str) -> Array:
    """(rooms,) a number of each run."""
    return np.array([row[name] for row in rows], dtype=float)


def while_alive(rows: Sequence[Row], name: str) -> Array:
    """(rooms,) a number of each run; NaN for a lost one, which has no error or entropy worth the name."""
    return np.where(column(rows, "lost") == 1.0, np.nan, column(rows, name))


def restricted(rows: Sequence[Row], name: str, duration: float) -> Array:
    """(rooms,) s until something happened, but `duration` where it was not seen: lost before, or never."""
    times = column(rows, name)
    return np.where(np.isnan(times), duration, times)


def at_rung(rows: Sequence[Row], ladder: str, rung: int, otherwise: float = np.nan) -> Array:
    """(rooms,) the value when `rung` landmarks were mapped, or `otherwise` where they never were."""
    return np.array([_rung(row[ladder], rung, otherwise) for row in rows], dtype=float)


def at_common_rung(ours: Sequence[Row], theirs: Sequence[Row], ladder: str, most: int) -> tuple[Array, Array]:
    """(rooms,) of each: the value at the most landmarks that both reached in a room, `most` at most; NaN for none.

    Rooms in which one of them never reached `most` are not left out: they are compared on a lower rung.
    """
    pairs = []
    for own, other in zip(ours, theirs, strict=True):
        rung = min(len(own[ladder]), len(other[ladder]), most)
        pairs.append((_rung(own[ladder], rung, np.nan), _rung(other[ladder], rung, np.nan)))
    first, second = np.array(pairs, dtype=float).T
    return first, second


def _rung(ladder: Sequence[float | None], rung: int, otherwise: float) -> float:
    """Entry number `rung`, from 1."""
    if not 1 <= rung <= len(ladder):
        return otherwise
    return otherwise if (value := ladder[rung - 1]) is None else value


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
    return Finding("", choice, measure, figure, judge(figure, side, bound), scale, digits, note)


def one_draw(choice: str, measure: str, values: Array, stated: float, note: str, digits: int = 1) -> Finding:
    """The finding on a number that the paper states of its one run, beside the median of our rooms."""
    verdict = judge_draw(values.tolist(), stated)
    return Finding("", choice, measure, estimate(values, "median"), verdict, digits=digits, note=note)


def under_choices(findings: Sequence[Finding]) -> str:
    """The verdicts of one claim over all choices in a line: `holds: a, b; not shown: c`."""
    order = (HOLDS, OPEN, FAILS, WITHIN, OUTSIDE)
    choices = {verdict: [one.choice for one in findings if one.verdict == verdict] for verdict in order}
    told = [f"{verdict}: {', '.join(names)}" for verdict, names in choices.items() if names]
    if len(told) > 1:
        return "; ".join(told)
    return f"{findings[0].verdict} under every choice" if len(findings) > 1 else ""
