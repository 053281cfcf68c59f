"""From runs under a `Witness` to the figures of the consistency report, each beside the bar that it has to meet."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activeslam_gym.evaluation import Episode, honesty, outcome
from agents.tools.statistics import TAILS, Estimate, estimate

Array = NDArray[np.float64]
QUANTITIES = {"position": "position_nees", "orientation": "orientation_nees", "landmarks": "landmark_nees"}
"""What has a NEES, and its name in an episode."""
DOF = 3
"""Degrees of freedom of each of them."""
TURNING = ("mi-constant", "sweep")
"""Strategies that turn all the time, for which the bars are wider."""
LOOKING = ("mi-mi", "mi-fisher")
"""Strategies that choose where to look."""
BAR_TIMES = (5.0, 15.0, 35.0)
"""Seconds at which the NEES has a bar."""
FAR = 3.0
"""Standard deviations beyond which a depth error is counted."""


@dataclass(frozen=True)
class Bar:
    """What a figure has to lie within."""

    low: float = -np.inf
    high: float = np.inf

    def text(self, scale: float = 1.0) -> str:
        """`low–high`, or `≤ high`, each times `scale`."""
        if np.isinf(self.low):
            return f"≤ {self.high * scale:g}"
        return f"{self.low * scale:g} … {self.high * scale:g}"


@dataclass(frozen=True)
class Finding:
    """A figure, its bar and whether it is met; None for both where there is no bar, or no figure."""

    figure: Estimate
    bar: Bar | None = None
    met: bool | None = None

    def text(self, scale: float = 1.0, digits: int = 2) -> str:
        """The figure with its interval, its bar and the verdict."""
        figure = self.figure.text(scale, digits)
        if self.bar is None or self.met is None:
            return figure
        return f"{figure} ({self.bar.text(scale)}: {'met' if self.met else 'NOT MET'})"


@dataclass(frozen=True)
class Calibration:
    """The figures of one strategy with one initialiser."""

    strategy: str
    initialisation: str
    runs: int
    nees: dict[str, dict[str, Finding]]
    """Time [s] → quantity → average over the runs alive, per degree of freedom."""
    nees_median: dict[str, dict[str, Estimate]]
    """The same with the median, which has no bar."""
    chi2_bounds: dict[str, dict[str, tuple[float, float]]]
    """Time [s] → quantity → 95 % bounds of the average, if the filter is consistent."""
    curves: dict[str, dict[str, list[float]]]
    """Quantity → `time` [s], `mean`, `median`, `low` and `high` of the χ² bounds, `alive`: a sample a second."""
    depth_mean: Finding
    """Of the standardised depth errors at conversion, all runs together."""
    depth_std: Finding
    depth_far: Estimate
    """Share of them beyond `FAR` standard deviations."""
    wrong: Finding
    """Share of wrong associations among all, all runs together."""
    duplicates: Estimate
    """Share of duplicates among the features that stand for a true landmark, all runs together."""
    lost: Finding
    log_score_gain: Estimate
    """Median over all runs [bit]."""
    counts: dict[str, int]
    """What the shares are of."""

    @property
    def findings(self) -> dict[str, Finding]:
        """All that may have a bar, by name."""
        nees = {f"NEES of {q} at {t} s": found for t, row in self.nees.items() for q, found in row.items()}
        rest = {"depth error, mean": self.depth_mean, "depth error, std": self.depth_std}
        return nees | rest | {"wrong associations": self.wrong, "lost": self.lost}


def initialisation_of(run: Episode) -> str:
    """The initialiser of a run's features."""
    return json.loads(run.settings)["scenario"]["initialisation"]


def nees_bar(strategy: str, time: float) -> Bar | None:
    """Of the average NEES per degree of freedom, the same for all quantities."""
    if time not in BAR_TIMES:
        return None
    return Bar(0.8, 1.5) if strategy in LOOKING else Bar(high=2.5) if strategy in TURNING else None


def lost_bar(strategy: str, scenario: str) -> Bar:
    """Of the share of lost runs: 1 %, 2 % while turning, 5 % under clutter."""
    return Bar(high=0.05 if scenario == "clutter" else 0.02 if strategy in TURNING else 0.01)


DEPTH_MEAN_BAR, DEPTH_STD_BAR, WRONG_BAR = Bar(-0.3, 0.3), Bar(0.8, 1.3), Bar(high=0.005)


def judged(figure: Estimate, bar: Bar | None) -> Finding:
    """The figure beside its bar; without a value there is no verdict."""
    if bar is None or np.isnan(figure.value):
        return Finding(figure, bar)
    return Finding(figure, bar, bool(bar.low <= figure.value <= bar.high))


def chi2_bounds(runs: int) -> tuple[float, float]:
    """95 % bounds of the NEES per degree of freedom averaged over `runs` independent runs of 3 dof, if consistent.

    The sum over n runs is χ² with 3 n degrees of freedom, so the average per degree of freedom is χ²_3n / (3 n). (Bar-
    Shalom, Li and Kirubarajan 2001, section 5.4.) For landmarks, a run's mean over its map counts as 3 too, as if its
    features shared one error: the widest that the bounds can be.
    """
    from scipy.stats import chi2

    if runs == 0:
        return np.nan, np.nan
    low, high = chi2.ppf(TAILS, DOF * runs) / (DOF * runs)
    return float(low), float(high)


def calibrate(runs: Sequence[Episode], times: Sequence[float], scenario: str) -> Calibration:
    """The figures of `runs`, all of one strategy with one initialiser, with the bars of the scenario.

    In the scenario `clutter` only the share of lost runs has a bar.
    """
    strategy, bars = runs[0].policy, scenario != "clutter"
    at = {f"{t:g}": {q: _nees(runs, q, t) for q in QUANTITIES} for t in times}
    bar_at = {f"{t:g}": nees_bar(strategy, t) if bars else None for t in times}
    return Calibration(
        strategy=strategy,
        initialisation=initialisation_of(runs[0]),
        runs=len(runs),
        nees={t: {q: judged(estimate(v, "mean"), bar_at[t]) for q, v in row.items()} for t, row in at.items()},
        nees_median={t: {q: estimate(v, "median") for q, v in row.items()} for t, row in at.items()},
        chi2_bounds={t: {q: chi2_bounds(_alive(v)) for q, v in row.items()} for t, row in at.items()},
        curves={quantity: curve(runs, quantity) for quantity in QUANTITIES},
        lost=judged(estimate([run.lost for run in runs], "share"), lost_bar(strategy, scenario)),
        log_score_gain=estimate([outcome(run, 1)["log_score_gain"] for run in runs], "median"),
        **_from_labels(runs, bars),
    )


def curve(runs: Sequence[Episode], quantity: str) -> dict[str, list[float]]:
    """NEES over time, a sample a second: average and median over the runs alive, and the bounds of the average."""
    times = np.arange(1.0, max(run.times[-1] for run in runs) + 0.5)
    rows = []
    for time in times:
        values = _nees(runs, quantity, time)
        known = values[~np.isnan(values)]
        mean, median = (float(known.mean()), float(np.median(known))) if len(known) else (np.nan, np.nan)
        rows.append((float(time), mean, median, *chi2_bounds(len(known)), len(known)))
    names = ("time", "mean", "median", "low", "high", "alive")
    return {name: [row[i] for row in rows] for i, name in enumerate(names)}


def _nees(runs: Sequence[Episode], quantity: str, time: float) -> Array:
    """(runs,) NEES per degree of freedom; NaN where the run is over, or nothing is mapped."""
    return np.array([honesty(run, time)[QUANTITIES[quantity]] for run in runs])


def _alive(values: Array) -> int:
    return int(np.count_nonzero(~np.isnan(values)))


def _from_labels(runs: Sequence[Episode], bars: bool) -> dict[str, Any]:
    """The fields that come from the hidden labels: figures of all runs together, which have no interval."""
    said = [run.notes for run in runs]
    errors = np.concatenate([np.asarray(one["depth_errors"], float).reshape(-1) for one in said])
    names = ("conversions", "matches", "wrong_matches", "features", "duplicates")
    counts = {name: int(sum(one[name] for one in said)) for name in names}

    def share(part: int, whole: int) -> Estimate:
        return pooled(part / whole if whole else np.nan, len(runs))

    mean, std = (errors.mean(), errors.std()) if len(errors) else (np.nan, np.nan)
    return {
        "depth_mean": judged(pooled(mean, len(runs)), DEPTH_MEAN_BAR if bars else None),
        "depth_std": judged(pooled(std, len(runs)), DEPTH_STD_BAR if bars else None),
        "depth_far": share(int(np.count_nonzero(np.abs(errors) > FAR)), len(errors)),
        "wrong": judged(share(counts["wrong_matches"], counts["matches"]), WRONG_BAR if bars else None),
        "duplicates": share(counts["duplicates"], counts["features"]),
        "counts": counts | {"depth_errors": len(errors)},
    }


def pooled(value: float, rooms: int) -> Estimate:
    """A figure of the values of all rooms together."""
    return Estimate(float(value), np.nan, np.nan, rooms, "pooled")
