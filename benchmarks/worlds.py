"""Does deciding pay? The best open loops and the policies that decide, in rooms of each scenario.

    python -m benchmarks.worlds --scenarios office rooms --rooms 100 --out results/worlds.json

An open loop looks at nothing: the baselines ``best-constant`` and ``best-sequence``, chosen in rooms of training, and
``sweep``. All figures are of the scenario's own unseen rooms. Prints a table for each scenario and one of all, in
Markdown. What ``--out`` has already of a scenario and a policy, for the same rooms, is not played again: measure in
parts, and remove the file when the code has changed.
"""

import argparse
import dataclasses
import json
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

import activeslam_gym  # noqa: F401  (registers the environment)
from activeslam_gym.config import SCENARIOS, Scenario, benchmark_seed
from activeslam_gym.files import written_whole
from agents import policies
from agents.tools.statistics import estimate
from baselines import Predictor

PLACES = ("office", "corridor", "rooms", "clusters", "corner", "sprint", "noisy", "mixed")
DECIDING = ("mi-mi", "mi-fisher", "joint-mi", "ppo")
OPEN = ("best-constant", "sweep", "best-sequence")
PERIOD = 0.25
"""Gaze period [s]."""
NEES_STEPS = 20
"""The NEES is read once in so many steps."""
NEES = ("position", "orientation", "landmarks")
FIGURES = ("log_score", "landmarks", "lost", "contacts", *(f"{part}_nees" for part in NEES))

Choose = Callable[[Any, np.ndarray], np.ndarray]
"""(environment of B, observations) -> actions (B, 2)."""
Bind = Callable[[Any], Choose]
"""environment of B -> its policy."""
Figures = dict[str, list[float]]
"""By name, a number for each room."""


# Playing ------------------------------------------------------------------------------------------------------------


def play(scenario: str | Scenario, seeds: Sequence[int], bind: Bind) -> Figures:
    """Figures of one policy in the rooms ``seeds``; the NEES per degree of freedom is the mean over its unlost time."""
    made: dict[str, Any] = {"scenario": scenario, "gaze_period": PERIOD, "end_when_lost": False, "num_threads": 1}
    env: Any = gymnasium.make_vec("ActiveSLAM-v0", num_envs=len(seeds), autoreset_mode="DISABLED", **made)
    core = env.unwrapped
    observations, infos = env.reset(seed=list(seeds))
    choose, contacts, nees = bind(env), np.zeros(len(seeds)), []
    for step in range(int(core.setting.task.steps)):
        observations, _, _, _, infos = env.step(choose(core, observations))
        contacts += infos["events"]["wall_contacts"]
        if step % NEES_STEPS == NEES_STEPS - 1:
            told = core.nees()
            nees.append(np.where(infos["lost"], np.nan, [told[part] for part in NEES]))
    env.close()
    columns = (infos["log_score"], infos["distinct_landmarks"], infos["lost"], contacts, *_mean_of_known(nees))
    return {name: np.asarray(column, float).tolist() for name, column in zip(FIGURES, columns, strict=True)}


def _mean_of_known(rows: list[np.ndarray]) -> np.ndarray:
    """Mean over the rows of what is a number; NaN where nothing is."""
    told = np.array(rows)
    known = ~np.isnan(told)
    return np.where(known, told, 0.0).sum(axis=0) / np.where(known.any(axis=0), known.sum(axis=0), np.nan)


def named(name: str) -> Bind:
    """A policy as the commands know it."""
    return made(partial(policies.resolve, name))


def made(make: Callable[[Any], Predictor]) -> Bind:
    """A policy that ``make`` binds to an environment."""

    def bind(env: Any) -> Choose:
        policy, state = make(env), [None]

        def choose(core: Any, observations: np.ndarray) -> np.ndarray:
            action, state[0] = policy.predict(observations, state=state[0])
            return action

        return choose

    return bind


# What is kept -------------------------------------------------------------------------------------------------------


class Results:
    """Figures by scenario and policy, kept in a file."""

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self.all: dict[str, Any] = json.loads(path.read_text()) if path and path.exists() else {}

    def of(self, scenario: str, key: str, make: Callable[[], Any]) -> Any:
        """What is there, or made now."""
        known = self.all.setdefault(scenario, {})
        if key not in known:
            began = time.process_time()
            known[key] = make()
            print(f"{scenario}, {key}: {time.process_time() - began:.0f} s", flush=True)
            self._keep()
        return known[key]

    def _keep(self) -> None:
        if self._path:
            with written_whole(self._path) as unfinished:
                unfinished.write_text(json.dumps(self.all))


def measure(results: Results, scenario: str, args: argparse.Namespace) -> dict[str, Figures]:
    """By policy the figures of the scenario's own rooms, the open loops first."""
    seeds = range(benchmark_seed(scenario), benchmark_seed(scenario) + args.rooms)
    places = {"": SCENARIOS[scenario], ", boxes known": dataclasses.replace(SCENARIOS[scenario], boxes_known=True)}
    table: dict[str, Figures] = {}

    def put(name: str, bind: Bind, known: str = "") -> None:
        key = f"{name}{known}: {args.rooms} rooms"
        table[name + known] = results.of(scenario, key, lambda: play(places[known], seeds, bind))

    for name in (*OPEN, *args.policies):
        put(name, named(name))
    for name in args.boxes_known:
        put(name, named(name), ", boxes known")
    return table


# What is told -------------------------------------------------------------------------------------------------------


def text_of(scenario: str, table: dict[str, Figures]) -> str:
    """A Markdown table of one scenario, with paired differences to the best open loop, and of knowing the boxes."""
    reference = max((name for name in OPEN if name in table), key=lambda name: _median(table[name]))
    base = np.array(table[reference]["log_score"])
    lines = [
        f"\n### {scenario}: {len(base)} rooms from {benchmark_seed(scenario)}, against {reference}\n",
        "| policy | log score [bit] | paired difference [bit] | of its score | landmarks | lost | NEES/dof: position, "
        "orientation, landmarks | contacts |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name, one in table.items():
        score, partner = np.array(one["log_score"]), name.partition(",")[0]
        against = base if partner == name else np.array(table[partner]["log_score"])
        difference = estimate(score - against, "median")
        nees = ", ".join(f"{np.nanmean(one[f'{part}_nees']):.2f}" for part in NEES)
        lines.append(
            f"| {name} | {estimate(score, 'median').text(1.0, 0)} | {difference.text(1.0, 0)} "
            f"| {difference.value / abs(np.median(against)):+.0%} | {np.mean(one['landmarks']):.1f} "
            f"| {np.mean(one['lost']):.0%} | {nees} | {np.mean(one['contacts']):.0f} |"
        )
    return "\n".join(lines)


def _median(one: Figures) -> float:
    return float(np.median(one["log_score"]))


def summary(tables: dict[str, dict[str, Figures]]) -> str:
    """A Markdown table of policies and scenarios: share of the best policy's median log score."""
    rows: dict[str, list[str]] = {}
    for k, table in enumerate(tables.values()):
        medians = {name: _median(one) for name, one in table.items() if "," not in name}
        for name, median in medians.items():
            rows.setdefault(name, ["–"] * len(tables))[k] = f"{median / max(medians.values()):.2f}"
    lines = ["\n| policy | " + " | ".join(tables) + " |", "|---" * (len(tables) + 1) + "|"]
    return "\n".join([*lines, *(f"| {name} | " + " | ".join(row) + " |" for name, row in rows.items())])


def main(arguments: Sequence[str] | None = None) -> None:
    """Play, and print the tables."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.worlds", description=__doc__)
    parser.add_argument("--scenarios", nargs="+", default=PLACES, choices=tuple(SCENARIOS))
    parser.add_argument("--policies", nargs="+", default=DECIDING)
    parser.add_argument(
        "--boxes-known", nargs="+", default=(), help="of these, also with a belief that knows the boxes"
    )
    parser.add_argument("--rooms", type=int, default=100)
    parser.add_argument("--out", type=Path)
    args = parser.parse_args(arguments)
    if unpaired := set(args.boxes_known) - {*OPEN, *args.policies}:
        parser.error(f"argument --boxes-known: {', '.join(sorted(unpaired))} is not among the policies")
    results = Results(args.out)
    tables = {scenario: measure(results, scenario, args) for scenario in args.scenarios}
    for scenario, table in tables.items():
        print(text_of(scenario, table))
    print(summary(tables))


if __name__ == "__main__":
    main()
