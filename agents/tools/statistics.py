"""Estimates over rooms with their intervals. scipy.stats is imported where it is used, since it is slow to load."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

CONFIDENCE = 0.95
TAILS = (1.0 - CONFIDENCE) / 2.0, 1.0 - (1.0 - CONFIDENCE) / 2.0
"""The quantiles at an interval's ends."""
RESAMPLES = 2000
"""Bootstrap resamples: the ends of a 95 % interval then rest on fifty of them each."""

MISSING = "–"
"""Stands for a figure that no room gave."""

Array = NDArray[np.float64]
Statistic = Literal["mean", "median", "share", "pooled"]
"""`pooled`: from sums over all rooms."""


@dataclass(frozen=True)
class Estimate:
    """A figure over rooms and its interval, which is NaN where it cannot be told (fewer than two rooms)."""

    value: float
    low: float
    high: float
    rooms: int
    statistic: Statistic

    def text(self, scale: float = 1.0, digits: int = 1) -> str:
        """`value [low, high]`, each times `scale`; without the interval where there is none, a dash without a value."""
        if np.isnan(self.value):
            return MISSING
        value, low, high = (f"{x * scale:.{digits}f}" for x in (self.value, self.low, self.high))
        return value if np.isnan(self.low) else f"{value} [{low}, {high}]"


def estimate(values: ArrayLike, statistic: Statistic) -> Estimate:
    """Mean, median or share of `values` (one a room) with its 95 % interval; rooms whose value is NaN are left out."""
    all_rooms: Array = np.asarray(values, dtype=float)
    rooms = all_rooms[~np.isnan(all_rooms)]
    if not len(rooms):
        return Estimate(np.nan, np.nan, np.nan, 0, statistic)
    if statistic == "share":
        value, (low, high) = np.mean(rooms), _wilson(rooms)
    else:
        function: Callable[..., Any] = np.mean if statistic == "mean" else np.median
        value, (low, high) = function(rooms), _bootstrap(rooms, function)
    return Estimate(float(value), low, high, len(rooms), statistic)


def estimate_from_sums(rows: ArrayLike, figure: Callable[[Array], Array]) -> Estimate:
    """`figure` of the sums over all rooms of `rows` (rooms, k), with its percentile bootstrap interval over rooms.

    `figure` takes sums (k, ...) and returns (...): a ratio of sums, a mean, a standard deviation. Rooms keep together
    what is in them. NaN where the sums give no figure.
    """
    rooms: Array = np.asarray(rows, dtype=float)
    n = len(rooms)
    with np.errstate(divide="ignore", invalid="ignore"):
        value = float(figure(rooms.sum(axis=0)))
        how_often = np.random.default_rng(0).multinomial(n, np.full(n, 1.0 / n), size=RESAMPLES)  # each room is in
        resampled = figure((how_often @ rooms).T)
    known = resampled[np.isfinite(resampled)]
    if n < 2 or not np.isfinite(value) or not len(known):
        return Estimate(value if np.isfinite(value) else np.nan, np.nan, np.nan, n, "pooled")
    low, high = np.quantile(known, TAILS)
    return Estimate(value, float(low), float(high), n, "pooled")


def _bootstrap(values: Array, function: Callable[..., Any]) -> tuple[float, float]:
    """Percentile bootstrap over rooms, the same at each call; equal values have an interval of no width."""
    if len(values) < 2 or not np.isfinite(values).all():
        return np.nan, np.nan
    if np.ptp(values) == 0.0:
        return float(values[0]), float(values[0])
    from scipy.stats import bootstrap

    how: dict[str, Any] = {"confidence_level": CONFIDENCE, "n_resamples": RESAMPLES, "method": "percentile"}
    interval = bootstrap((values,), function, **how, random_state=np.random.default_rng(0)).confidence_interval
    return float(interval.low), float(interval.high)


def _wilson(values: Array) -> tuple[float, float]:
    """Wilson's interval of the share of ones, which holds for none and for all too."""
    from scipy.stats import binomtest

    interval = binomtest(int(values.sum()), len(values)).proportion_ci(CONFIDENCE, method="wilson")
    return float(interval.low), float(interval.high)


def paired_rmse(errors: ArrayLike, others: ArrayLike) -> tuple[float, float]:
    """RMSE of each of two policies over the landmarks that both mapped in one room; NaN where there are none.

    errors, others: (L,) m, NaN for a landmark that is not mapped.
    """
    pair: Array = np.array([errors, others], dtype=float)
    common = pair[:, ~np.isnan(pair).any(axis=0)]
    if not common.size:
        return np.nan, np.nan
    own, other = np.sqrt(np.mean(common**2, axis=1))
    return float(own), float(other)
