"""Is the filter consistent with every policy? Lost runs, wrong matches and NEES, labels known and unknown.

    python -m benchmarks.studies.consistency --policies orbit sweep --rooms 400 --seed 6000000 --out results/store

Every run is flown to the end. Prints a Markdown table, which tells how many runs were reset, if any. Wrong matches are
counted in every frame, all matches in the last frame of each step of five, times five.
"""

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from activeslam_gym import config
from activeslam_gym.evaluation import Episode, honesty, matched_ids
from agents.tools.sections import table
from agents.tools.statistics import estimate
from benchmarks.studies import NEES, SCENARIOS, parser, played, tasks

POLICIES = (
    "orbit mi-mi mi-fisher joint-mi fisher-fisher variance-reduction lookahead-2 mi-constant sweep random stay".split()
)
OVERCONFIDENT = 11.3 / 3.0
"""A loss is overconfident where the NEES of the position per degree of freedom is over this: 99 % of chi-square."""
TIMES = (5.0, 15.0, 35.0)  # at which the NEES is read [s]
HEADER = (
    *("policy", "lost, %", "lost with NEES > 3.8, %", "wrong matches, %", "log score < 0, %", "< −1000, %"),
    *("its median", "its mean", "NEES of position, orientation, landmarks at 5 · 15 · 35 s"),
)


class Matches:
    """A measure: ``matches`` of the episode, and whether it was ``overconfident`` when it was lost."""

    whole = False

    def __init__(self) -> None:
        self._matches, self._nees = 0, np.nan

    def look(self, core: Any, info: dict[str, Any]) -> None:
        """Count the matches of the last frame for every frame of the step."""
        if core.time > 0.0:
            self._matches += round(core.gaze_period / core.scenario.frame_time) * len(matched_ids(core))
        if info["lost"] and np.isnan(self._nees):
            self._nees = info["position_nees"]

    def result(self, episode: Episode) -> dict[str, Any]:
        """The count, and the test of the NEES."""
        return {"matches": self._matches, "overconfident": self._nees > OVERCONFIDENT}


def row_of(name: str, runs: Sequence[Episode]) -> list[str]:
    """A row of the table; NEES of the times that a run reaches."""
    if restarted := sum(run.events["restarts"].any() for run in runs):
        name += f", {restarted} reset"
    score = np.array([run.log_score[-1] for run in runs])
    wrong = sum(run.events["wrong_matches"].sum() for run in runs)
    at = {time: [honesty(run, time) for run in runs] for time in TIMES if time <= runs[0].times[-1]}
    nees = [", ".join(f"{np.nanmean([one[part] for one in rooms]):.2f}" for part in NEES) for rooms in at.values()]
    return [
        name,
        estimate([run.lost for run in runs], "share").text(100.0),
        f"{100.0 * np.mean([run.notes['overconfident'] for run in runs]):.1f}",
        f"{100.0 * wrong / max(sum(run.notes['matches'] for run in runs), 1):.4f}",
        *(f"{100.0 * np.mean(score < least):.1f}" for least in (0.0, -1000.0)),
        *(f"{figure:.0f}".replace("-", "−") for figure in (np.median(score), score.mean())),
        " · ".join(nees),
    ]


def main(arguments: Sequence[str] | None = None) -> None:
    """Play, and print the table."""
    made = parser("consistency", __doc__, POLICIES, 400)
    made.add_argument("--seed", type=int, default=6_000_000, help="of the first room")
    made.add_argument("--scenario", choices=("paper", "clutter", "hall", *SCENARIOS), default="paper")
    restarts = "reset a belief that the fiducials contradict"
    made.add_argument("--restarts", action=argparse.BooleanOptionalAction, default=True, help=restarts)
    args = made.parse_args(arguments)
    groups = {}
    for policy in args.policies:
        for association, told in ((config.UNKNOWN, ""), (config.KNOWN, ", labels known")):
            scenario = replace(config.SCENARIOS[args.scenario], association=association, restarts=args.restarts)
            settings = json.dumps({"scenario": asdict(scenario)})
            groups[f"`{policy}`{told}"] = tasks(policy, settings, args.seed, args.rooms, Matches)
    rows = [row_of(name, runs) for name, runs in played(groups, args.out).items()]
    print(table(HEADER, rows, "|---" + "|---:" * 7 + "|---|"))


if __name__ == "__main__":
    main()
