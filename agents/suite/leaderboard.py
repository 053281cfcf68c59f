"""`python -m agents leaderboard`: the tables of all entries of a suite.

The statistics are those of Agarwal et al. (2021, Deep Reinforcement Learning at the Edge of the Statistical
Precipice): scores normalised in each scenario, their interquartile mean over scenarios, training seeds and episodes
with a stratified bootstrap, and the probability of improvement. Failures come first, since an interquartile
mean does not see them.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.figures import grid_of_panels, legend_below, save_figure
from agents.suite import enter
from agents.suite.enter import Entry
from agents.suite.manifest import Suite, suite
from agents.summary import FEWEST, RESAMPLES, TAILS, Aggregate, aggregate, ahead, interquartile_mean
from agents.tools.arguments import Pages, command_line
from agents.tools.files import write_csv
from agents.tools.sections import Table, provenance, put_section

Array = NDArray[np.float64]
SECTION, SHORT = "leaderboard", "board"  # sections of pages: all tables, and a few rows and columns of the first
SHORT_ROWS, SHORT_COLUMNS = (3, 2, 1), 4  # rows of learned entries, of others, and of open loops
KINDS = {"learned": ("tab:blue", "o"), "open loop": ("tab:orange", "^"), "greedy and others": ("black", "s")}
"""Colour and marker of each kind of entry in the figure."""


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
    entries = {path: enter.read(path) for path in sorted(args.entries.glob(f"*/{enter.FILE}"))}
    for path, entry in entries.items():
        if entry.name != path.parent.name:
            raise ValueError(f"entries: {str(path)!r} is named {entry.name!r}; allowed: the name of its folder")
    found = [entry for entry in entries.values() if entry.suite == of.name]
    for other in (one for one in entries.values() if one.suite != of.name):
        print(f"Left out: {other.name}, which is of the suite {other.suite}.")
    for short in (one for one in found if one.episodes < count):
        print(f"Left out: {short.name}, which has {short.episodes} of {count} episodes.")
    found = [one.first(count) for one in found if one.episodes >= count]
    if not found:
        raise ValueError(f"entries: {str(args.entries)!r} has no whole entry of the suite {of.name!r}")
    results = compared(of, found)
    whole, scenarios = tables(of, results)
    print(f"{whole.aligned()}\n\n{scenarios.aligned()}")
    parts = [provenance(command_line("agents leaderboard", args)), f"### {whole.title}", whole.markdown(), LEGEND]
    text = "\n\n".join([*parts, f"### {scenarios.title}", scenarios.markdown()])
    for page in args.report:
        if put_section(page, SECTION, text):
            write_csv(page.with_suffix(".csv"), rows_of(results))
            draw(of, results, page.parent / "images" / f"{SECTION}.png")
        put_section(page, SHORT, f"{shortened(whole, of, found).markdown()}\n\n{SHORT_LEGEND}")
    return 0


LEGEND = (
    "Failures: episodes that were lost, or gained a log score under 0. Normalised score: the gain over the "
    "interquartile mean of the best open-loop entry in the same scenario, which is held fixed. IQM: interquartile mean "
    "over scenarios, training seeds and episodes. Probability to gain more: than that entry in the "
    "same episode, mean over scenarios. [ ]: 95 % interval, by a bootstrap of training seeds, and of episodes in each "
    "scenario; of failures at least Clopper and Pearson's. With only five training seeds it is too narrow."
)


SHORT_LEGEND = "IQM: interquartile mean. In brackets: 95 % intervals. Gain: log score gained in the same episode."


@dataclass(frozen=True)
class InScenario:
    """Results of an entry in one scenario."""

    score: Aggregate  # interquartile mean of the log score gained [bit]
    lead: Aggregate  # interquartile mean of the lead over the best open-loop entry in the same episode [bit]
    failures: float  # share of its episodes


@dataclass(frozen=True)
class Result:
    """An entry and its results."""

    entry: Entry
    failures: Aggregate  # share of all episodes
    normalised: Aggregate  # interquartile mean of the normalised score
    ahead: Aggregate  # probability to gain more than the best open-loop entry in the same episode
    scenarios: dict[str, InScenario]


def compared(of: Suite, found: Sequence[Entry]) -> list[Result]:
    """The results of the entries, that with the highest normalised score first.

    Raises:
        ValueError: the entries are not of the same suite and episodes, or no open-loop entry can be the reference.
    """
    _check(of, found)
    best = [best_open_loop(of, found, one) for one in of.scenarios]  # (P, E) scores of each
    units = np.array([interquartile_mean(one.ravel()) for one in best])

    def result(entry: Entry) -> Result:
        gains, failed = (np.stack([part(one) for one in of.scenarios]) for part in (entry.gains, entry.failed))
        leads = np.stack([own - loop.mean(axis=0) for own, loop in zip(gains, best)])
        scores, lead = ([bootstrapped(one[None], interquartile_mean) for one in array] for array in (gains, leads))
        return Result(
            entry,
            failures(failed.astype(float)),
            bootstrapped(gains / units[:, None, None], interquartile_mean),
            bootstrapped(ahead(leads), mean),
            dict(zip(of.scenarios, map(InScenario, scores, lead, failed.mean(axis=(1, 2)).tolist()))),
        )

    return sorted(map(result, found), key=lambda one: -one.normalised.value)


def tables(of: Suite, results: Sequence[Result]) -> tuple[Table, Table]:
    """Every entry in all scenarios together, and in each scenario the best open-loop entry and the best of all."""
    header = ["entry", "failures, %", "normalised score (IQM)", "probability to gain more, %", "training", "note"]
    rows = [
        [one.entry.name, one.failures.text(100.0), one.normalised.text(digits=2), one.ahead.text(100.0, 0)]
        + [_training(one.entry, of), one.entry.note]
        for one in results
    ]
    title = f"All scenarios: suite {of.name}, manifest {of.digest}, {results[0].entry.episodes} episodes each"
    whole = Table(title, header, rows)
    score = "its log score, bits"
    header = ["scenario", "best open-loop entry", score, "best entry", score, "lead, bits"]
    loops = [one for one in results if of.is_open_loop(one.entry.policies)]
    rows = []
    for scenario in of.scenarios:
        loop, best = (max(some, key=lambda one: one.scenarios[scenario].score.value) for some in (loops, results))
        own = best.scenarios[scenario]
        cells = [one.text(digits=0) for one in (loop.scenarios[scenario].score, own.score, own.lead)]
        rows.append([scenario, loop.entry.name, cells[0], best.entry.name, *cells[1:]])
    return whole, Table("Each scenario", header, rows)


def rows_of(results: Sequence[Result]) -> list[dict[str, Any]]:
    """A row for each entry in each scenario: scores and leads [bit] with their intervals, and the share of failures."""
    rows = []
    for one in results:
        for scenario, own in one.scenarios.items():
            row: dict[str, Any] = {"entry": one.entry.name, "scenario": scenario}
            for name, part in (("log_score", own.score), ("lead", own.lead)):
                ends = zip(("", "_low", "_high"), (part.value, part.low, part.high))
                row |= {f"{name}{end}": round(value, 1) for end, value in ends}
            rows.append(row | {"failures": round(own.failures, 4)})
    return rows


def draw(of: Suite, results: Sequence[Result], path: Path) -> None:
    """Draw the normalised score of each entry against its failures, with both intervals."""
    figure, ((axes,),) = grid_of_panels(1, 1, (7.5, 4.8))
    labelled: list[tuple[float, float]] = []
    for one in results:
        kind = "open loop" if of.is_open_loop(one.entry.policies) else "greedy and others"
        kind = "learned" if one.entry.training else kind
        colour, marker = KINDS[kind]
        x, y = 100.0 * one.failures.value, one.normalised.value
        axes.plot([100.0 * one.failures.low, 100.0 * one.failures.high], [y, y], color=colour, linewidth=0.8)
        axes.plot([x, x], [one.normalised.low, one.normalised.high], color=colour, linewidth=0.8)
        axes.plot(x, y, marker, color=colour, label=kind)
        near = sum(abs(x - a) < 3.0 and abs(y - b) < 0.03 for a, b in labelled)  # their labels stand one under another
        place = 4.0, -2.0 - 9.0 * near if near else 4.0
        axes.annotate(one.entry.name, (x, y), place, textcoords="offset points", fontsize=8)
        labelled.append((x, y))
    axes.set(xlabel="failures, % of all episodes", ylabel="normalised score (interquartile mean)")
    axes.set_title(f"Entries of the suite {of.name}, with 95 % intervals", fontsize=10)
    legend_below(figure, [axes])
    save_figure(figure, path)


def shortened(whole: Table, of: Suite, found: Sequence[Entry]) -> Table:
    """The best rows of the table of all scenarios: `SHORT_ROWS` of each kind of entry, with its first columns."""
    kinds = {entry.name: 2 if of.is_open_loop(entry.policies) else int(not entry.training) for entry in found}
    names = [row[0] for row in whole.rows]
    kept = {name for k, most in enumerate(SHORT_ROWS) for name in [one for one in names if kinds[one] == k][:most]}
    rows = [row[:SHORT_COLUMNS] for row in whole.rows if row[0] in kept]
    header = [title.replace("gain more", "gain more than the best open-loop entry") for title in whole.header]
    return Table(whole.title, header[:SHORT_COLUMNS], rows)


def best_open_loop(of: Suite, found: Sequence[Entry], scenario: str) -> Array:
    """(P, E): the scores [bit] of the open-loop entry with the highest interquartile mean in a scenario.

    Raises:
        ValueError: there is no such entry, or the best gains nothing, so that no score can be normalised by it.
    """
    loops = [entry.gains(scenario) for entry in found if of.is_open_loop(entry.policies)]
    if not loops:
        raise ValueError(f"entries: none of an open loop; allowed: at least one of {', '.join(of.open_loops)}")
    best = max(loops, key=lambda gains: float(interquartile_mean(gains.ravel())))
    if interquartile_mean(best.ravel()) <= 0.0:
        raise ValueError(f"entries: no open-loop entry gains anything in {scenario!r}")
    return best


def failures(failed: Array) -> Aggregate:
    """The share of all episodes that failed, 1 in ``failed`` (S, P, E).

    Training seeds that play the same episodes are not independent. So the interval is the wider of the bootstrap's,
    which is empty where none failed, and of the exact one for so many episodes as one training seed plays.
    """
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
    """Training seeds, decisions and time, by the cards of weights; an own policy has no card."""
    count, few = len(entry.policies), " (few)" if len(entry.policies) < of.training_seeds else ""
    if not entry.training:
        return "not stated" if any(":" in one or one.endswith(".zip") for one in entry.policies) else "none"
    budgets = [[float(one.get(f"{key}_trained", np.nan)) for one in entry.training] for key in ("steps", "seconds")]
    decisions, seconds = np.max(budgets[0]), np.mean(budgets[1])
    budget = "" if np.isnan(decisions) else f", {decisions:,.0f} decisions"
    time = "" if np.isnan(seconds) else f", {seconds / 60.0:.0f} min each"
    return f"{count} seeds{few}{budget}{time}"


def _check(of: Suite, found: Sequence[Entry]) -> None:
    for entry in found:
        if (entry.manifest, entry.commit, tuple(entry.scores)) != (of.digest, of.commit, of.scenarios):
            raise ValueError(f"entries: {entry.name!r} is of another manifest or draw of the suite {of.name!r}")
    if len(counts := {entry.episodes for entry in found}) > 1:
        raise ValueError(f"entries: of {' and '.join(map(str, sorted(counts)))} episodes; allowed: the same of all")
