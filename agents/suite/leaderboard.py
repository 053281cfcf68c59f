"""`python -m agents leaderboard`: the tables of all entries of a suite, and their performance profiles.

The statistics are those of Agarwal et al. (2021, Deep Reinforcement Learning at the Edge of the Statistical
Precipice): scores normalised in each scenario, their interquartile mean over scenarios, training seeds and episodes
with a stratified bootstrap, the probability of improvement, and profiles. Failures come first, since an interquartile
mean does not see them.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.stats import trim_mean

from agents.figures import save_figure
from agents.suite import entry as entries
from agents.suite.entry import Entry
from agents.suite.manifest import Suite, suite
from agents.tools.arguments import Figures, Pages
from agents.tools.sections import Table
from agents.tools.statistics import RESAMPLES, TAILS, Estimate, estimate

Array = NDArray[np.float64]
Scores = dict[str, Array]  # scenario → (P, E): training seeds, episodes
SECTION = "leaderboard"


@dataclass(frozen=True, kw_only=True)
class Args(Pages, Figures):
    """Make the leaderboard of the entries in a folder: tables, and performance profiles."""

    entries: Path = entries.FOLDER
    """Folder of the entries, NAME.json."""
    suite: str = "development"
    """Name of the suite; entries of others are left out."""
    out: Path = Path("results/leaderboard")
    """Folder of the picture."""


def main(args: Args) -> int:
    """Print the tables, and put them into the pages. Raises ValueError for a bad entry, or where there is none."""
    of = suite(args.suite)
    args.check_pages(SECTION)
    found = [one for path in sorted(args.entries.glob("*.json")) if (one := entries.read(path)).suite == of.name]
    if not found:
        raise ValueError(f"entries: {str(args.entries)!r} has no entry of the suite {of.name!r}")
    tables = board(of, found)
    print("\n\n".join(table.aligned() for table in tables))
    text = "\n\n".join([*(f"### {table.title}\n\n{table.markdown()}" for table in tables), LEGEND])
    args.publish("leaderboard", leaderboard=text)
    if args.drawn:
        print(f"Written to {profiles(of, found, args.out / 'profiles.png')}")
    return 0


LEGEND = (
    "Failures: episodes that were lost, or ended with a log score under 0. Normalised score: log score gained over the "
    "interquartile mean of the best open loop in the same scenario. IQM: interquartile mean, over scenarios, training "
    "seeds and episodes. Improvement: the probability to gain more than that open loop in the same episode, mean over "
    "scenarios. [ ]: 95 % interval; of a share Clopper and Pearson's, of the others by a bootstrap in each scenario."
)


def board(of: Suite, found: Sequence[Entry]) -> list[Table]:
    """The table of all scenarios, the best entry first, and the table of each scenario."""
    _check(of, found)
    best = {one: best_open_loop(of, found, one) for one in of.scenarios}
    normalised = {entry.name: _normalised(entry, best) for entry in found}
    means = {entry.name: aggregate(normalised[entry.name]) for entry in found}
    order = sorted(found, key=lambda entry: -means[entry.name].value)
    whole = [
        [
            entry.name,
            failures(entry).text(100.0),
            means[entry.name].text(digits=2),
            improvement(entry, best).text(100.0, 0),
            _training(entry, of),
        ]
        for entry in order
    ]
    each = [[entry.name, *(_iqm_text(entry.gains(one)) for one in of.scenarios)] for entry in order]
    header = ["entry", "failures, %", "normalised score (IQM)", "improvement, %", "training"]
    return [
        Table(f"All scenarios: {of.told}", header, whole),
        Table("Log score gained, bits (IQM)", ["entry", *of.scenarios], each),
        Table(
            "The best open loop", ["scenario", "entry"], [[scenario, entry.name] for scenario, entry in best.items()]
        ),
    ]


def best_open_loop(of: Suite, found: Sequence[Entry], scenario: str) -> Entry:
    """The entry of an open loop with the highest interquartile mean in a scenario.

    Raises:
        ValueError: there is no such entry, or the best gains nothing, so that no score can be normalised by it.
    """
    loops = [entry for entry in found if set(entry.policies) <= set(of.open_loops)]
    if not loops:
        raise ValueError(f"entries: none of an open loop; allowed: at least one of {', '.join(of.open_loops)}")
    best = max(loops, key=lambda entry: float(_iqm(entry.gains(scenario))))
    if _iqm(best.gains(scenario)) <= 0.0:
        raise ValueError(f"entries: no open loop gains anything in {scenario!r}")
    return best


def aggregate(scores: Scores) -> Estimate:
    """Interquartile mean over scenarios, training seeds and episodes, with its interval."""
    return _bootstrapped(scores, lambda tables: float(_iqm(np.concatenate([one.ravel() for one in tables]))))


def improvement(entry: Entry, best: Mapping[str, Entry]) -> Estimate:
    """The probability to gain more than the ``best`` open loop in the same episode; ties are halves."""
    gaps = {one: entry.gains(one) - loop.gains(one).mean(axis=0) for one, loop in best.items()}
    ahead = {one: 0.5 * (1.0 + np.sign(gap)) for one, gap in gaps.items()}
    return _bootstrapped(ahead, lambda tables: float(np.mean([one.mean() for one in tables])))


def failures(entry: Entry) -> Estimate:
    """The share of all episodes that failed."""
    return estimate(np.concatenate([entry.failed(one).ravel() for one in entry.scores]), "share")


def profiles(of: Suite, found: Sequence[Entry], path: Path) -> Path:
    """Draw of each entry the share of episodes whose normalised score is at least x: mean over scenarios."""
    from matplotlib.figure import Figure

    best = {one: best_open_loop(of, found, one) for one in of.scenarios}
    figure = Figure(figsize=(7.0, 4.0), layout="constrained")
    axes, at = figure.subplots(), np.linspace(-0.5, 2.0, 251)
    for entry in found:
        parts = [score.ravel() for score in _normalised(entry, best).values()]
        shares = np.mean([(part[:, None] >= at).mean(axis=0) for part in parts], axis=0)
        axes.plot(at, 100.0 * shares, label=entry.name)
    axes.set(xlabel="normalised log score x", ylabel="episodes with at least x, %", xlim=at[[0, -1]], ylim=(0.0, 100.0))
    axes.axvline(1.0, color="0.7", linewidth=0.8, zorder=0)
    axes.legend(fontsize=8)
    return save_figure(figure, path)


def _bootstrapped(scores: Scores, figure: Callable[[list[Array]], float]) -> Estimate:
    """A figure of the scenarios' tables (P, E), of which training seeds and episodes are drawn anew, each by itself."""
    tables, rng = list(scores.values()), np.random.default_rng(0)

    def resampled(table: Array) -> Array:
        rows, columns = (rng.integers(count, size=count) for count in table.shape)
        return table[np.ix_(rows, columns)]

    low, high = np.quantile([figure([resampled(one) for one in tables]) for _ in range(RESAMPLES)], TAILS)
    return Estimate(figure(tables), float(low), float(high), sum(one.size for one in tables), "IQM")


def _normalised(entry: Entry, best: Mapping[str, Entry]) -> Scores:
    return {one: entry.gains(one) / _iqm(loop.gains(one)) for one, loop in best.items()}


def _iqm(values: Array) -> float:
    return float(trim_mean(values, 0.25, axis=None))


def _iqm_text(gains: Array) -> str:
    return aggregate({"": gains}).text(digits=0)


def _training(entry: Entry, of: Suite) -> str:
    if not entry.training:
        return "none"
    count, few = len(entry.training), " (few)" if len(entry.training) < of.training_seeds else ""
    minutes = np.mean([float(one.get("seconds_trained", np.nan)) for one in entry.training]) / 60.0
    return f"{count} seeds{few}, {minutes:.0f} min each"


def _check(of: Suite, found: Sequence[Entry]) -> None:
    for entry in found:
        if (entry.manifest, entry.commit) != (of.digest, of.commit):
            raise ValueError(f"entries: {entry.name!r} is of another manifest or draw of the suite {of.name!r}")
    if len(counts := {entry.episodes for entry in found}) > 1:
        raise ValueError(f"entries: of {' and '.join(map(str, sorted(counts)))} episodes; allowed: the same of all")
