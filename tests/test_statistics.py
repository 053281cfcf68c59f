"""Estimates over rooms: known figures, and how often an interval holds the true value, by simulation."""

from typing import get_args

import numpy as np
import pytest
from scipy.stats import norm, trim_mean

from agents.tools import statistics
from agents.tools.statistics import Estimate, Statistic, estimate, paired_rmse

LIGHT = norm.ppf((np.arange(10_000) + 0.5) / 10_000, loc=600.0, scale=60.0)
HEAVY = np.where(np.arange(10_000) % 100 == 0, -6000.0, LIGHT[np.random.default_rng(0).permutation(10_000)])
"""Log scores [bit] of all rooms; in the second, one of a hundred rooms ends at -6000."""
SAMPLES = 400
ERRORS = 3.0 * np.sqrt(0.95 * 0.05 / SAMPLES)
"""Three standard errors of a coverage of 95 % that is counted in so many samples: 3 %."""
LEAST = {8: 0.90, 20: 0.93, 50: 0.93, 200: 0.93}
"""Rooms -> least coverage: the bootstrap falls short of 95 % by one or two percent, and of few rooms by more."""

shapes = pytest.mark.parametrize("everything", [LIGHT, HEAVY], ids=["light", "heavy"])


@pytest.fixture(autouse=True)
def fewer_resamples(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(statistics, "RESAMPLES", 400)


def coverage(truth: float, intervals: list[Estimate]) -> float:
    """Share of the intervals that hold the truth; those that are not printed do not count."""
    held = [one.low - 1e-9 <= truth <= one.high + 1e-9 for one in intervals if not np.isnan(one.low)]
    return float(np.mean(held)) if held else 1.0


@shapes
@pytest.mark.parametrize("rooms", [8, 50, *(pytest.param(rooms, marks=pytest.mark.slow) for rooms in (20, 200))])
def test_a_printed_interval_holds_the_true_figure_where_one_room_in_a_hundred_is_at_minus_6000(
    everything: np.ndarray, rooms: int
) -> None:
    """The bootstrap interval of a mean held it in a sixth of the samples of 8 rooms, in two fifths of those of 50."""
    samples = np.random.default_rng(rooms).choice(everything, (SAMPLES, rooms))
    truths = {"median": np.median(everything), "IQM": trim_mean(everything, 0.25), "mean": everything.mean()}
    for statistic in [one for one in get_args(Statistic) if one in truths]:
        intervals = [estimate(sample, statistic) for sample in samples]
        assert coverage(truths[statistic], intervals) >= LEAST[rooms] - ERRORS, statistic
        assert np.isnan([one.low for one in intervals]).all() == (statistic == "mean"), statistic
    failures = [estimate(sample < 0.0, "share") for sample in samples]
    assert coverage(float(np.mean(everything < 0.0)), failures) >= LEAST[rooms] - ERRORS


def test_figures_of_equal_missing_infinite_few_and_zero_values() -> None:
    for statistic in ("median", "IQM"):
        assert estimate([2.0] * 6, statistic) == Estimate(2.0, 2.0, 2.0, 6, statistic)  # of no width
        assert estimate([2.0] * 5, statistic).text() == "2.0"
    assert estimate([1.0, np.nan, 3.0], "mean").rooms == 2
    assert estimate([np.nan], "median").text() == "–"
    assert estimate([1.0, 2.0, 3.0, 4.0, np.inf, np.inf], "median").text() == "3.5 [1.0, inf]"
    none = estimate(np.zeros(20), "share")
    assert none.value == none.low == 0.0 and 0.1 < none.high < 0.2
    assert paired_rmse([1.0, 3.0, np.nan], [2.0, np.nan, 5.0]) == (1.0, 2.0)  # of the landmarks that both mapped
    assert np.isnan(paired_rmse([1.0, np.nan], [np.nan, 2.0])).all()
