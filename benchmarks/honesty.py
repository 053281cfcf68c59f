"""Is the filter honest with every policy? Lost runs, wrong matches and NEES over many rooms, labels known and unknown.

    python -m benchmarks.honesty --policies orbit sweep --rooms 400 --seed 6000000 --out results/honesty.json

Every run is flown to the end. Prints a Markdown table, which tells how many runs were begun anew, if any. Wrong matches
are counted in every frame, all matches in the last frame of each step of five, times five. What ``--out`` has already
is not played again: measure in parts, and remove the file when the code has changed.
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

import activeslam_gym  # noqa: F401  (registers the environment)
from activeslam_gym.config import KNOWN, SCENARIOS, UNKNOWN, Scenario
from activeslam_gym.slam.association import NEW, REJECTED
from agents.tools.statistics import estimate
from benchmarks.worlds import NEES, PERIOD, PLACES, Figures, Results, named

POLICIES = (
    "orbit",
    "mi-mi",
    "mi-fisher",
    "joint-mi",
    "fisher-fisher",
    "variance-reduction",
    "lookahead-2",
    "mi-constant",
    "sweep",
    "random",
    "stay",
)
SURE = 11.3
"""A loss is dishonest where the NEES of the position is over this: 99 % of chi-square with 3 degrees of freedom."""
TIMES = (5.0, 15.0, 35.0)
"""At which the NEES is read [s]."""
BATCH = 100
"""Rooms at a time."""
HEAD = (
    "| policy | lost, % | lost with NEES > 11.3, % | wrong matches, % | log score < 0, % | < −1000, % | its median "
    "| its mean | NEES of position, orientation, landmarks at 5 · 15 · 35 s |"
)


def play(policy: str, scenario: Scenario, seeds: Sequence[int]) -> Figures:
    """Figures of one policy in the rooms ``seeds``, by name: a number for each room."""
    made: dict[str, Any] = {"scenario": scenario, "gaze_period": PERIOD, "end_when_lost": False, "num_threads": 1}
    env: Any = gymnasium.make_vec("ActiveSLAM-v0", num_envs=len(seeds), autoreset_mode="DISABLED", **made)
    core, out = env.unwrapped, {name: np.zeros(len(seeds)) for name in ("wrong", "matches", "restarts")}
    observations, infos = env.reset(seed=list(seeds))
    choose, frames = named(policy)(env), int(core.setting.task.frames_per_step)
    out["sure"] = np.full(len(seeds), np.nan)
    for step in range(int(core.setting.task.steps)):
        observations, _, _, _, infos = env.step(choose(core, observations))
        out["wrong"] += infos["events"]["wrong_matches"]
        out["matches"] += frames * _matches(core)
        out["restarts"] += infos["events"]["restarts"]
        lost = np.asarray(infos["lost"])
        now = lost & np.isnan(out["sure"])
        out["sure"][now] = infos["position_nees"][now] > SURE
        time = (step + 1) * PERIOD
        if time in TIMES:
            out |= {f"{part} {time:g}": np.asarray(values) for part, values in core.nees().items()}
    env.close()
    out["lost"], out["sure"], out["score"] = lost, np.nan_to_num(out["sure"]), np.asarray(infos["log_score"])
    return {name: np.asarray(values, float).tolist() for name, values in out.items()}


def _matches(core: Any) -> np.ndarray:
    """Of each run, the detections of the last frame that were taken for something."""
    found = core._runs.candidate["match"]
    seen = np.arange(found.shape[1]) < core._runs.episode["detections"][:, None]
    return np.sum(seen & (found != NEW) & (found != REJECTED), axis=1)


def row_of(name: str, one: Figures) -> str:
    """A row of the table; NEES of the times that a run reaches."""
    if begun_anew := np.count_nonzero(one["restarts"]):
        name += f", {begun_anew} begun anew"
    lost, sure, score = (np.array(one[key]) for key in ("lost", "sure", "score"))
    wrong = 100.0 * np.sum(one["wrong"]) / max(np.sum(one["matches"]), 1.0)
    nees = " · ".join(
        ", ".join(f"{np.nanmean(one[f'{part} {time:g}']):.2f}" for part in NEES)
        for time in TIMES
        if f"{NEES[0]} {time:g}" in one
    )
    cells = [
        name,
        estimate(lost, "share").text(100.0),
        f"{100.0 * sure.mean():.1f}",
        f"{wrong:.4f}",
        *(f"{100.0 * np.mean(score < least):.1f}" for least in (0.0, -1000.0)),
        *(f"{figure:.0f}".replace("-", "−") for figure in (np.median(score), score.mean())),
        nees,
    ]
    return "| " + " | ".join(cells) + " |"


def main(arguments: Sequence[str] | None = None) -> None:
    """Play, and print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.honesty", description=__doc__)
    parser.add_argument("--policies", nargs="+", default=POLICIES)
    parser.add_argument("--rooms", type=int, default=400)
    parser.add_argument("--seed", type=int, default=6_000_000, help="of the first room")
    parser.add_argument("--scenario", choices=("paper", "clutter", "hall", *PLACES), default="paper")
    parser.add_argument(
        "--restarts",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="a belief that the fiducials contradict is begun anew",
    )
    parser.add_argument("--out", type=Path)
    args = parser.parse_args(arguments)
    results, rows = Results(args.out), []
    fields = f"{args.scenario}{'' if args.restarts else ', no restarts'}"
    for policy in args.policies:
        for association, told in ((UNKNOWN, ""), (KNOWN, ", labels known")):
            scenario = replace(SCENARIOS[args.scenario], association=association, restarts=args.restarts)
            one: Figures = {}
            for first in range(args.seed, args.seed + args.rooms, BATCH):
                seeds = range(first, min(first + BATCH, args.seed + args.rooms))
                part = results.of(fields, f"{policy}{told}, {seeds}", partial(play, policy, scenario, seeds))
                one = {name: one.get(name, []) + values for name, values in part.items()}
            rows.append(row_of(f"`{policy}`{told}", one))
    print("\n".join((HEAD, "|---" + "|---:" * 7 + "|---|", *rows)))


if __name__ == "__main__":
    main()
