"""Aggregates over episodes with their intervals. scipy.stats is imported where it is used, since it is slow to load.

A median and a share have intervals by the binomial distribution, which hold for every distribution of the values. An
interquartile mean has one by the bootstrap, since it leaves out the tails. A mean has none: a sample without the rare
failure does not show how far it lies from the true mean.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

CONFIDENCE = 0.95
TAILS = (1.0 - CONFIDENCE) / 2.0, 1.0 - (1.0 - CONFIDENCE) / 2.0  # the quantiles at an interval's ends
RESAMPLES = 2000  # bootstrap resamples: the ends of a 95 % interval then rest on fifty of them each
FEWEST = 6  # episodes that an interval of a median needs: of five, all lie on one side of it with a probability of 6 %
FEW_EPISODES = 20  # with fewer episodes a report says that its intervals are a hint

MISSING = "–"  # stands for a figure that no episode gave
LEGEND = (
    f"[ ]: {CONFIDENCE:.0%} interval over episodes: of a share, Clopper and Pearson's; from {FEWEST} episodes on, of a "
    "median by order statistics, of an interquartile mean (IQM, over the middle half) by the bootstrap."
)
"""Explains the brackets."""

Array = NDArray[np.float64]
Statistic = Literal["median", "IQM", "share", "mean"]
"""`IQM`: interquartile mean. A mean has no interval."""


@dataclass(frozen=True)
class Aggregate:
    """A figure over episodes and its interval, which is NaN for a statistic without one and for too few episodes."""

    value: float
    low: float
    high: float
    episodes: int
    statistic: Statistic

    def text(self, scale: float = 1.0, digits: int = 1) -> str:
        """`value [low, high]`, each times `scale`; without the interval where there is none, a dash without a value."""
        if np.isnan(self.value):
            return MISSING
        value, low, high = (f"{x * scale:.{digits}f}" for x in (self.value, self.low, self.high))
        return value if np.isnan(self.low) else f"{value} [{low}, {high}]"


@dataclass(frozen=True)
class Column:
    """A figure over episodes and how it is shown: its title, the factor to its unit, the digits after the point.

    A key that ends in ``_median`` is another statistic of the column without it.
    """

    key: str
    title: str
    statistic: Statistic = "median"
    scale: float = 1.0
    digits: int = 1

    @property
    def source(self) -> str:
        """The key of the value in a row."""
        return self.key.removesuffix("_median")

    def of(self, rows: Iterable[Mapping[str, Any]]) -> Aggregate:
        """The figure over rows, one an episode."""
        return aggregate([row[self.source] for row in rows], self.statistic)

    def text(self, figure: Aggregate) -> str:
        """The figure in the title's unit."""
        return figure.text(self.scale, self.digits)

    @property
    def heading(self) -> str:
        """The title with the statistic; a share needs none."""
        return self.title if self.statistic == "share" else f"{self.title} ({self.statistic})"


def aggregate(values: ArrayLike, statistic: Statistic) -> Aggregate:
    """A statistic of `values` (one an episode) with its 95 % interval, if it has one; NaN are left out."""
    from scipy.stats import binomtest, quantile_test

    every: Array = np.asarray(values, dtype=float)
    episodes = every[~np.isnan(every)]
    if not len(episodes):
        return Aggregate(np.nan, np.nan, np.nan, 0, statistic)
    value: Any = np.mean(episodes)
    low, high = np.nan, np.nan
    if statistic == "share":
        low, high = binomtest(int(episodes.sum()), len(episodes)).proportion_ci(CONFIDENCE)
    elif statistic == "median":
        value, (low, high) = np.median(episodes), quantile_test(episodes, p=0.5).confidence_interval(CONFIDENCE)
    elif statistic == "IQM":
        value, (low, high) = interquartile_mean(episodes), bootstrap_interval(episodes, interquartile_mean)
    return Aggregate(float(value), float(low), float(high), len(episodes), statistic)


def paired_rmse(errors: ArrayLike, others: ArrayLike) -> tuple[float, float]:
    """RMSE of each of two policies over the landmarks that both mapped in one episode; NaN where there are none.

    errors, others: (L,) m, NaN for a landmark that is not mapped.
    """
    pair: Array = np.array([errors, others], dtype=float)
    common = pair[:, ~np.isnan(pair).any(axis=0)]
    if not common.size:
        return np.nan, np.nan
    own, other = np.sqrt(np.mean(common**2, axis=1))
    return float(own), float(other)


def interquartile_mean(episodes: Array) -> Array:
    """(..., episodes) -> (...): the mean of the middle half."""
    from scipy.stats import trim_mean

    return np.asarray(trim_mean(episodes, 0.25, axis=-1))


def bootstrap_interval(episodes: Array, figure: Callable[[Array], Array]) -> tuple[float, float]:
    """Percentile bootstrap of a ``figure`` of episodes (n,), (m, n) -> (m,), the same at each call; NaN for too few."""
    if len(episodes) < FEWEST:
        return np.nan, np.nan
    drawn = np.random.default_rng(0).integers(len(episodes), size=(RESAMPLES, len(episodes)))
    low, high = np.quantile(figure(episodes[drawn]), TAILS)
    return float(low), float(high)
