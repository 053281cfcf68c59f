"""How good the front end is where the truth is known: episodes of ``ActiveSLAMPixels-v0``, judged by ray-casting.

    python -m studies.images --rooms 100 --seed 3000000 --out results/store

Prints, for each policy, the log score, the NEES of the pose and of the landmarks, their depths, lost runs and wrong
matches; and the noise of all matched pixels.
"""

import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from activeslam_gym.evaluation import Episode
from activeslam_gym.metrics import camera_error, nees
from agents.tools.sections import table as markdown
from agents.tools.statistics import bootstrap_interval
from studies import SECONDS, parser, played, run, settings_of, tasks

TIMES = (5.0, 15.0, 35.0)  # at which the NEES is read [s]
LAGS = (1, 5, 20)  # frames, of the correlation of a feature's errors
HEADER = (
    *("policy", "log score, median [bit]", "under 0, lost, either"),
    *("NEES/dof at 5 / 15 / 35 s [95 % interval of the last] (greatest): pose", "landmarks"),
    *("depths, estimated over true", "wrong matches", "position error, median [cm]", "landmarks mapped", "ms a step"),
)


class PixelErrors:
    """A measure: errors of the matched pixels in every step, the NEES of the pose, and the depths of the landmarks.

    It adds ``matches``, their number; at `TIMES`, NaN where the run is over, ``nees`` over 6 and ``depth``, the median
    of estimated over true distance; ``square``, ``bias``,
    ``ratio`` and ``lag1`` …, means over the matches within 4 px: squared error, squared mean of a feature that is seen
    20 times or more, error squared over R, and products of errors at lags.
    """

    whole = False

    def __init__(self) -> None:
        self._errors: list[np.ndarray] = []
        self._nees, self._depth = np.full((2, len(TIMES)), np.nan)

    def look(self, core: Any, info: dict[str, Any]) -> None:
        """Take the errors of the step's last frame."""
        if core.time > 0.0:
            self._errors.append(core.match_errors())
        now = np.isclose(TIMES, core.time)
        if now.any() and not info["lost"]:
            ratios = core.depth_ratios()
            self._nees[now] = pose_nees(core)
            self._depth[now] = np.median(ratios) if len(ratios) else np.nan

    def result(self, episode: Episode) -> dict[str, Any]:
        """The means."""
        rows, frames = np.concatenate(self._errors), np.repeat(range(len(self._errors)), list(map(len, self._errors)))
        near = np.hypot(rows[:, 1], rows[:, 2]) < 4.0
        u, v, a, b, c = rows[near, 1:].T
        ids, k = np.unique(rows[near, 0], return_inverse=True)
        errors = np.full((len(ids), len(self._errors), 2), np.nan)
        errors[k, frames[near]] = rows[near, 1:3]
        often = errors[(~np.isnan(errors[:, :, 0])).sum(axis=1) >= 20]
        return {
            "matches": len(rows),
            "nees": self._nees,
            "depth": self._depth,
            "square": _mean(errors**2),
            "bias": _mean(np.array([np.nanmean(one, axis=0) for one in often]) ** 2),
            "ratio": _mean((c * u * u - 2 * b * u * v + a * v * v) / (a * c - b * b) / 2.0),
            **{f"lag{lag}": _mean(errors[:, :-lag] * errors[:, lag:]) for lag in LAGS},
        }


def _mean(values: np.ndarray) -> float:
    """Over the values that are there; NaN where there are none."""
    known = values[~np.isnan(values)]
    return float(known.mean()) if known.size else np.nan


def pose_nees(core: Any) -> float:
    """NEES of position and rotation together, over 6."""
    ends = [
        np.concatenate((x.position, x.quaternion, x.velocity, x.angular_velocity)) for x in (core.truth, core.belief)
    ]
    return nees(camera_error(*ends)[:6], core.belief.covariance[:6, :6]) / 6.0


def landmark_nees(run: Episode) -> np.ndarray:
    """Mean over the mapped landmarks at `TIMES`; NaN where the run is over or lost."""
    held = [run.times[-1] >= t - 0.5 and not run.lost_from <= t for t in TIMES]
    nearest = np.abs(run.times[:, None] - TIMES).argmin(axis=0)
    return np.where(held, run.landmark_nees[nearest], np.nan)


def _means(rows: np.ndarray) -> str:
    """Of each column of ``rows`` (n, 3) with a number."""
    return " / ".join(f"{np.nanmean(column):.2f}" for column in rows.T if not np.isnan(column).all())


def _nees(rows: np.ndarray) -> str:
    """The means of ``rows`` (n, 3), the 95 % bootstrap interval of the last column's, and the greatest number."""
    if np.isnan(rows).all():
        return ""
    low, high = bootstrap_interval(rows[~np.isnan(rows[:, -1]), -1], lambda drawn: drawn.mean(axis=1))
    interval = "" if np.isnan(low) else f" [{low:.2f}, {high:.2f}]"
    return f"{_means(rows)}{interval} ({np.nanmax(rows):.1f})"


def summary(by_policy: dict[str, list[Episode]]) -> str:
    """The table, and the noise over all runs."""
    rows = []
    for policy, runs in by_policy.items():
        scores = np.array([run.log_score[-1] for run in runs])
        lost = np.array([run.lost for run in runs])
        pose, depth = (np.array([run.notes[name] for run in runs]) for name in ("nees", "depth"))
        wrong = sum(run.events["wrong_matches"].sum() for run in runs) / sum(run.notes["matches"] for run in runs)
        rows.append([
            f"{policy}, {len(runs)} rooms",
            f"{np.median(scores):.0f}",
            ", ".join(f"{np.mean(one):.0%}" for one in (scores < 0.0, lost, lost | (scores < 0.0))),
            _nees(pose),
            _nees(np.array([landmark_nees(run) for run in runs])),
            _means(depth),
            f"{wrong:.2%}",
            f"{100 * np.median([run.position_error[-1] for run in runs]):.1f}",
            f"{np.mean([run.distinct_landmarks[-1] for run in runs]):.1f}",
            f"{np.median([run.step_us.mean() / 1e3 for run in runs]):.1f}",
        ])  # fmt: skip
    names = ("square", "bias", "ratio", *(f"lag{lag}" for lag in LAGS))
    every = [run.notes for runs in by_policy.values() for run in runs]
    square, bias, ratio, *products = (_mean(np.array([one[name] for one in every])) for name in names)
    noise = (
        f"noise of a matched pixel: rms {square**0.5:.3f} px, of a feature's own mean {bias**0.5:.3f} px, correlation "
        f"after {', '.join(map(str, LAGS))} frames {', '.join(f'{one / square:.2f}' for one in products)}; "
        f"square over R {ratio:.2f}"
    )
    return f"{markdown(HEADER, rows)}\n\n{noise}"


def main(arguments: Sequence[str] | None = None) -> None:
    """Play, and print."""
    made = parser("images", __doc__, policies=("mi-fisher", "mi-mi"), rooms=20, seed=3_000_000)
    made.add_argument("--scenario", default="pixels", help="a name, or fields as JSON")
    made.add_argument("--seconds", type=SECONDS, default=35.0)
    made.add_argument("--gaze-period", type=float, help="of a step, whose last frame is measured; default: a frame")
    args = made.parse_args(arguments)
    period = args.gaze_period or json.loads(settings_of(args.scenario))["scenario"]["frame_time"]
    times = {"gaze_period": period, "duration": args.seconds, "end_when_lost": True}
    settings = settings_of(args.scenario, times)
    groups = {policy: tasks(policy, settings, args.seed, args.rooms, PixelErrors) for policy in args.policies}
    print(summary(played(groups, args.out, batch=1, jobs=args.jobs)))


if __name__ == "__main__":
    run(main)
