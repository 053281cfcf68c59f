"""How good the front end is where the truth is known: episodes of ``ActiveSLAMPixels-v0``, judged by ray-casting.

    python -m benchmarks.studies.images --rooms 100 --seed 3000000 --out results/store

Prints, for each policy, the NEES of the pose, lost runs and wrong matches; and the noise of all matched pixels.
"""

import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from activeslam_gym.evaluation import Episode
from activeslam_gym.metrics import camera_error, nees
from agents.task import Task
from benchmarks.studies import episodes, parser

TIMES = (5.0, 15.0, 35.0)
"""At which the NEES is read [s]."""
LAGS = (1, 5, 20)
"""Frames, of the correlation of a feature's errors."""


class PixelErrors:
    """A measure: errors of the matched pixels in every step, and the NEES of the pose.

    It adds ``matches``, their number; ``nees`` over 6 at `TIMES`, NaN where the run is over; ``square``, ``bias``,
    ``ratio`` and ``lag1`` …, means over the matches within 4 px: squared error, squared mean of a feature, error
    squared over R, and products of errors at lags.
    """

    whole = False

    def __init__(self) -> None:
        self._errors: list[np.ndarray] = []
        self._nees = np.full(len(TIMES), np.nan)

    def look(self, core: Any, info: dict[str, Any]) -> None:
        """Take the errors of the step's last frame."""
        if core.time > 0.0:
            self._errors.append(core.match_errors())
        if not info["lost"]:
            self._nees[np.isclose(TIMES, core.time)] = pose_nees(core)

    def result(self, episode: Episode) -> dict[str, Any]:
        """The means."""
        series: dict[int, list[tuple[int, np.ndarray]]] = {}
        for frame, rows in enumerate(self._errors):
            for one in rows[np.hypot(rows[:, 1], rows[:, 2]) < 4.0]:
                series.setdefault(int(one[0]), []).append((frame, one[1:]))
        total: dict[str, list[Any]] = {name: [] for name in ("square", "bias", "ratio", *(f"lag{k}" for k in LAGS))}
        for seen in series.values():
            at = {frame: one[:2] for frame, one in seen}
            total["bias"] += [np.mean(list(at.values()), axis=0) ** 2] if len(at) >= 20 else []
            total["square"] += [value**2 for value in at.values()]
            for lag in LAGS:
                total[f"lag{lag}"] += [at[f] * at[f + lag] for f in at if f + lag in at]
            for _, (u, v, a, b, c) in seen:
                total["ratio"].append((c * u * u - 2 * b * u * v + a * v * v) / (a * c - b * b) / 2.0)
        means = {name: float(np.mean(values)) if values else np.nan for name, values in total.items()}
        return {"matches": sum(map(len, self._errors)), "nees": self._nees, **means}


def pose_nees(core: Any) -> float:
    """NEES of position and rotation together, over 6."""
    ends = [
        np.concatenate((x.position, x.quaternion, x.velocity, x.angular_velocity)) for x in (core.truth, core.belief)
    ]
    return nees(camera_error(*ends)[:6], core.belief.covariance[:6, :6]) / 6.0


def summary(played: dict[str, list[Episode]]) -> str:
    """The table, and the noise over all runs."""
    lines = []
    for policy, runs in played.items():
        at = np.array([run.notes["nees"] for run in runs])
        ratios = [f"{np.nanmean(column):.2f}" for column in at.T if not np.isnan(column).all()]
        wrong = sum(run.events["wrong_matches"].sum() for run in runs) / sum(run.notes["matches"] for run in runs)
        lines.append(
            f"{policy}: {len(runs)} rooms, NEES of the pose per dof at {'/'.join(f'{t:g}' for t in TIMES)} s "
            f"{' / '.join(ratios)}, lost {sum(run.lost for run in runs)}, wrong matches {wrong:.2%}, "
            f"position error {100 * np.median([run.position_error[-1] for run in runs]):.1f} cm (median), "
            f"{np.median([run.distinct_landmarks[-1] for run in runs]):.0f} landmarks, "
            f"{np.median([run.step_us.mean() / 1e3 for run in runs]):.1f} ms a step"
        )
    every = [run.notes for runs in played.values() for run in runs]
    mean = {name: np.nanmean([one[name] for one in every]) for name in ("square", "bias", "ratio")}
    rho = [np.nanmean([one[f"lag{lag}"] for one in every]) / mean["square"] for lag in LAGS]
    lines.append(
        f"noise of a matched pixel: rms {mean['square'] ** 0.5:.3f} px, of a feature's own mean "
        f"{mean['bias'] ** 0.5:.3f} px, correlation after {', '.join(map(str, LAGS))} frames "
        f"{', '.join(f'{one:.2f}' for one in rho)}; square over R {mean['ratio']:.2f}"
    )
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> None:
    """Play, and print."""
    made = parser("images", __doc__, ("mi-fisher", "mi-mi"), 20)
    made.add_argument("--seed", type=int, default=3_000_000, help="R was fitted on rooms from 4000000 on")
    made.add_argument("--scenario", default="pixels", help="a name, or fields as JSON")
    made.add_argument("--seconds", type=float, default=35.0)
    args = made.parse_args(arguments)
    scenario = json.loads(args.scenario) if args.scenario.startswith("{") else args.scenario
    settings = json.dumps({"scenario": scenario, "duration": args.seconds, "end_when_lost": True})
    seeds = range(args.seed, args.seed + args.rooms)
    tasks = [Task(policy, seed, settings, measures=(PixelErrors,)) for seed in seeds for policy in args.policies]
    found = episodes(tasks, args.out, batch=1)
    print(summary({name: [found[task] for task in tasks if task.policy == name] for name in args.policies}))


if __name__ == "__main__":
    main()
