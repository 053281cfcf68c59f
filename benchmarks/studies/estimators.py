"""How much of a score is the estimator's? The same policies and episodes with each estimator, labels known.

    python -m benchmarks.studies.estimators --scenarios paper clusters --rooms 8 --out results/store

Every run is flown to the end. Noise and landmarks are the same for each estimator; the motion is not quite, since the
controller follows the estimate. Prints a Markdown table for each scenario. `fixed-lag` is left out where GTSAM is not
installed.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict, replace
from importlib.util import find_spec

import numpy as np

from activeslam_gym import config
from activeslam_gym.evaluation import Episode, honesty
from activeslam_gym.slam.estimator import EKF
from activeslam_gym.slam.fixed_lag import FIXED_LAG
from agents.tools.sections import table
from agents.tools.statistics import estimate
from benchmarks.studies import NEES, PERIOD, parser, played, tasks

ESTIMATORS = (EKF, FIXED_LAG)
POLICIES = ("sweep", "mi-mi", "random")
TIMES = (5.0, 15.0, 35.0)
"""At which NEES and errors are read [s]."""
HEADER = (
    *("policy", "estimator", "NEES of position, orientation, landmarks at 5 · 15 · 35 s"),
    *("position error at 5 · 15 · 35 s, median, cm", "log score, median, bit", "lost", "ms a frame"),
)


def row_of(policy: str, estimator: str, frame_time: float, runs: Sequence[Episode]) -> list[str]:
    """A row of the table; times that a run does not reach are left out."""
    times = [time for time in TIMES if time <= runs[0].times[-1]]
    at = [[honesty(run, time) for run in runs] for time in times]
    nees = [", ".join(_mean([one[part] for one in rooms]) for part in NEES) for rooms in at]
    errors = [np.median([np.interp(time, run.times, run.position_error) for run in runs]) for time in times]
    frames = [round((run.times[-1] - run.times[0]) / len(run.step_us) / frame_time) for run in runs]
    spent = np.median([np.median(run.step_us) / count for run, count in zip(runs, frames)])  # not the compilation
    return [
        f"`{policy}`",
        f"`{estimator}`",
        " · ".join(nees),
        " · ".join(f"{100.0 * error:.1f}" for error in errors),
        estimate([run.log_score[-1] for run in runs], "median").text(1.0, 0),
        f"{sum(run.lost for run in runs)} of {len(runs)}",
        f"{spent / 1000.0:.2f}",
    ]


def _mean(values: Sequence[float]) -> str:
    """Mean of those that are known."""
    known = [value for value in values if not np.isnan(value)]
    return f"{np.mean(known):.2f}" if known else "–"


def main(arguments: Sequence[str] | None = None) -> None:
    """Play, and print the tables."""
    made = parser("estimators", __doc__, POLICIES, 8)
    made.add_argument("--seed", type=int, default=config.TRAINING_SEED, help="of the first room")
    made.add_argument("--scenarios", nargs="+", default=("paper", "clusters"), choices=tuple(config.SCENARIOS))
    made.add_argument("--estimators", nargs="+", default=ESTIMATORS)
    args = made.parse_args(arguments)
    estimators = [name for name in args.estimators if name != FIXED_LAG or find_spec("gtsam")]
    if len(estimators) < len(args.estimators):
        print(f"`{FIXED_LAG}` is left out: GTSAM is not installed (pip install -e '.[gtsam]').")
    for name in args.scenarios:
        groups = {}
        for policy in args.policies:
            for estimator in estimators:
                scenario = replace(config.SCENARIOS[name], association=config.KNOWN, estimator=estimator)
                settings = json.dumps({"scenario": asdict(scenario), "gaze_period": PERIOD})
                groups[policy, estimator] = tasks(policy, settings, args.seed, args.rooms)
        frame_time = config.SCENARIOS[name].frame_time
        rows = [row_of(*key, frame_time, runs) for key, runs in played(groups, args.out).items()]
        print(f"\n### {name}: {args.rooms} rooms from {args.seed}\n\n{table(HEADER, rows, '|---' * 5 + '|---:|---:|')}")


if __name__ == "__main__":
    main()
