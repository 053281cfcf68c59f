"""From runs under a `Witness` to the figures of the consistency report, each beside its bar."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from activeslam_gym.evaluation import Episode, honesty, outcome
from agents.tools.statistics import TAILS, Estimate, estimate

QUANTITIES = {"position": "position_nees", "orientation": "orientation_nees", "landmarks": "landmark_nees"}
"""Quantity with a NEES → its name in an episode."""
DOF = 3  # degrees of freedom of each of them
TURNING = ("mi-constant", "sweep")  # strategies that turn all the time, for which the bars are wider
LOOKING = ("mi-mi", "mi-fisher")  # strategies that choose the gaze
BAR_TIMES = (5.0, 15.0, 35.0)  # seconds at which the NEES has a bar
FAR = 3.0  # standard deviations beyond which a depth error is counted


@dataclass(frozen=True)
class Bar:
    """Bounds of a figure."""

    low: float = -np.inf
    high: float = np.inf

    def text(self, scale: float = 1.0) -> str:
        """`low … high`, or `≤ high`, each times `scale`."""
        low = "≤" if np.isinf(self.low) else f"{self.low * scale:g} …"
        return f"{low} {self.high * scale:g}"


@dataclass(frozen=True)
class Checked:
    """A figure beside its bar, and whether it is met: None where there is no bar, or no figure."""

    figure: Estimate
    bar: Bar | None = None
    met: bool | None = field(init=False)

    def __post_init__(self) -> None:
        value = self.figure.value
        met = None if self.bar is None or np.isnan(value) else bool(self.bar.low <= value <= self.bar.high)
        object.__setattr__(self, "met", met)

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
    figures: dict[str, Checked]
    """By name: `NEES of QUANTITY at TIME s`, the average over the runs alive, per degree of freedom, and the `median `
    of that; of all runs together the mean, the standard deviation and the share beyond `FAR` of the standardised depth
    errors at conversion, and the shares of wrong associations among all and of duplicates among the features with a
    true landmark; over runs the share of lost ones and the median of the log score gain [bit]."""
    chi2_bounds: dict[str, tuple[float, float]]
    """The first of these names → 95 % bounds of the average, if the filter is consistent."""
    curves: dict[str, dict[str, list[float]]]
    """Quantity → `time` [s], `mean`, `median`, `low` and `high` of the χ² bounds, `alive`: a sample a second."""
    counts: dict[str, int]  # numbers that the shares are of

    @property
    def name(self) -> str:
        """Strategy and initialiser."""
        return f"{self.strategy}, {self.initialisation}"


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


BARS = {"depth error, mean": Bar(-0.3, 0.3), "depth error, std": Bar(0.8, 1.3), "wrong associations": Bar(high=0.005)}


def chi2_bounds(values: NDArray[np.float64]) -> tuple[float, float]:
    """95 % bounds of the average over the runs that have a value of the NEES per degree of freedom, if consistent.

    The sum over n runs is χ² with 3 n degrees of freedom, so the average per degree of freedom is χ²_3n / (3 n). (Bar-
    Shalom, Li and Kirubarajan 2001, section 5.4.) For landmarks, a run's mean over its map counts as 3 too, as if its
    features shared one error: the widest that the bounds can be.
    """
    from scipy.stats import chi2

    dof = DOF * int(np.count_nonzero(~np.isnan(values)))
    low, high = chi2.ppf(TAILS, dof) / dof if dof else (np.nan, np.nan)
    return float(low), float(high)


def calibrate(runs: Sequence[Episode], times: Sequence[float], scenario: str) -> Calibration:
    """The figures of `runs`, all of one strategy with one initialiser, with the bars of the scenario.

    In the scenario `clutter` only the share of lost runs has a bar.
    """
    strategy, clutter = runs[0].policy, scenario == "clutter"
    figures, bounds = {}, {}
    for time in times:
        for quantity in QUANTITIES:
            name, values = f"NEES of {quantity} at {time:g} s", _nees(runs, quantity, time)
            figures[name] = Checked(estimate(values, "mean"), None if clutter else nees_bar(strategy, time))
            figures[f"median {name}"] = Checked(estimate(values, "median"))
            bounds[name] = chi2_bounds(values)
    labelled, counts = _from_labels(runs)
    bars = {} if clutter else BARS
    figures |= {name: Checked(figure, bars.get(name)) for name, figure in labelled.items()}
    figures["lost"] = Checked(estimate([run.lost for run in runs], "share"), lost_bar(strategy, scenario))
    figures["log score gain"] = Checked(estimate([outcome(run)["log_score_gain"] for run in runs], "median"))
    curves = {quantity: _curve(runs, quantity) for quantity in QUANTITIES}
    return Calibration(strategy, initialisation_of(runs[0]), len(runs), figures, bounds, curves, counts)


def _nees(runs: Sequence[Episode], quantity: str, time: float) -> NDArray[np.float64]:
    """(runs,) NEES per degree of freedom; NaN where the run is over, or nothing is mapped."""
    return np.array([honesty(run, time)[QUANTITIES[quantity]] for run in runs])


def _curve(runs: Sequence[Episode], quantity: str) -> dict[str, list[float]]:
    """See `Calibration.curves`."""
    names = ("time", "mean", "median", "low", "high", "alive")
    rows: list[tuple[float, ...]] = []
    for time in np.arange(1.0, max(run.times[-1] for run in runs) + 0.5):
        values = _nees(runs, quantity, time)
        known = values[~np.isnan(values)]
        mean, median = (float(known.mean()), float(np.median(known))) if len(known) else (np.nan, np.nan)
        rows.append((float(time), mean, median, *chi2_bounds(values), len(known)))
    return {name: list(column) for name, column in zip(names, zip(*rows))}


def _from_labels(runs: Sequence[Episode]) -> tuple[dict[str, Estimate], dict[str, int]]:
    """Figures that come from the hidden labels, of all runs together, which have no interval; and their counts."""
    notes = [run.notes for run in runs]
    errors = np.concatenate([np.asarray(one["depth_errors"], float).reshape(-1) for one in notes])
    names = ("conversions", "matches", "wrong_matches", "features", "duplicates")
    counts = {name: int(sum(one[name] for one in notes)) for name in names} | {"depth_errors": len(errors)}
    shares = {
        "depth error, far": (int(np.count_nonzero(np.abs(errors) > FAR)), len(errors)),
        "wrong associations": (counts["wrong_matches"], counts["matches"]),
        "duplicates": (counts["duplicates"], counts["features"]),
    }
    mean, std = (errors.mean(), errors.std()) if len(errors) else (np.nan, np.nan)
    pooled = {"depth error, mean": mean, "depth error, std": std}
    pooled |= {name: part / whole if whole else np.nan for name, (part, whole) in shares.items()}
    return {name: Estimate(float(x), np.nan, np.nan, len(runs), "pooled") for name, x in pooled.items()}, counts
