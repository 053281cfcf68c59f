"""Estimates over episodes: figures of known values, and an interval that holds the true one."""

import numpy as np

from agents.summary import Aggregate, aggregate, paired_rmse


def test_the_bootstrap_of_an_interquartile_mean_holds_the_true_one_though_one_in_a_hundred_is_at_minus_6000() -> None:
    """That of a mean held it in two fifths of such samples of 50 episodes."""
    rng = np.random.default_rng(50)
    samples = np.where(rng.random((100, 50)) < 0.01, -6000.0, rng.normal(600.0, 60.0, (100, 50)))
    intervals = [aggregate(sample, "IQM") for sample in samples]
    assert np.mean([one.low <= 600.0 <= one.high for one in intervals]) > 0.87
    assert np.isnan(aggregate(samples[0], "mean").low)


def test_figures_of_equal_missing_infinite_few_and_zero_values() -> None:
    for statistic in ("median", "IQM"):
        assert aggregate([2.0] * 6, statistic) == Aggregate(2.0, 2.0, 2.0, 6, statistic)  # of no width
        assert aggregate([2.0] * 5, statistic).text() == "2.0"
    assert aggregate([1.0, np.nan, 3.0], "mean").episodes == 2
    assert aggregate([np.nan], "median").text() == "–"
    assert aggregate([1.0, 2.0, 3.0, 4.0, np.inf, np.inf], "median").text() == "3.5 [1.0, inf]"
    none = aggregate(np.zeros(20), "share")
    assert none.value == none.low == 0.0 and 0.1 < none.high < 0.2
    assert paired_rmse([1.0, 3.0, np.nan], [2.0, np.nan, 5.0]) == (1.0, 2.0)  # of the landmarks that both mapped
    assert np.isnan(paired_rmse([1.0, np.nan], [np.nan, 2.0])).all()
