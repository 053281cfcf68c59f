"""How much of a score is the estimator's? The same policies and episodes with each estimator.

    python -m benchmarks.studies.estimators --scenarios paper clusters --rooms 64 --out results/store

Every run is flown to the end. Noise and landmarks are the same for each estimator; the motion is not quite, since the
controller follows the estimate. Prints a Markdown table for each scenario. The bound is that of `bound`, along the
paths of `ekf`; its "lost" is the expected number of an estimator that reaches it.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict, replace

import numpy as np

from activeslam_gym import config
from activeslam_gym.evaluation import Episode, honesty
from activeslam_gym.slam.estimator import EKF, ESTIMATORS
from agents.tools.sections import table
from agents.tools.statistics import estimate
from benchmarks.studies import NEES, parser, played, tasks
from benchmarks.studies.bound import Bound

POLICIES = ("sweep", "mi-mi", "random")
TIMES = (5.0, 15.0, 35.0)  # at which NEES and errors are read [s]
HEADER = (
    *("policy", "estimator", "NEES of position, orientation, landmarks at 5 · 15 · 35 s"),
    *("position error at 5 · 15 · 35 s, RMS, cm", "log score, median, bit", "lost", "ms a frame"),
)


def rows_of(policy: str, estimator: str, frame_time: float, runs: Sequence[Episode]) -> list[list[str]]:
    """The row of an estimator, and the bound's, where it was measured; times that a run does not reach are left out."""
    times = [time for time in TIMES if time <= runs[0].times[-1]]
    at = [[honesty(run, time) for run in runs] for time in times]
    nees = [", ".join(_mean([one[part] for one in rooms]) for part in NEES) for rooms in at]
    kept = [run for run in runs if not run.lost]
    frames = [round((run.times[-1] - run.times[0]) / len(run.step_us) / frame_time) for run in runs]
    spent = np.median([np.median(run.step_us) / count for run, count in zip(runs, frames)])  # not the compilation
    row = [
        f"`{policy}`",
        f"`{estimator}`",
        " · ".join(nees),
        _root_mean_squares([(run.times, run.position_error) for run in kept], times),
        estimate([run.log_score[-1] for run in runs], "median").text(1.0, 0),
        f"{sum(run.lost for run in runs)} of {len(runs)}",
        f"{spent / 1000.0:.2f}",
    ]
    if "bound" not in runs[0].notes:
        return [row]
    bound = _root_mean_squares([(run.times, run.notes["bound"][:, 0]) for run in kept], times)
    chances = sum(run.notes["chance"] for run in runs)
    return [[f"`{policy}`", "Cramér–Rao bound", "", bound, "", f"{chances:.1f} of {len(runs)}", ""], row]


def _root_mean_squares(curves: Sequence[tuple[np.ndarray, np.ndarray]], times: Sequence[float]) -> str:
    """Of curves (times, values) [m] at ``times``, in centimetres."""
    at = np.array([np.interp(times, *curve) for curve in curves]).reshape(-1, len(times))
    return " · ".join(f"{100.0 * value:.1f}" for value in np.sqrt((at**2).mean(axis=0)))


def _mean(values: Sequence[float]) -> str:
    """Mean of those that are known."""
    known = [value for value in values if not np.isnan(value)]
    return f"{np.mean(known):.2f}" if known else "–"


def main(arguments: Sequence[str] | None = None) -> None:
    """Play, and print the tables."""
    made = parser("estimators", __doc__, POLICIES, 8)
    made.add_argument("--seed", type=int, default=config.TRAINING_SEED, help="of the first room")
    made.add_argument("--scenarios", nargs="+", default=("paper", "clusters"), choices=tuple(config.SCENARIOS))
    made.add_argument("--estimators", nargs="+", default=tuple(ESTIMATORS.own), choices=tuple(ESTIMATORS))
    made.add_argument("--association", choices=(config.KNOWN, config.UNKNOWN), default=config.KNOWN)
    args = made.parse_args(arguments)
    known = args.association == config.KNOWN
    for name in args.scenarios:
        rows, frame_time = [], config.SCENARIOS[name].frame_time
        for policy in args.policies:
            for estimator in args.estimators:
                scenario = replace(config.SCENARIOS[name], association=args.association, estimator=estimator)
                settings = json.dumps({"scenario": asdict(scenario)})
                measures = (Bound,) if known and estimator == EKF and not scenario.has_bodies else ()
                group = {estimator: tasks(policy, settings, args.seed, args.rooms, *measures)}
                runs = played(group, args.out)[estimator]
                rows += rows_of(policy, estimator, frame_time, runs)
        title = f"{name}, association {args.association}: {args.rooms} rooms from {args.seed}"
        print(f"\n### {title}\n\n{table(HEADER, rows, '|---' * 5 + '|---:|---:|')}")


if __name__ == "__main__":
    main()
