"""Does deciding pay? The best open-loop policies and policies that decide, in episodes of each scenario.

    python -m studies.worlds --scenarios office rooms --episodes 100 --out results/store

Open-loop policies are the baselines ``best-constant`` and ``best-sequence``, chosen in training episodes, and
``sweep``; ``--open`` names others, such as those of `studies.rules`. All figures are of the scenario's own
held-out episodes, or of those from ``--seed`` on. Prints a table for each scenario and one of all.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import tyro

from activeslam_gym import config
from activeslam_gym.evaluation import Episode
from agents.tools.sections import Table, table
from agents.tools.statistics import MISSING, estimate
from studies import Study, played, run, settings_of, tasks

SCENARIOS = ("office", "corridor", "rooms", "clusters", "corner", "sprint", "noisy", "mixed")
DECIDING = ("mi-mi", "mi-fisher", "joint-mi", "ppo")
OPEN = ("best-constant", "sweep", "best-sequence")
HEADER = ("policy", "log score [bit]", "paired difference [bit]", "lost, %", "under 0, %", "landmarks")


def log_scores(runs: Sequence[Episode]) -> np.ndarray:
    """(episodes,) at the end [bit]."""
    return np.array([one.log_score[-1] for one in runs])


def text_of(scenario: str, runs: Mapping[str, Sequence[Episode]], references: Sequence[str]) -> str:
    """A table of one scenario, by policy, with paired differences to the best of the ``references``."""
    scores = {name: log_scores(own) for name, own in runs.items()}
    reference = max(references, key=lambda name: np.median(scores[name]))
    rows = [
        [
            f"`{name}`",
            estimate(scores[name], "median").text(1.0, 0),
            estimate(scores[name] - scores[reference], "median").text(1.0, 0),
            *(f"{100.0 * np.mean(failed):.0f}" for failed in ([one.lost for one in own], scores[name] < 0.0)),
            f"{np.mean([one.distinct_landmarks[-1] for one in own]):.1f}",
        ]
        for name, own in runs.items()
    ]
    head = f"{scenario}: {len(scores[reference])} episodes from {runs[reference][0].seed}, against {reference}"
    return f"\n### {head}\n\n{table(HEADER, rows)}"


def shares_of_best(medians: Mapping[str, Mapping[str, float]]) -> Table:
    """Policies × scenarios, from scenario → policy → median log score: its share of the best one; a dash under 0."""
    rows: dict[str, list[str]] = {}
    for of_policy in medians.values():
        best = max(of_policy.values())
        for policy, median in of_policy.items():
            rows.setdefault(policy, [policy]).append(f"{median / best:.2f}" if best > 0 else MISSING)
    return Table("Share of the best policy's median log score gain", ["policy", *medians], list(rows.values()))


@dataclass(frozen=True, kw_only=True)
class Args(Study):
    """The best open-loop policies and policies that decide, in episodes of each scenario."""

    policies: tuple[str, ...] = DECIDING
    """Policies that decide, named as for compare."""
    open: tuple[str, ...] = OPEN
    """Open-loop policies, of which the best is the reference."""
    scenarios: tuple[str, ...] = SCENARIOS
    """Scenarios, by their names."""
    seed: int | None = None  # type: ignore[assignment]
    """Seed of the first episode; that of the scenario's held-out episodes if not given."""
    corners: bool = False
    """Use the sensor `corners` in place of images."""


def main(args: Args) -> None:
    """Play, and print the tables."""
    fields: dict[str, Any] = {"sensor": "corners"} if args.corners else {}
    names = dict.fromkeys((*args.open, *args.policies))
    first = {one: config.benchmark_seed(one) if args.seed is None else args.seed for one in args.scenarios}
    groups = {
        (scenario, name): tasks(name, settings_of(scenario, **fields), first[scenario], args.episodes)
        for scenario in args.scenarios
        for name in names
    }
    runs, medians = played(groups, args.out, workers=args.workers), {}
    for scenario in args.scenarios:
        own = {name: runs[scenario, name] for name in names}
        medians[scenario] = {name: float(np.median(log_scores(of))) for name, of in own.items()}
        print(text_of(scenario, own, args.open))
    print(f"\n{shares_of_best(medians).markdown()}")


if __name__ == "__main__":
    run(lambda: main(tyro.cli(Args, prog="python -m studies.worlds")))
