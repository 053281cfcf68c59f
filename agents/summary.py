"""From episodes to tables: aggregates over episodes with their intervals, and pairs of policies in the same episodes.

A median and a share have intervals by the binomial distribution, which hold for every distribution of the values. An
interquartile mean has one by the bootstrap, since it leaves out the tails. A mean has none: a sample without the rare
failure does not show how far it lies from the true mean. scipy.stats is imported where it is used, since it is slow to
load.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from activeslam_gym.evaluation import Episode, row_of
from activeslam_gym.evaluation.code import code
from agents.tools.sections import Table, escaped

CONFIDENCE = 0.95
TAILS = (1.0 - CONFIDENCE) / 2.0, 1.0 - (1.0 - CONFIDENCE) / 2.0  # the quantiles at an interval's ends
RESAMPLES = 2000  # bootstrap resamples: the ends of a 95 % interval then rest on fifty of them each
FEWEST = 6  # episodes that an interval of a median needs: of five, all lie on one side of it with a probability of 6 %
FEW_EPISODES = 20  # with fewer episodes a report says that its intervals are a hint

MISSING = "–"  # stands for a figure that no episode gave
LEGEND = (
    f"[ ]: {CONFIDENCE:.0%} interval over episodes: of a share, Clopper and Pearson's; from {FEWEST} episodes on, of a "
    "median by order statistics, of an interquartile mean (IQM, over the middle half) by the bootstrap. ( ): the "
    "number of episodes with such a figure, if not all; without a mapped landmark there is no RMSE."
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
        fewest, most = (int(rounded(episodes.sum())) for rounded in (np.floor, np.ceil))  # of ties, which are halves
        low = binomtest(fewest, len(episodes)).proportion_ci(CONFIDENCE).low
        high = binomtest(most, len(episodes)).proportion_ci(CONFIDENCE).high
    elif statistic == "median":
        value, (low, high) = np.median(episodes), quantile_test(episodes, p=0.5).confidence_interval(CONFIDENCE)
    elif statistic == "IQM":
        value, (low, high) = interquartile_mean(episodes), bootstrap_interval(episodes, interquartile_mean)
    return Aggregate(float(value), float(low), float(high), len(episodes), statistic)


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


# Policies in the same episodes ----------------------------------------------------------------------------------------


RESULTS = (
    Column("log_score_gain_median", "log score gain, bits"),
    Column("log_score_under_0", "under 0, %", "share", 100.0),
    Column("log_score_under_minus_1000", "under −1000, %", "share", 100.0),
    Column("log_score_gain", "log score gain, bits", "IQM"),
    Column("bits", "entropy reduction, bits", "IQM"),
    Column("landmarks_mapped", "mapped", "IQM"),
    Column("distinct_landmarks", "distinct", "IQM"),
    Column("lost", "lost, %", "share", 100.0),
)
"""A single confident error, a landmark taken for another, takes thousands of bits of the log score, so its mean has no
interval. Median and interquartile mean tell of the usual episode, and two shares of the overconfident episodes."""
ERRORS = (
    Column("landmark_rmse", "landmark RMSE, cm", scale=100.0),
    Column("position_error", "position error, cm", scale=100.0),
    Column("orientation_error", "orientation error, °", scale=180.0 / np.pi, digits=2),
)
HEADLINE = (*RESULTS[:2], RESULTS[-1], ERRORS[0])  # what the README shows of each policy
PAIRED = (
    RESULTS[0],
    Column("ahead", "ahead (a tie is half), % of episodes", "share", 100.0),
    *RESULTS[3:5],
    Column("landmark_rmse", "RMSE of landmarks mapped by both, cm", scale=100.0),
    *ERRORS[1:],
)
"""Of the differences in the same episode."""
Figures = dict[str, Aggregate]  # column → figure over episodes


@dataclass(frozen=True)
class Summary:
    """The aggregates of a comparison."""

    settings: dict[str, Any]  # the arguments and the versions
    policies: dict[str, Figures]  # policy → figures over its episodes
    paired: dict[str, dict[str, Figures]]
    """Reference → policy → figures of the differences policy − reference over the episodes of both."""
    notes: list[str]  # limits of the figures


def summarise(
    episodes: Sequence[Episode], reference: str = "mi-fisher", settings: dict[str, Any] | None = None
) -> Summary:
    """Figures of `episodes`, and pairs against `reference` and the policy with the highest log score."""
    runs = grouped(episodes)
    rows = {
        name: {run.seed: row_of(run) | {"landmark_errors": run.landmark_errors} for run in of_policy}
        for name, of_policy in runs.items()
    }
    policies = {name: _figures(list(seen.values()), (*RESULTS, *ERRORS)) for name, seen in rows.items()}
    fewest, notes = min(len(seen) for seen in rows.values()), []

    def differences(name: str, against: str) -> Figures:
        pairs = [(row, rows[against].get(seed)) for seed, row in rows[name].items()]
        return _figures([_difference(row, other) for row, other in pairs if other], PAIRED)

    if fewest < FEW_EPISODES:
        notes.append(f"* From {fewest} episodes: fewer than {FEW_EPISODES} give a hint, no finding.")
    if reference not in policies:
        notes.append(f"The reference {reference} was not run: no paired differences against it.")
    return Summary(
        settings=settings or {},
        policies=policies,
        paired={
            against: {name: differences(name, against) for name in rows if name != against}
            for against in dict.fromkeys((reference, by_log_score(policies)[0]))
            if against in policies and len(policies) > 1
        },
        notes=notes,
    )


def grouped(episodes: Sequence[Episode]) -> dict[str, list[Episode]]:
    """Policy → its episodes by seed, in the order in which the policies first appear."""
    by_policy: dict[str, list[Episode]] = {episode.policy: [] for episode in episodes}
    for episode in sorted(episodes, key=lambda e: e.seed):
        by_policy[episode.policy].append(episode)
    return by_policy


def by_log_score(policies: Mapping[str, Figures]) -> list[str]:
    """The policies, the highest median log score gain first: one room in a hundred can make a mean."""
    return sorted(policies, key=lambda name: -policies[name]["log_score_gain_median"].value)


# Tables -------------------------------------------------------------------------------------------------------------


def tables(summary: Summary) -> list[Table]:
    """All tables of the comparison."""
    figures = summary.policies
    star = "*" if min(f["bits"].episodes for f in figures.values()) < FEW_EPISODES else ""
    parts = {f"Results{star}": (figures, RESULTS), f"Errors at the end{star}": (figures, ERRORS)}
    for against, differences in summary.paired.items():
        parts[f"Difference to {against} in the same episodes{star}"] = differences, PAIRED
    return [_table(title, *part) for title, part in parts.items()]


def text(summary: Summary) -> str:
    """The first table in aligned plain text, with the notes."""
    return "\n\n".join([tables(summary)[0].aligned(), LEGEND, *summary.notes])


def markdown(summary: Summary) -> str:
    """All tables in Markdown, with the notes."""
    parts = [f"### {escaped(table.title)}\n\n{table.markdown()}" for table in tables(summary)]
    return "\n\n".join(["## Comparison", *parts, LEGEND, *map(escaped, summary.notes)]) + "\n"


def headline(summary: Summary) -> str:
    """One Markdown table, the highest log score first."""
    figures = {name: summary.policies[name] for name in by_log_score(summary.policies)}
    return f"{_table('', figures, HEADLINE).markdown()}\n\n{LEGEND} {code()}."


def _table(title: str, figures: Mapping[str, Figures], columns: Sequence[Column]) -> Table:
    """A row per policy, a column per figure, and the number of episodes; a figure of fewer shows their number."""
    header = ["policy", *(column.heading for column in columns), "episodes"]
    rows = []
    for name, row in figures.items():
        most = max(one.episodes for one in row.values())
        fewer = (f" ({row[one.key].episodes})" if 0 < row[one.key].episodes < most else "" for one in columns)
        rows.append([name, *(one.text(row[one.key]) + note for one, note in zip(columns, fewer)), str(most)])
    return Table(title, header, rows)


Row = dict[str, Any]


def _figures(rows: Sequence[Row], columns: Sequence[Column]) -> Figures:
    return {column.key: column.of(rows) for column in columns}


def _difference(row: Row, other: Row) -> dict[str, float]:
    """Column → one − other, in one episode."""
    rmse, other_rmse = paired_rmse(row["landmark_errors"], other["landmark_errors"])
    apart = {one.source: row[one.source] - other[one.source] for one in PAIRED if one.source in row}
    return apart | {"landmark_rmse": rmse - other_rmse, "ahead": float(ahead(apart["log_score_gain"]))}


def ahead(leads: ArrayLike) -> Array:
    """1 for each lead over another policy in the same episode, 0 for a lead of the other, and a half for a tie."""
    return np.asarray(0.5 * (1.0 + np.sign(leads)))


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
