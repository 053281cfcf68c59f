"""Estimates over rooms with their intervals. scipy.stats is imported where it is used, since it is slow to load."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

CONFIDENCE = 0.95
RESAMPLES = 2000
"""Bootstrap resamples: the ends of a 95 % interval then rest on fifty of them each."""

MISSING = "–"
"""Stands for a figure that no room gave."""

Array = NDArray[np.float64]
Statistic = Literal["mean", "median", "share"]


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


def _bootstrap(values: Array, function: Callable[..., Any]) -> tuple[float, float]:
    """Percentile bootstrap over rooms, the same at each call; equal values have an interval of no width."""
    if len(values) < 2 or not np.isfinite(values).all():
        return np.nan, np.nan
    if np.ptp(values) == 0.0:
        return float(values[0]), float(values[0])
    from scipy.stats import bootstrap

    interval = bootstrap(
        (values,),
        function,
        confidence_level=CONFIDENCE,
        n_resamples=RESAMPLES,
        method="percentile",
        random_state=np.random.default_rng(0),
    ).confidence_interval
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
