"""Does deciding pay? The best open-loop policies and policies that decide, in rooms of each scenario.

    python -m studies.worlds --scenarios office rooms --rooms 100 --out results/store

Open-loop policies are the baselines ``best-constant`` and ``best-sequence``, chosen in training episodes, and
``sweep``; ``--open`` names others, such as those of `studies.rules`. All figures are of the scenario's own
held-out episodes, or of those from ``--seed`` on. Prints a table for each scenario and one of all.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from activeslam_gym import config
from activeslam_gym.evaluation import Episode
from agents.compare.generalise import shares_of_best
from agents.task import Task
from agents.tools.sections import table as markdown
from agents.tools.statistics import estimate
from studies import NEES, SCENARIOS, parser, played, run, settings_of, tasks

DECIDING = ("mi-mi", "mi-fisher", "joint-mi", "ppo")
OPEN = ("best-constant", "sweep", "best-sequence")
NEES_PERIOD = 5.0  # the NEES is the mean over samples at multiples of this [s], while the belief is not lost
KNOWN = ", boxes known"
HEADER = (
    *("policy", "log score [bit]", "paired difference [bit]", "of its score", "landmarks", "lost, under 0"),
    *("NEES/dof: position, orientation, landmarks", "contacts"),
)

Runs = dict[str, list[Episode]]  # by policy, an episode for each room


def tasks_of(scenario: str, name: str, seed: int, rooms: int, **fields: Any) -> list[Task]:
    """For each room from ``seed`` on, with these ``fields`` of the scenario; a name that ends in `KNOWN` is a policy
    whose belief knows the boxes."""
    fields |= {"boxes_known": True} if name.endswith(KNOWN) else {}
    return tasks(name.removesuffix(KNOWN), settings_of(scenario, **fields), seed, rooms)


def log_scores(runs: Sequence[Episode]) -> np.ndarray:
    """(rooms,) at the end [bit]."""
    return np.array([run.log_score[-1] for run in runs])


def nees(run: Episode, name: str) -> float:
    """Mean of a NEES over the time in which the belief is not lost; NaN where it is never known."""
    lost = run.times >= (np.inf if np.isnan(run.lost_from) else run.lost_from)
    values = getattr(run, name)[(run.times > 0) & np.isclose(run.times % NEES_PERIOD, 0.0) & ~lost]
    known = values[~np.isnan(values)]
    return float(known.mean()) if len(known) else np.nan


def text_of(scenario: str, table: Runs, references: Sequence[str]) -> str:
    """A table of one scenario, with paired differences to the best of the ``references``, and of knowing the boxes."""
    scores = {name: log_scores(runs) for name, runs in table.items()}
    reference = max(references, key=lambda name: np.median(scores[name]))
    rows = []
    for name, runs in table.items():
        partner = name.removesuffix(KNOWN)
        against = scores[reference if partner == name else partner]
        difference = estimate(scores[name] - against, "median")
        rows.append([
            name,
            estimate(scores[name], "median").text(1.0, 0),
            difference.text(1.0, 0),
            f"{difference.value / abs(np.median(against)):+.0%}",
            f"{np.mean([run.distinct_landmarks[-1] for run in runs]):.1f}",
            f"{np.mean([run.lost for run in runs]):.0%}, {np.mean(scores[name] < 0.0):.0%}",
            ", ".join(f"{np.nanmean([nees(run, part) for run in runs]):.2f}" for part in NEES),
            f"{np.mean([run.events['wall_contacts'].sum() for run in runs]):.0f}",
        ])  # fmt: skip
    head = f"{scenario}: {len(scores[reference])} rooms from {table[reference][0].seed}, against {reference}"
    return f"\n### {head}\n\n{markdown(HEADER, rows)}"


def main(arguments: Sequence[str] | None = None) -> None:
    """Play, and print the tables."""
    made = parser("worlds", __doc__, policies=DECIDING, rooms=100, seed=None)
    made.add_argument("--scenarios", nargs="+", default=SCENARIOS, choices=tuple(config.SCENARIOS))
    made.add_argument("--open", nargs="+", default=OPEN, help="policies whose best is the reference")
    made.add_argument("--boxes-known", nargs="+", default=(), help="of these, also with a belief that knows the boxes")
    made.add_argument("--corners", action="store_true", help="the sensor `corners` in the place of images")
    args = made.parse_args(arguments)
    fields = {"sensor": "corners"} if args.corners else {}
    names = dict.fromkeys((*args.open, *args.policies, *(name + KNOWN for name in args.boxes_known)))
    if unpaired := set(args.boxes_known) - set(names):
        made.error(f"argument --boxes-known: {', '.join(sorted(unpaired))} is not among the policies")
    first = {s: config.benchmark_seed(s) if args.seed is None else args.seed for s in args.scenarios}
    groups = {(s, name): tasks_of(s, name, first[s], args.rooms, **fields) for s in args.scenarios for name in names}
    runs = played(groups, args.out, jobs=args.jobs)
    tables = {scenario: {name: runs[scenario, name] for name in names} for scenario in args.scenarios}
    for scenario, table in tables.items():
        print(text_of(scenario, table, args.open))
    medians = {
        scenario: {name: float(np.median(log_scores(of_name))) for name, of_name in table.items() if KNOWN not in name}
        for scenario, table in tables.items()
    }
    print(f"\n{shares_of_best(medians).markdown()}")


if __name__ == "__main__":
    run(main)
