"""Are results about active SLAM, or about one filter? The same policies and episodes with each estimator.

    python -m studies.estimators --scenarios paper clusters --episodes 64 --report docs/estimators.md

Every episode is played to its end. Noise and landmarks are the same for each estimator; the motion is not quite, since
the controller follows the estimate. A pair of policies counts where the 95 % interval of its paired difference with
`ekf` excludes zero. Kendall's tau of another estimator is over those pairs: concordant less discordant, over all.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray
from scipy.stats import trim_mean

from activeslam_gym import config
from activeslam_gym.evaluation import Episode
from activeslam_gym.slam.estimator import EKF, ESTIMATORS
from agents.tools.sections import table
from agents.tools.statistics import MISSING, RESAMPLES, TAILS, estimate
from studies import command_line, mean, parser, played, publish, run, settings_of, tasks
from studies.measures import mean_nees

POLICIES = ("random", "stay", "sweep", "orbit", "mi-constant", "mi-mi", "mi-fisher", "joint-mi")
SCENARIOS = ("paper", "clusters", "office", "corner")
CONSISTENCY = ("scenario", "estimator", "lost, %", "NEES of the pose", "NEES of landmarks", "ms a frame")
RANKING = ("scenario", "estimator", "Kendall's tau", "pairs", "reversed", "log score over `ekf` [bit]")
Array = NDArray[np.float64]
Scores = Mapping[str, Array]  # policy → log score gained in each episode [bit]
Pair = tuple[str, str]


def consistency(runs: Sequence[Episode], frame_time: float) -> list[str]:
    """Cells of the first table, over the episodes of all policies."""
    frames = [round((run.times[-1] - run.times[0]) / len(run.step_us) / frame_time) for run in runs]
    spent = np.median([np.median(run.step_us) / count for run, count in zip(runs, frames)])  # not the compilation
    nees = [mean(values).text(1.0, 2) for values in mean_nees(runs)]
    return [estimate([run.lost for run in runs], "share").text(100.0), *nees, f"{spent / 1000.0:.2f}"]


def resolved(scores: Scores) -> list[Pair]:
    """Pairs of policies, the better one first, whose paired difference has an interval that excludes zero."""
    gaps = {(a, b): estimate(scores[a] - scores[b], "IQM") for a, b in combinations(scores, 2)}
    return [(a, b) if gap.low > 0.0 else (b, a) for (a, b), gap in gaps.items() if gap.low > 0.0 or gap.high < 0.0]


def ranking(base: Scores, own: Scores) -> list[str]:
    """Cells of the second table: Kendall's tau of ``own`` scores over the pairs that ``base`` resolves."""
    pairs, lead = resolved(base), np.mean([own[policy] - base[policy] for policy in base], axis=0)
    cells = [MISSING, "0", "0"]
    if pairs:
        gaps = np.array([own[a] - own[b] for a, b in pairs])  # (pairs, episodes)
        drawn = np.random.default_rng(0).integers(gaps.shape[1], size=(RESAMPLES, gaps.shape[1]))
        low, high = np.quantile(np.sign(trim_mean(gaps[:, drawn], 0.25, axis=2)).mean(axis=0), TAILS)
        signs = np.sign(trim_mean(gaps, 0.25, axis=1))
        cells = [f"{signs.mean():.2f} [{low:.2f}, {high:.2f}]", str(len(pairs)), str(np.count_nonzero(signs <= 0.0))]
    return [*cells, estimate(lead, "IQM").text(1.0, 0)]


def main(arguments: Sequence[str] | None = None) -> None:
    """Play, print the tables, and regenerate the page."""
    seed = config.TRAINING_SEED
    made = parser("estimators", __doc__, "estimators", policies=POLICIES, rooms=20, seed=seed)
    made.add_argument("--scenarios", nargs="+", default=SCENARIOS, choices=tuple(config.SCENARIOS))
    others = tuple(name for name in ESTIMATORS.own if name != EKF)
    made.add_argument("--estimators", nargs="*", default=others, choices=tuple(ESTIMATORS), help=f"beside {EKF}")
    made.add_argument("--association", choices=(config.KNOWN, config.UNKNOWN), default=config.KNOWN)
    args = made.parse_args(arguments)
    pairs = list(product(args.scenarios, dict.fromkeys((EKF, *args.estimators))))
    groups = {
        (*pair, policy): tasks(policy, settings, args.seed, args.rooms)
        for pair in pairs
        for settings in [settings_of(pair[0], association=args.association, estimator=pair[1])]
        for policy in args.policies
    }
    runs = played(groups, args.out, jobs=args.jobs)
    gains = {name: np.array([run.log_score[-1] - run.log_score[0] for run in of]) for name, of in runs.items()}

    def rows() -> Iterator[tuple[list[str], list[str]]]:
        for scenario, estimator in pairs:
            every = [one for policy in args.policies for one in runs[scenario, estimator, policy]]
            cells = consistency(every, config.SCENARIOS[scenario].frame_time)
            base, own = ({x: gains[scenario, name, x] for x in args.policies} for name in (EKF, estimator))
            yield [scenario, f"`{estimator}`", *cells], [scenario, f"`{estimator}`", *ranking(base, own)]

    first, second = zip(*rows())
    rest = [row for row in second if row[1] != f"`{EKF}`"]
    text = table(CONSISTENCY, first) + (f"\n\n{table(RANKING, rest)}" if rest else "")
    publish(args.report, "estimators", text, command_line("estimators", arguments))


if __name__ == "__main__":
    run(main)
