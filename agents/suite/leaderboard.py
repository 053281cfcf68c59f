"""`python -m agents leaderboard`: the tables of all entries of a suite.

The statistics are those of Agarwal et al. (2021, Deep Reinforcement Learning at the Edge of the Statistical
Precipice): scores normalised in each scenario, their interquartile mean over scenarios, training seeds and episodes
with a stratified bootstrap, and the probability of improvement. Failures come first, since an interquartile
mean does not see them.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from agents.suite import enter
from agents.suite.enter import Entry
from agents.suite.manifest import Suite, suite
from agents.summary import FEWEST, RESAMPLES, TAILS, Aggregate, aggregate, interquartile_mean
from agents.tools.arguments import Pages, command_line
from agents.tools.sections import Table, publish, put_section

Array = NDArray[np.float64]
SECTION, SHORT = "leaderboard", "board"  # sections of pages: all tables, and a few rows and columns of the first
SHORT_ROWS, SHORT_COLUMNS = 6, 4


@dataclass(frozen=True, kw_only=True)
class Args(Pages):
    """Make the leaderboard of the entries in a folder."""

    entries: Path = enter.FOLDER
    """Folder that holds NAME/entry.json for each entry."""
    suite: str = "development"
    """Suite whose entries are shown: a name, or a manifest of your own (NAME.json)."""
    episodes: int | None = None
    """Episodes of each scenario, from the first on; entries with fewer are left out."""


def main(args: Args) -> int:
    """Print the tables, and put them into the pages. Raises ValueError for a bad entry, or where there is none."""
    of = suite(args.suite)
    count = of.played(args.episodes)
    args.check_pages(SECTION, SHORT)
    found = [one for path in sorted(args.entries.glob(f"*/{enter.FILE}")) if (one := _read(path)).suite == of.name]
    for short in (one for one in found if one.episodes < count):
        print(f"Left out: {short.name}, which has {short.episodes} of {count} episodes.")
    found = [one.first(count) for one in found if one.episodes >= count]
    if not found:
        raise ValueError(f"entries: {str(args.entries)!r} has no whole entry of the suite {of.name!r}")
    tables = board(of, found)
    print("\n\n".join(table.aligned() for table in tables))
    text = "\n\n".join([*(f"### {table.title}\n\n{table.markdown()}" for table in tables), LEGEND])
    publish(args.report, SECTION, text, command_line("agents leaderboard", args))
    for page in args.report:
        put_section(page, SHORT, f"{shortened(tables[0], of, found).markdown()}\n\n{SHORT_LEGEND}")
    return 0


LEGEND = (
    "Failures: episodes that were lost, or gained a log score under 0. Normalised score: the gain over the "
    "interquartile mean of the best open-loop entry in the same scenario, which is held fixed. IQM: interquartile mean "
    "over scenarios, training seeds and episodes. Probability to gain more: than that entry in the "
    "same episode, mean over scenarios. [ ]: 95 % interval, by a bootstrap of training seeds, and of episodes in each "
    "scenario; of failures at least Clopper and Pearson's. With only five training seeds it is too narrow."
)


SHORT_LEGEND = "IQM: interquartile mean. In brackets: 95 % intervals. Gain: log score gained in the same episode."


def shortened(whole: Table, of: Suite, found: Sequence[Entry]) -> Table:
    """The best rows of the table of all scenarios, and that of the best open-loop entry, with its first columns."""
    loops = {entry.name for entry in found if set(entry.policies) <= set(of.open_loops)}
    names = [row[0] for row in whole.rows]
    best = next(name for name in names if name in loops)
    kept = {best, *[name for name in names if name != best][: SHORT_ROWS - 1]}
    rows = [row[:SHORT_COLUMNS] for row in whole.rows if row[0] in kept]
    header = [title.replace("gain more", "gain more than the best open-loop entry") for title in whole.header]
    return Table(whole.title, header[:SHORT_COLUMNS], rows)


def board(of: Suite, found: Sequence[Entry]) -> list[Table]:
    """The table of all scenarios, the best entry first, and tables with a column for each scenario."""
    _check(of, found)
    best = {one: best_open_loop(of, found, one) for one in of.scenarios}
    units = np.array([interquartile_mean(loop.gains(one).ravel()) for one, loop in best.items()])
    normalised = {one.name: bootstrapped(all_gains(one) / units[:, None, None], interquartile_mean) for one in found}
    order = sorted(found, key=lambda entry: -normalised[entry.name].value)
    ahead = {entry.name: leads(entry, best) for entry in order}
    whole = [
        [
            entry.name,
            failures(entry).text(100.0),
            normalised[entry.name].text(digits=2),
            bootstrapped(0.5 * (1.0 + np.sign(ahead[entry.name])), mean).text(100.0, 0),  # ties are halves
            _training(entry, of),
            entry.note,
        ]
        for entry in order
    ]

    def in_each(title: str, cells: Callable[[Entry], Iterable[str]]) -> Table:
        return Table(title, ["entry", *of.scenarios], [[entry.name, *cells(entry)] for entry in order])

    def iqms(scores: Array) -> list[str]:
        return [bootstrapped(one[None], interquartile_mean).text(digits=0) for one in scores]

    header = ["entry", "failures, %", "normalised score (IQM)", "probability to gain more, %", "training", "note"]
    lead = "Lead over the best open-loop entry in the same episode, bits (IQM)"
    return [
        Table(f"All scenarios: {of.label}, {found[0].episodes} episodes each", header, whole),
        in_each("Log score gained, bits (IQM)", lambda entry: iqms(all_gains(entry))),
        in_each(lead, lambda entry: iqms(ahead[entry.name])),
        in_each("Failures, %", lambda entry: (f"{100.0 * entry.failed(one).mean():.1f}" for one in of.scenarios)),
        Table("The best open-loop entry", ["scenario", "entry"], [[one, loop.name] for one, loop in best.items()]),
    ]


def best_open_loop(of: Suite, found: Sequence[Entry], scenario: str) -> Entry:
    """The entry of an open loop with the highest interquartile mean in a scenario.

    Raises:
        ValueError: there is no such entry, or the best gains nothing, so that no score can be normalised by it.
    """

    def gained(entry: Entry) -> float:
        return float(interquartile_mean(entry.gains(scenario).ravel()))

    loops = [entry for entry in found if set(entry.policies) <= set(of.open_loops)]
    if not loops:
        raise ValueError(f"entries: none of an open loop; allowed: at least one of {', '.join(of.open_loops)}")
    best = max(loops, key=gained)
    if gained(best) <= 0.0:
        raise ValueError(f"entries: no open-loop entry gains anything in {scenario!r}")
    return best


def all_gains(entry: Entry) -> Array:
    """(S, P, E): the scores [bit] of scenarios, training seeds and episodes."""
    return np.stack([entry.gains(one) for one in entry.scores])


def leads(entry: Entry, best: Mapping[str, Entry]) -> Array:
    """(S, P, E): what it gains more [bit] than the ``best`` open-loop entry of a scenario in the same episode."""
    return np.stack([entry.gains(one) - loop.gains(one).mean(axis=0) for one, loop in best.items()])


def failures(entry: Entry) -> Aggregate:
    """The share of all episodes that failed.

    Training seeds that play the same episodes are not independent. So the interval is the wider of the bootstrap's,
    which is empty where none failed, and of the exact one for so many episodes as one training seed plays.
    """
    failed = np.stack([entry.failed(one) for one in entry.scores]).astype(float)
    count = failed[:, 0].size
    exact = aggregate(np.arange(count) < round(count * failed.mean()), "share")
    drawn = bootstrapped(failed, mean)
    low, high = np.fmin(exact.low, drawn.low), np.fmax(exact.high, drawn.high)
    return Aggregate(float(failed.mean()), float(low), float(high), failed.size, "share")


def bootstrapped(scores: Array, figure: Callable[[Array], Array]) -> Aggregate:
    """A figure, (..., scores) -> (...), of ``scores`` (S, P, E); its interval is NaN for fewer than `FEWEST` episodes.

    A training seed is resampled with all its scenarios, since the same weights play them; episodes in each scenario.
    """
    (S, P, E), rng = scores.shape, np.random.default_rng(0)

    def resampled() -> Array:
        columns = rng.integers(E, size=(S, 1, E))
        return np.take_along_axis(scores[:, rng.integers(P, size=P)], columns, axis=2).ravel()

    low, high = np.nan, np.nan
    if E >= FEWEST:
        low, high = np.quantile(figure(np.stack([resampled() for _ in range(RESAMPLES)])), TAILS)
    return Aggregate(float(figure(scores.ravel())), float(low), float(high), scores.size, "mean")


def mean(scores: Array) -> Array:
    """(..., scores) -> (...)."""
    return np.asarray(scores.mean(axis=-1))


def _training(entry: Entry, of: Suite) -> str:
    """Training seeds and time, by the cards of weights; an own policy has no card."""
    count, few = len(entry.policies), " (few)" if len(entry.policies) < of.training_seeds else ""
    if not entry.training:
        return "not stated" if any(":" in one or one.endswith(".zip") for one in entry.policies) else "none"
    seconds = [float(one.get("seconds_trained", one.get("seconds", np.nan))) for one in entry.training]
    time = "" if np.isnan(seconds).any() else f", {np.mean(seconds) / 60.0:.0f} min each"
    return f"{count} seeds{few}{time}"


def _read(path: Path) -> Entry:
    entry = enter.read(path)
    if entry.name != path.parent.name:
        raise ValueError(f"entries: {str(path)!r} is named {entry.name!r}; allowed: the name of its folder")
    return entry


def _check(of: Suite, found: Sequence[Entry]) -> None:
    for entry in found:
        if (entry.manifest, entry.commit, tuple(entry.scores)) != (of.digest, of.commit, of.scenarios):
            raise ValueError(f"entries: {entry.name!r} is of another manifest or draw of the suite {of.name!r}")
    if len(counts := {entry.episodes for entry in found}) > 1:
        raise ValueError(f"entries: of {' and '.join(map(str, sorted(counts)))} episodes; allowed: the same of all")
