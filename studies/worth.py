"""The worth of each mechanism of the filter: what its removal costs, in the same training episodes.

    python -m studies.worth --out results/worth            # every row, resumable
    python -m studies.worth --rows base twins --scenarios paper --episodes 64

A row is a copy of the package to which a few lines are added that replace a function or a constant (`REMOVALS`), or
another checkout (``--checkouts NAME=PATH``), so that two versions can be compared. Every row plays the same seeds.
"""

import argparse
import csv
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from studies.removals import REMOVALS

ROOT = Path(__file__).parents[1]
PACKAGES = "activeslam_gym", "baselines", "agents", "studies"
SCENARIOS = "paper", "office", "corner", "clusters", "clutter", "rooms", "hand-held"
POLICIES = "mi-mi", "greedy-plus", "sweep", "generalist"
SEED = 4_300_600_000  # of the first training episode
FIELDS = "scenario", "policy", "seed", "lost", "log_score", "pose_nees", "landmark_nees"
BATCH = 64


def build(row: str, folder: Path, checkouts: dict[str, str]) -> Path:
    """The folder with the packages of a ``row``, made where it is not there."""
    target = folder / row
    if row in checkouts:
        return Path(checkouts[row]).resolve()
    if not target.exists():
        for package in PACKAGES:
            ignored = shutil.ignore_patterns("__pycache__", "entries")
            shutil.copytree(ROOT / package, target / package, ignore=ignored)
        for module, lines in REMOVALS[row].items():
            with open(target / "activeslam_gym" / f"{module}.py", "a") as file:
                file.write(f"\n\n{lines}\n")
    return target


def play_row(folder: Path, results: Path, wanted: list[tuple[str, str]], args: argparse.Namespace) -> None:
    """Play a row's missing episodes in a process of its own, which imports the packages in ``folder``."""
    done = {(one["scenario"], one["policy"]) for one in read(results)}
    missing = [f"{scenario}:{policy}" for scenario, policy in wanted if (scenario, policy) not in done]
    if missing:
        command = [sys.executable, str(Path(__file__).resolve()), "--play", str(results), *missing]
        threads = {"OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
        environment = {**os.environ, **threads, "PYTHONPATH": os.pathsep.join([str(folder), str(ROOT)])}
        options = ["--episodes", str(args.episodes), "--seed", str(args.seed)]
        subprocess.run([*command, *options], env=environment, cwd=folder, check=True)


def play_all(results: Path, tasks: list[str], episodes: int, seed: int) -> None:
    """Play ``scenario:policy`` tasks here, and append their episodes to the file ``results``."""
    from numba.core import event

    compiled = event.RecordingListener()
    event.register("numba:compile", compiled)
    for task in tasks:
        scenario, policy = task.split(":")
        began = time.perf_counter()
        rows = [episode for i in range(0, episodes, BATCH) for episode in
                _play(scenario, policy, range(seed + i, seed + min(i + BATCH, episodes)))]  # fmt: skip
        seconds = time.perf_counter() - began
        new = not results.exists()
        with open(results, "a", newline="") as file:
            writer = csv.DictWriter(file, FIELDS)
            if new:
                writer.writeheader()
            writer.writerows(rows)
        functions = {one.data["dispatcher"].py_func.__qualname__ for _, one in compiled.buffer if one.is_start}
        with open(results.with_suffix(".jsonl"), "a") as file:
            facts = {"task": task, "seconds": seconds, "functions": len(functions), "names": sorted(functions)}
            file.write(json.dumps(facts) + "\n")
        print(f"{results.stem} {task} {seconds:.0f} s", flush=True)


def _play(scenario: str, policy: str, seeds: range) -> list[dict[str, Any]]:
    """The episodes of ``seeds``, whole, in one batch."""
    import gymnasium as gym

    import activeslam_gym  # noqa: F401 (registers the environments)
    from agents.policies import factory

    name = "ActiveSLAMPixels-v0" if scenario.endswith("pixels") else "ActiveSLAM-v0"
    options: dict[str, Any] = {"scenario": scenario, "end_when_lost": False, "num_threads": 1}
    env: Any = gym.make_vec(name, num_envs=len(seeds), autoreset_mode="DISABLED", **options)
    chooser, state, over = factory(policy)(env, list(seeds)), None, np.zeros(len(seeds), bool)
    observation, info = env.reset(seed=list(seeds))
    first = np.ones(len(seeds), bool)
    while not over.all():
        action, state = chooser.predict(observation, state=state, episode_start=first, deterministic=True)
        observation, _, terminated, truncated, info = env.step(action)
        first, over = np.zeros(len(seeds), bool), terminated | truncated
    nees = [env.unwrapped.run(i).nees() for i in range(len(seeds))]
    columns = zip(seeds, info["lost"], info["log_score"], nees, strict=True)
    return [
        {"scenario": scenario, "policy": policy, "seed": s, "lost": int(lost), "log_score": f"{score:.6g}",
         "pose_nees": f"{of['position']:.4g}", "landmark_nees": f"{of['landmarks']:.4g}"}
        for s, lost, score, of in columns
    ]  # fmt: skip


def read(path: Path) -> list[dict[str, str]]:
    """The episodes in a file of results."""
    if not path.exists():
        return []
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


def compare(base: Iterable[dict[str, str]], other: Iterable[dict[str, str]]) -> dict[str, dict[str, float]]:
    """Scenario → paired differences of ``other`` from ``base``: failures [points], score, NEES."""
    pairs: dict[str, list[tuple[dict[str, str], dict[str, str]]]] = {}
    first = {(one["scenario"], one["policy"], one["seed"]): one for one in base}
    for one in other:
        if (key := (one["scenario"], one["policy"], one["seed"])) in first:
            pairs.setdefault(one["scenario"], []).append((first[key], one))
    return {scenario: _difference(found) for scenario, found in pairs.items()}


def _difference(found: list[tuple[dict[str, str], dict[str, str]]]) -> dict[str, float]:
    from scipy.stats import bootstrap, trim_mean

    def both(name: str) -> np.ndarray:
        return np.array([[float(one[name]) for one in pair] for pair in found]).T

    def points(base: np.ndarray, other: np.ndarray, axis: int = -1) -> np.ndarray:
        return 100.0 * (other - base).mean(axis=axis)

    def ratio(base: np.ndarray, other: np.ndarray, axis: int = -1) -> np.ndarray:
        return trim_mean(other, 0.25, axis=axis) / trim_mean(base, 0.25, axis=axis)

    out = {"base_lost": 100.0 * float(both("lost")[0].mean())}
    out["under_zero"] = float(np.diff((both("log_score") < 0.0).sum(axis=1))[0])
    for name, column, figure in (("lost", "lost", points), ("score", "log_score", ratio)):
        pair = both(column)
        out[name] = float(figure(*pair))
        ends = bootstrap(pair, figure, paired=True, n_resamples=2000, method="percentile", rng=0, vectorized=True)
        out[f"{name}_low"], out[f"{name}_high"] = ends.confidence_interval
    for name in ("pose_nees", "landmark_nees"):
        out[f"base_{name}"], out[name] = np.nanmedian(both(name), axis=1)
    return out


def main() -> None:
    """Play what is missing of every row, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("results/worth"))
    parser.add_argument("--rows", nargs="*", default=list(REMOVALS))
    parser.add_argument("--scenarios", nargs="*", default=SCENARIOS)
    parser.add_argument("--policies", nargs="*", default=POLICIES)
    parser.add_argument("--episodes", type=int, default=256)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--checkouts", nargs="*", default=[], metavar="NAME=PATH")
    parser.add_argument("--play", nargs="+", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.play:
        return play_all(Path(args.play[0]), args.play[1:], args.episodes, args.seed)
    checkouts = dict(one.split("=", 1) for one in args.checkouts)
    rows = list(dict.fromkeys(["base", *args.rows, *checkouts]))
    wanted = [(scenario, policy) for scenario in args.scenarios for policy in args.policies]
    (args.out / "builds").mkdir(parents=True, exist_ok=True)
    results = {row: (args.out / f"{row}.csv").resolve() for row in rows}
    folders = {row: build(row, args.out / "builds", checkouts).resolve() for row in rows}
    with ThreadPoolExecutor(args.jobs) as pool:
        list(pool.map(lambda row: play_row(folders[row], results[row], wanted, args), rows))
    base = read(results["base"])
    for row in rows[1:]:
        for scenario, d in compare(base, read(results[row])).items():
            interval = f"{d['lost']:+.1f} [{d['lost_low']:+.1f}, {d['lost_high']:+.1f}]"
            score = f"{d['score']:.3f} [{d['score_low']:.3f}, {d['score_high']:.3f}]"
            nees = (
                f"{d['base_pose_nees']:.2f}>{d['pose_nees']:.2f} {d['base_landmark_nees']:.2f}>{d['landmark_nees']:.2f}"
            )
            print(f"{row:20s} {scenario:10s} lost {d['base_lost']:.1f} {interval:22s} score {score}"
                  f"  <0 {d['under_zero']:+.0f}  NEES {nees}")  # fmt: skip


if __name__ == "__main__":
    main()
