"""From episodes to the study's figures: per policy over rooms, and policy against policy in the same rooms."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import baselines
from activeslam_gym.evaluation import Episode, honesty, outcome
from agents.bounds.share import BASE, PLANNER, shares
from agents.tools.statistics import Estimate, Statistic, estimate, paired_rmse

MOST_LOST = 0.25
"""A policy that is lost in a greater share of the rooms has no headline."""
FEW_ROOMS = 20
"""With fewer rooms the intervals are a hint: the summary says so."""


@dataclass(frozen=True)
class Column:
    """A figure over rooms and how it is shown: its title, the factor to the title's unit, the digits after the point.

    A key that ends in ``_median`` is another statistic of the column without it.
    """

    key: str
    title: str
    statistic: Statistic = "median"
    scale: float = 1.0
    digits: int = 1


LEARNED = (
    Column("log_score_gain_median", "log score gain, bits"),
    Column("log_score_under_0", "under 0, %", "share", 100.0),
    Column("log_score_under_minus_1000", "under −1000, %", "share", 100.0),
    Column("log_score_gain", "log score gain, bits", "IQM"),
    Column("bits", "bits removed", "IQM"),
    Column("landmarks_mapped", "mapped", "IQM"),
    Column("distinct_landmarks", "distinct", "IQM"),
    Column("lost", "lost, %", "share", 100.0),
)
"""A single confident error, a landmark taken for another, takes thousands of bits of the log score, so its mean has no
interval. Median and interquartile mean tell of the usual room, and two shares of the rooms that were wrong and sure."""
ERRORS = (
    Column("landmark_rmse", "landmark RMSE, cm", scale=100.0),
    Column("position_error", "position error, cm", scale=100.0),
    Column("orientation_error", "orientation error, °", scale=180.0 / np.pi, digits=2),
)
SPEED = (
    Column("target_reached", "reach {target}, %", "share", 100.0),
    Column("target_time", "at, s"),
    Column("target_log2_det", "log₂|P| then"),
    Column("decision_us", "µs per decision"),
)
PAIRED = (
    LEARNED[0],
    Column("ahead", "ahead, % of rooms", "share", 100.0),
    *LEARNED[3:5],
    Column("landmark_rmse", "RMSE of landmarks mapped by both, cm", scale=100.0),
    *ERRORS[1:],
)
"""Of the differences in the same room."""
STATISTICS = {column.key: column.statistic for column in (*LEARNED, *ERRORS, *SPEED)}
"""Which figure over rooms stands for which column of episodes.csv."""


@dataclass(frozen=True)
class Summary:
    """The study's figures."""

    settings: dict[str, Any]
    """What was run."""
    policies: dict[str, dict[str, Estimate]]
    """Policy → column → figure over its rooms."""
    honesty: dict[str, dict[str, dict[str, Estimate]]]
    """Policy → time [s] → ANEES (mean) and median NEES, per degree of freedom, over the runs alive."""
    paired: dict[str, dict[str, dict[str, Estimate]]]
    """Reference → policy → column → figure of the differences policy − reference over the rooms of both."""
    best_baseline: str | None
    """The baseline with the most bits, if one was run."""
    notes: list[str]
    """What a reader has to know beside the figures."""
    shares: dict[str, Estimate] = field(default_factory=dict)
    """Policy → its share of the planner's lead over the best constant in the log score, where both were run."""


def summarise(
    episodes: Sequence[Episode],
    reference: str = "mi-fisher",
    target_landmarks: int = 14,
    honesty_times: Sequence[float] = (5.0, 15.0, 35.0),
    settings: dict[str, Any] | None = None,
) -> Summary:
    """Figures of `episodes`, and pairs against `reference`, the best baseline (most bits) and the highest log score."""
    by_policy = grouped(episodes)
    policies = {name: _figures(runs, target_landmarks) for name, runs in by_policy.items()}
    best = best_baseline(policies)
    wanted = dict.fromkeys((reference, best, by_log_score(policies)[0]))
    references = [name for name in wanted if name in policies and len(policies) > 1]
    return Summary(
        settings=settings or {},
        policies=policies,
        honesty={name: {f"{t:g}": _honesty(runs, t) for t in honesty_times} for name, runs in by_policy.items()},
        paired={
            against: {
                name: _paired(runs, by_policy[against], target_landmarks)
                for name, runs in by_policy.items()
                if name != against
            }
            for against in references
        },
        best_baseline=best,
        notes=_notes(by_policy, policies, reference, target_landmarks),
        shares=_shares(by_policy),
    )


def grouped(episodes: Sequence[Episode]) -> dict[str, list[Episode]]:
    """Policy → its episodes by seed, in the order in which the policies first appear."""
    by_policy: dict[str, list[Episode]] = {}
    for episode in sorted(episodes, key=lambda e: e.seed):
        by_policy.setdefault(episode.policy, []).append(episode)
    return {name: by_policy[name] for name in dict.fromkeys(e.policy for e in episodes)}


def best_baseline(policies: dict[str, dict[str, Estimate]]) -> str | None:
    """The baseline with the most bits, or None where none was run."""
    candidates = [name for name in policies if name in baselines.names()]
    return max(candidates, key=lambda name: policies[name]["bits"].value, default=None)


def by_log_score(policies: dict[str, dict[str, Estimate]]) -> list[str]:
    """The policies, the highest median log score gain first: one room in a hundred can make a mean."""
    return sorted(policies, key=lambda name: -policies[name]["log_score_gain_median"].value)


def _figures(runs: Sequence[Episode], target_landmarks: int) -> dict[str, Estimate]:
    """Column → figure over the rooms of one policy."""
    rows = [outcome(run, target_landmarks) for run in runs]
    return {key: estimate([row[_column(key)] for row in rows], statistic) for key, statistic in STATISTICS.items()}


def _column(key: str) -> str:
    """The column of episodes.csv on which a figure stands."""
    return key.removesuffix("_median")


def _honesty(runs: Sequence[Episode], time: float) -> dict[str, Estimate]:
    """ANEES and median NEES at `time` over the runs alive."""
    rows = [honesty(run, time) for run in runs]
    statistics: dict[str, Statistic] = {"": "mean", "_median": "median"}
    return {
        key + suffix: estimate([row[key] for row in rows], statistic)
        for key in rows[0]
        for suffix, statistic in statistics.items()
    }


def _paired(runs: Sequence[Episode], others: Sequence[Episode], target_landmarks: int) -> dict[str, Estimate]:
    """Figures of the differences in the rooms that both policies saw."""
    other_of = {other.seed: other for other in others}
    pairs = [(run, other_of[run.seed]) for run in runs if run.seed in other_of]
    differences = [_difference(run, other, target_landmarks) for run, other in pairs]
    return {one.key: estimate([row[one.key] for row in differences], one.statistic) for one in PAIRED}


def _difference(run: Episode, other: Episode, target_landmarks: int) -> dict[str, float]:
    """Column → run − other, in one room."""
    row, other_row = outcome(run, target_landmarks), outcome(other, target_landmarks)
    own, others = paired_rmse(run.landmark_errors, other.landmark_errors)
    apart = {one.key: row[name] - other_row[name] for one in PAIRED if (name := _column(one.key)) in row}
    return apart | {"landmark_rmse": own - others, "ahead": float(apart["log_score_gain"] > 0.0)}


def _shares(by_policy: dict[str, list[Episode]]) -> dict[str, Estimate]:
    """See `Summary.shares`."""
    if not {PLANNER, BASE} <= set(by_policy):
        return {}
    gained = {
        name: {run.seed: float(run.log_score[-1] - run.log_score[0]) for run in runs}
        for name, runs in by_policy.items()
    }
    return shares(gained, PLANNER, BASE)


def _notes(
    by_policy: dict[str, list[Episode]],
    policies: dict[str, dict[str, Estimate]],
    reference: str,
    target_landmarks: int,
) -> list[str]:
    """The headline, and what limits it."""
    rooms = min(len(runs) for runs in by_policy.values())
    notes = [_headline(by_policy, policies, target_landmarks)]
    if rooms < FEW_ROOMS:
        notes.append(f"* From {rooms} room(s): fewer than {FEW_ROOMS} give a hint, no finding.")
    if reference not in policies:
        notes.append(f"The reference {reference} was not run: no paired differences against it.")
    return notes


def _headline(
    by_policy: dict[str, list[Episode]], policies: dict[str, dict[str, Estimate]], target_landmarks: int
) -> str:
    """Who learned most by the log score, and its lead in the same rooms; nobody who is lost too often, or lost bits."""
    barred = {name: reason for name, figures in policies.items() if (reason := _barred(figures))}
    out = "; ".join(f"{name} {reason}" for name, reason in barred.items())
    left_out = f" Not in the running: {out}." if out else ""
    running = [name for name in by_log_score(policies) if name not in barred]
    if not running:
        return f"No policy has won anything.{left_out}"
    first, *others = running
    gain = policies[first]["log_score_gain_median"].text()
    headline = f"Highest median log score gain (overconfidence cannot win it): {first}, {gain} bits"
    if not others:
        return f"{headline}.{left_out}"
    lead = _paired(by_policy[first], by_policy[others[0]], target_landmarks)["log_score_gain_median"]
    return f"{headline}; its lead over {others[0]} in the same rooms: {lead.text()} bits.{left_out}"


def _barred(figures: dict[str, Estimate]) -> str:
    """Why a policy cannot have the headline, or nothing."""
    if figures["lost"].value > MOST_LOST:
        return f"is lost in {100 * figures['lost'].value:.0f} % of the rooms"
    return "has a median log score gain of 0 or less" if figures["log_score_gain_median"].value <= 0 else ""
