"""Does deciding pay? Every constant action, the open loops and the policies that decide, in rooms of each scenario.

    python -m benchmarks.worlds --scenarios office rooms --rooms 100 --out results/worlds.json

The constant is chosen in rooms of training, as are the sequences of held actions (``--sequences 200``); all figures are
of the scenario's own unseen rooms. Prints a table for each scenario and one of all, in Markdown. What ``--out`` has
already of a scenario and a policy, for the same rooms, is not played again: measure in parts, and remove the file when
the code has changed.
"""

import argparse
import json
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

import activeslam_gym  # noqa: F401  (registers the environment)
from activeslam_gym.config import SCENARIOS, TRAINING_SEED, benchmark_seed
from activeslam_gym.files import written_whole
from activeslam_gym.motion import GAZE_COUNT, MOTION_COUNT, Gaze, Motion
from agents import policies
from agents.tools.statistics import estimate

PLACES = ("office", "rooms", "clusters", "corner", "sprint", "noisy", "mixed")
DECIDING = ("mi-fisher", "mi-mi", "joint-mi", "lookahead-2", "ppo")
OPEN = ("sweep",)
PERIOD = 0.25
"""Gaze period [s]."""
CONSTANTS = [f"{Motion(i // GAZE_COUNT).name}+{Gaze(i % GAZE_COUNT).name}" for i in range(MOTION_COUNT * GAZE_COUNT)]
FIGURES = ("log_score", "gain", "landmarks", "lost", "nees", "contacts")

Choose = Callable[[Any, np.ndarray], np.ndarray]
"""(environment of B, observations) -> actions (B, 2)."""


def play(scenario: Any, seeds: Sequence[int], bind: Callable[[Any], Choose]) -> dict[str, list[float]]:
    """Figures of one policy, a number for each of the rooms ``seeds``."""
    made = {"scenario": scenario, "gaze_period": PERIOD, "end_when_lost": False, "num_threads": 1}
    env: Any = gymnasium.make_vec("ActiveSLAM-v0", num_envs=len(seeds), autoreset_mode="DISABLED", **made)
    core = env.unwrapped
    observations, infos = env.reset(seed=list(seeds))
    choose, contacts, first = bind(env), np.zeros(len(seeds)), infos["entropy"].copy()
    nees: list[np.ndarray] = []
    for step in range(int(core.setting.task.steps)):
        observations, _, _, _, infos = env.step(choose(core, observations))
        contacts += infos["events"]["wall_contacts"]
        if step % 20 == 19:
            nees.append(np.where(infos["lost"], np.nan, infos["position_nees"] / 3.0))
    env.close()
    with np.errstate(all="ignore"):
        told = np.array(nees)
        mean = np.where(np.isnan(told).all(axis=0), np.nan, np.nansum(told, axis=0) / (~np.isnan(told)).sum(axis=0))
    columns = (infos["log_score"], first - infos["entropy"], infos["distinct_landmarks"], infos["lost"], mean, contacts)
    return {name: np.asarray(column, float).tolist() for name, column in zip(FIGURES, columns, strict=True)}


def named(name: str) -> Callable[[Any], Choose]:
    """A constant action by its name, or a policy as the commands know it."""
    if name in CONSTANTS:
        return held([CONSTANTS.index(name)], [1.0])

    def bind(env: Any) -> Choose:
        policy, state = policies.resolve(name, env), [None]

        def choose(core: Any, observations: np.ndarray) -> np.ndarray:
            action, state[0] = policy.predict(observations, state=state[0])
            return action

        return choose

    return bind


def held(actions: Sequence[int], shares: Sequence[float]) -> Callable[[Any], Choose]:
    """Actions that are held one after the other, each for its share of the episode."""
    ends = np.cumsum(shares) / np.sum(shares)

    def bind(env: Any) -> Choose:
        def choose(core: Any, observations: np.ndarray) -> np.ndarray:
            k = int(np.searchsorted(ends, core.time[0] / core.duration, side="right"))
            return np.tile(np.divmod(actions[min(k, len(actions) - 1)], GAZE_COUNT), (len(observations), 1))

        return choose

    return bind


def best_sequence(scenario: str, count: int, seeds: Sequence[int]) -> tuple[list[int], list[float]]:
    """The best of ``count`` random sequences of up to four held actions, by the median log score in rooms ``seeds``."""
    rng, best, chosen = np.random.default_rng(0), -np.inf, ([0], [1.0])
    for _ in range(count):
        length = int(rng.integers(1, 5))
        sequence = rng.integers(len(CONSTANTS), size=length).tolist(), rng.uniform(0.2, 1.0, length).tolist()
        median = float(np.median(play(scenario, seeds, held(*sequence))["log_score"]))
        if median > best:
            best, chosen = median, sequence
    return chosen


class Results:
    """Figures by scenario and policy, kept in a file."""

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self.all: dict[str, Any] = json.loads(path.read_text()) if path and path.exists() else {}

    def of(self, scenario: str, policy: str, seeds: range, bind: Callable[[Any], Choose]) -> dict[str, list[float]]:
        """The figures, played if they are not there."""
        known = self.all.setdefault(scenario, {})
        key = f"{policy} {seeds.start}+{len(seeds)}"
        if key not in known:
            began = time.process_time()
            known[key] = play(scenario, list(seeds), bind)
            score = np.median(known[key]["log_score"])
            print(f"{scenario} {key}: {score:.0f} bit, {time.process_time() - began:.0f} s", flush=True)
            self.keep()
        return known[key]

    def keep(self) -> None:
        """Write the file."""
        if self._path:
            with written_whole(self._path) as unfinished:
                unfinished.write_text(json.dumps(self.all))


def measure(results: Results, scenario: str, args: argparse.Namespace) -> dict[str, dict[str, list[float]]]:
    """By policy the figures of the scenario's own rooms; ``best-constant`` and ``best-sequence`` among them."""
    training = range(TRAINING_SEED, TRAINING_SEED + args.training)
    seeds = range(benchmark_seed(scenario), benchmark_seed(scenario) + args.rooms)
    scores = {name: results.of(scenario, name, training, named(name))["log_score"] for name in CONSTANTS}
    best = max(CONSTANTS, key=lambda name: float(np.median(scores[name])))
    table = {f"best-constant ({best})": results.of(scenario, best, seeds, named(best))}
    if args.sequences:
        kept = results.all.setdefault("sequences", {})
        key = f"{scenario} {args.sequences} {args.training}"
        if key not in kept:
            kept[key] = best_sequence(scenario, args.sequences, list(training))
        table["best-sequence"] = results.of(scenario, f"best-sequence of {key}", seeds, held(*kept[key]))
    for name in (*OPEN, *args.policies):
        table[name] = results.of(scenario, name, seeds, named(name))
    return table


def is_open(name: str) -> bool:
    """Whether a policy of the table looks at nothing."""
    return name.startswith("best-") or name in OPEN


def text_of(scenario: str, table: dict[str, dict[str, list[float]]]) -> str:
    """A Markdown table of one scenario, with paired differences to the best open loop."""
    reference = max(filter(is_open, table), key=lambda name: float(np.median(table[name]["log_score"])))
    base = np.array(table[reference]["log_score"])
    lines = [
        f"\n### {scenario}: {len(base)} rooms from {benchmark_seed(scenario)}, against {reference}\n",
        "| policy | log score [bit] | paired difference [bit] | share | landmarks | lost | NEES/dof | contacts |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name, one in table.items():
        score = np.array(one["log_score"])
        difference = "" if name == reference else estimate(score - base, "median").text(1.0, 0)
        share = np.median(score) / np.median(base)
        lines.append(
            f"| {name} | {estimate(score, 'median').text(1.0, 0)} | {difference} | {share:.2f} "
            f"| {np.mean(one['landmarks']):.1f} | {np.mean(one['lost']):.1%} | {np.nanmean(one['nees']):.2f} "
            f"| {np.mean(one['contacts']):.0f} |"
        )
    return "\n".join(lines)


def summary(tables: dict[str, dict[str, dict[str, list[float]]]]) -> str:
    """A Markdown table of policies and scenarios: share of the best policy's median log score."""
    rows: dict[str, list[str]] = {}
    for k, table in enumerate(tables.values()):
        medians = {name.split(" ")[0]: float(np.median(one["log_score"])) for name, one in table.items()}
        for name, median in medians.items():
            rows.setdefault(name, ["–"] * len(tables))[k] = f"{median / max(medians.values()):.2f}"
    lines = ["\n| policy | " + " | ".join(tables) + " |", "|---" * (len(tables) + 1) + "|"]
    return "\n".join([*lines, *(f"| {name} | " + " | ".join(row) + " |" for name, row in rows.items())])


def main(arguments: Sequence[str] | None = None) -> None:
    """Play, and print the tables."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.worlds", description=__doc__)
    parser.add_argument("--scenarios", nargs="+", default=PLACES, choices=tuple(SCENARIOS))
    parser.add_argument("--policies", nargs="+", default=DECIDING)
    parser.add_argument("--rooms", type=int, default=100)
    parser.add_argument("--training", type=int, default=16, help="rooms in which constant and sequence are chosen")
    parser.add_argument("--sequences", type=int, default=0, help="random sequences of up to four held actions")
    parser.add_argument("--out", type=Path)
    args = parser.parse_args(arguments)
    results = Results(args.out)
    tables = {scenario: measure(results, scenario, args) for scenario in args.scenarios}
    for scenario, table in tables.items():
        print(text_of(scenario, table))
    print(summary(tables))


if __name__ == "__main__":
    main()
