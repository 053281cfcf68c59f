"""From episodes to tables: figures of each policy over episodes, and of policy against policy in the same episodes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from activeslam_gym.evaluation import Episode, outcome
from activeslam_gym.evaluation.code import code
from agents.tools.sections import Table, escaped
from agents.tools.statistics import FEW_EPISODES, LEGEND, Aggregate, Column, paired_rmse

DEGREES = 180.0 / np.pi

LEARNED = (
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
    Column("orientation_error", "orientation error, °", scale=DEGREES, digits=2),
)
HEADLINE = (*LEARNED[:2], LEARNED[-1], ERRORS[0])  # what the README shows of each policy
PAIRED = (
    LEARNED[0],
    Column("ahead", "ahead, % of episodes", "share", 100.0),
    *LEARNED[3:5],
    Column("landmark_rmse", "RMSE of landmarks mapped by both, cm", scale=100.0),
    *ERRORS[1:],
)
"""Of the differences in the same episode."""
Figures = dict[str, Aggregate]  # column → figure over episodes


@dataclass(frozen=True)
class Summary:
    """The figures of a comparison."""

    settings: dict[str, Any]  # the arguments and the versions
    policies: dict[str, Figures]  # policy → figures over its episodes
    paired: dict[str, dict[str, Figures]]
    """Reference → policy → figures of the differences policy − reference over the episodes of both."""
    notes: list[str]  # limits of the figures


def summarise(
    episodes: Sequence[Episode],
    reference: str = "mi-fisher",
    settings: dict[str, Any] | None = None,
) -> Summary:
    """Figures of `episodes`, and pairs against `reference` and the policy with the highest log score."""
    runs = grouped(episodes)
    rows = {
        name: {run.seed: outcome(run) | {"landmark_errors": run.landmark_errors} for run in of_policy}
        for name, of_policy in runs.items()
    }
    policies = {name: _figures(list(seen.values()), (*LEARNED, *ERRORS)) for name, seen in rows.items()}
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
    result = [
        _table(f"Results{star}", figures, LEARNED),
        _table(f"Errors at the end{star}", figures, ERRORS),
    ]
    for against, differences in summary.paired.items():
        result.append(_table(f"Difference to {against} in the same episodes{star}", differences, PAIRED))
    return result


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
    """A row per policy, a column per figure, and the number of episodes."""
    header = ["policy", *(column.heading for column in columns), "episodes"]
    rows = [
        [name, *(one.text(row[one.key]) for one in columns), str(row[columns[0].key].episodes)]
        for name, row in figures.items()
    ]
    return Table(title, header, rows)


Row = dict[str, Any]


def _figures(rows: Sequence[Row], columns: Sequence[Column]) -> Figures:
    return {column.key: column.of(rows) for column in columns}


def _difference(row: Row, other: Row) -> dict[str, float]:
    """Column → one − other, in one episode."""
    rmse, other_rmse = paired_rmse(row["landmark_errors"], other["landmark_errors"])
    apart = {one.source: row[one.source] - other[one.source] for one in PAIRED if one.source in row}
    return apart | {"landmark_rmse": rmse - other_rmse, "ahead": float(apart["log_score_gain"] > 0.0)}
