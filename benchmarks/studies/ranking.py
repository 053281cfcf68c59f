"""Does the ranking of policies survive another estimator? And what is a better estimator worth beside a better policy?

    python -m benchmarks.studies.ranking --rooms 64 --out results/store

Association is known. A pair of policies is resolved where the 95 % interval of its paired difference with `ekf` does
not hold zero. Kendall's tau of another estimator is over those pairs: concordant less discordant, over all. Its
interval is the bootstrap's over episodes. Prints Markdown tables, with every discordant pair.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import kendalltau, trim_mean

from activeslam_gym import config
from activeslam_gym.slam.estimator import EKF, ESTIMATORS
from agents.tools.sections import table
from agents.tools.statistics import MISSING, RESAMPLES, TAILS, estimate
from benchmarks.studies import parser, played, tasks

POLICIES = (
    "random stay sweep orbit mi-constant mi-mi mi-fisher fisher-fisher variance-reduction joint-mi lookahead-2".split()
)
SCENARIOS = ("paper", "clusters", "office", "corner")
Array = NDArray[np.float64]
Scores = Mapping[str, Array]  # policy → log score gained in each episode [bit]
Pair = tuple[str, str]


def resolved(scores: Scores) -> list[Pair]:
    """Pairs of policies, the better one first, whose paired difference has an interval that does not hold zero."""
    pairs = []
    for a, b in combinations(scores, 2):
        gap = estimate(scores[a] - scores[b], "IQM")
        if gap.low > 0.0:
            pairs.append((a, b))
        elif gap.high < 0.0:
            pairs.append((b, a))
    return pairs


def tau(scores: Scores, pairs: Sequence[Pair]) -> tuple[float, float, float]:
    """Kendall's tau of ``scores`` over ``pairs`` in their right order, and its interval; NaN where there are none."""
    if not pairs:
        return np.nan, np.nan, np.nan
    gaps = np.array([scores[a] - scores[b] for a, b in pairs])  # (pairs, episodes)
    drawn = np.random.default_rng(0).integers(gaps.shape[1], size=(RESAMPLES, gaps.shape[1]))
    taus = np.sign(trim_mean(gaps[:, drawn], 0.25, axis=2)).mean(axis=0)
    low, high = np.quantile(taus, TAILS)
    return float(np.sign(trim_mean(gaps, 0.25, axis=1)).mean()), float(low), float(high)


def compared(name: str, estimator: str, base: Scores, own: Scores) -> tuple[list[str], list[list[str]], list[str]]:
    """The rows of an estimator: of its ranking, of its discordant pairs, and of its worth; ``base`` is `ekf`'s."""
    pairs = resolved(base)
    value, low, high = tau(own, pairs)
    discordant = [(a, b) for a, b in pairs if trim_mean(own[a] - own[b], 0.25) <= 0.0]
    count = len(next(iter(own.values())))
    iqms = [[trim_mean(one[policy], 0.25) for policy in base] for one in (base, own)]
    shared = {policy: base[policy][:count] for policy in base}
    ranking = [
        *(name, f"`{estimator}`", f"{value:.2f} [{low:.2f}, {high:.2f}]" if pairs else MISSING),
        *(f"{len(discordant)} of {len(pairs)}", f"{kendalltau(*iqms).statistic:.2f}", str(count)),
    ]
    listed = [
        [name, f"`{estimator}`", f"`{a}` over `{b}`", _gap(base[a] - base[b]), _gap(own[a] - own[b])]
        for a, b in discordant
    ]
    gains = {policy: own[policy] - shared[policy] for policy in base}
    order = sorted(gains, key=lambda policy: trim_mean(gains[policy], 0.25))
    best, middle = _best_and_middle(own)
    worth = [
        *(name, f"`{estimator}`", _gap(np.mean([gains[policy] for policy in base], axis=0))),
        *(f"`{one}` {_gap(gains[one])}" for one in (order[0], order[-1])),
        f"`{best}` over `{middle}` {_gap(own[best] - own[middle])}",
    ]
    return ranking, listed, worth


def _best_and_middle(scores: Scores) -> Pair:
    order = sorted(scores, key=lambda policy: trim_mean(scores[policy], 0.25))
    return order[-1], order[len(order) // 2]


def _gap(values: Array) -> str:
    return estimate(values, "IQM").text(1.0, 0)


def main(arguments: Sequence[str] | None = None) -> None:
    """Play, and print the tables."""
    made = parser("ranking", __doc__, POLICIES, 20)
    made.add_argument("--seed", type=int, default=config.TRAINING_SEED, help="of the first room")
    made.add_argument("--scenarios", nargs="+", default=SCENARIOS, choices=tuple(config.SCENARIOS))
    others = [name for name in ESTIMATORS.own if name != EKF]
    made.add_argument("--estimators", nargs="+", default=others, choices=tuple(ESTIMATORS), help=f"beside {EKF}")
    args = made.parse_args(arguments)
    rankings, pairs, worths = [], [], []
    for name in args.scenarios:
        base: dict[str, Array] = {}
        for estimator in (EKF, *args.estimators):
            scenario = replace(config.SCENARIOS[name], association=config.KNOWN, estimator=estimator)
            settings = json.dumps({"scenario": asdict(scenario)})
            groups = {policy: tasks(policy, settings, args.seed, args.rooms) for policy in args.policies}
            runs = played(groups, args.out)
            own = {one: np.array([run.log_score[-1] - run.log_score[0] for run in runs[one]]) for one in args.policies}
            if estimator == EKF:
                base = own
                continue
            ranking, listed, worth = compared(name, estimator, base, own)
            rankings.append(ranking)
            pairs += listed
            worths.append(worth)
    header = ["scenario", "estimator"]
    tables = (
        ("Ranking", ["Kendall's tau, resolved pairs", "discordant", "tau of all (scipy)", "episodes"], rankings),
        ("Discordant pairs: difference [bit]", ["pair", "with `ekf`", "with it"], pairs),
        ("Worth [bit]", ["over `ekf`, mean of policies", "least", "most", "best policy over the middle one"], worths),
    )
    for title, columns, rows in tables:
        print(f"\n### {title}: rooms from {args.seed}\n\n{table([*header, *columns], rows)}")


if __name__ == "__main__":
    main()
