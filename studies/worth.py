"""The worth of each mechanism of the filter: the loss by its removal, in the same training episodes.

    python -m studies.worth  # every row; goes on where it stopped
    python -m studies.worth --rows iteration crowded --scenarios paper clutter --episodes 64
    python -m studies.worth --checkouts earlier=../clone-of-an-earlier-commit
    python -m studies.worth --report docs/worth.md  # fills the page from studies/worth.csv, and plays nothing

A row is a copy of the packages with a few more lines (`studies.removals`), or another checkout. Its `agents compare`
plays the episodes. Differences to the row ``base`` are paired, with 95 % bootstrap intervals over episodes.
"""

import csv
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from activeslam_gym import BEHAVIOUR
from agents.tools.files import write_csv
from agents.tools.sections import put_section, table
from studies import Study, run
from studies.removals import REMOVALS

ROOT = Path(__file__).parents[1]
PACKAGES = "activeslam_gym", "baselines", "agents", "studies"
SCENARIOS = "paper", "office", "corner", "clusters", "clutter", "rooms", "hand-held"
HEADER = ("without", "of `BEHAVIOUR`", "failures, points", "score", "under 0, points", "NEES of landmarks")


@dataclass(frozen=True, kw_only=True)
class Args(Study):
    """The loss by the removal of each mechanism of the filter, in the same training episodes."""

    section = "worth"
    rows: tuple[str, ...] = tuple(name for name in REMOVALS if name != "base")
    """Rows to play."""
    scenarios: tuple[str, ...] = SCENARIOS
    """Scenarios to play in."""
    policies: tuple[str, ...] = ("mi-mi", "greedy-plus", "sweep", "generalist")
    """Policies to play."""
    episodes: int = 256
    """Episodes of each policy in each scenario."""
    seed: int = 4_300_600_000
    """Seed of the first training episode."""
    checkouts: tuple[str, ...] = ()
    """Other versions as more rows: NAME=FOLDER."""
    out: Path = Path("results/worth")
    """Folder of the results."""


def build(row: str, folder: Path) -> Path:
    """A copy of the packages with the lines of ``row``, made where it is not there."""
    target = folder / row
    if not target.exists():
        for package in PACKAGES:
            ignored = shutil.ignore_patterns("__pycache__", "entries")
            shutil.copytree(ROOT / package, target / package, ignore=ignored)
        for module, lines in REMOVALS[row].items():
            with open(target / "activeslam_gym" / f"{module}.py", "a") as file:
                file.write(f"\n\n{lines}\n")
    return target


def episodes(args: Args, scenario: str, checkout: Path, out: Path) -> list[dict[str, str]]:
    """The episodes of a scenario by the packages of a ``checkout``, kept in the folder ``out`` or played now."""
    numbers = {"episodes": args.episodes, "seed": args.seed, "jobs": args.jobs, "reference": args.policies[0]}
    numbers |= {"cluster": args.cluster} if args.cluster else {}
    given = [f"--{name}={value}" for name, value in (numbers | {"scenario": scenario, "out": out.resolve()}).items()]
    command = [sys.executable, "-m", "agents", "compare", "--resume", "--no-figures", *given, "--policies"]
    if subprocess.run([*command, *args.policies], env={**os.environ, "OMP_NUM_THREADS": "1"}, cwd=checkout).returncode:
        raise ValueError(f"scenarios: {scenario!r} was not played by {str(checkout)!r}; its message stands above")
    with (out / "episodes.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def compared(base: list[dict[str, str]], other: list[dict[str, str]]) -> dict[str, float]:
    """``other`` less ``base`` in the same episodes: failures in points, the ratio of the interquartile means of the log
    score, the growth of the number of scores under 0, and the median NEES of position and landmarks at the end."""
    from scipy.stats import bootstrap, trim_mean

    first = {(one["policy"], one["seed"]): one for one in base}
    pairs = [(first[key], one) for one in other if (key := (one["policy"], one["seed"])) in first]

    def both(name: str) -> np.ndarray:
        return np.array([[float(one[name] or "nan") for one in pair] for pair in pairs]).T

    def points(base: np.ndarray, other: np.ndarray, axis: int = -1) -> np.ndarray:
        return 100.0 * (other - base).mean(axis=axis)

    def ratio(base: np.ndarray, other: np.ndarray, axis: int = -1) -> np.ndarray:
        return trim_mean(other, 0.25, axis=axis) / trim_mean(base, 0.25, axis=axis)

    out: dict[str, float] = {"episodes": len(pairs), "base_lost": 100.0 * float(both("lost")[0].mean())}
    for name, column, figure in (("lost", "lost", points), ("score", "log_score_gain", ratio)):
        ends = bootstrap(both(column), figure, paired=True, n_resamples=2000, method="percentile", random_state=0)
        out[name] = float(figure(*both(column)))
        out[f"{name}_low"], out[f"{name}_high"] = map(float, ends.confidence_interval)
    out["under_zero"] = float(np.diff(both("log_score_under_0").sum(axis=1))[0])
    for name, column in (("pose_nees", "position_nees"), ("landmark_nees", "landmark_nees")):
        out[f"base_{name}"], out[name] = np.nanmedian(both(column), axis=1).tolist()
    return out


def report(pages: Sequence[Path]) -> None:
    """Fill the section ``worth`` of the ``pages`` from ``studies/worth.csv``: the worst figures of each row."""
    rows: dict[tuple[str, str], list[dict[str, str]]] = {}
    with Path(__file__).with_suffix(".csv").open(encoding="utf-8", newline="") as file:
        for one in csv.DictReader(file):
            rows.setdefault((one["row"], one["behaviour"]), []).append(one)
    lines = []
    for (row, behaviour), found in rows.items():
        most, least = max(found, key=lambda one: float(one["lost"])), min(found, key=lambda one: float(one["score"]))
        lost = f"{float(most['lost']):+.1f} [{most['lost_low']}, {most['lost_high']}] `{most['scenario']}`"
        score = f"{least['score']} [{least['score_low']}, {least['score_high']}] `{least['scenario']}`"
        below = sum(float(one["under_zero"]) for one in found) / sum(int(one["episodes"]) for one in found)
        nees = max(found, key=lambda one: abs(float(one["landmark_nees"]) - 1.0))
        changed = f"{nees['base_landmark_nees']} → {nees['landmark_nees']} `{nees['scenario']}`"
        lines.append((row, behaviour, lost, score, f"{100.0 * below:+.1f}", changed))
    for page in pages:
        put_section(page, "worth", table(HEADER, lines))


def main(args: Args) -> None:
    """Play what is missing, and write the table, ``worth.csv``."""
    if args.report:
        report(args.report)
        return
    if unknown := set(args.rows) - REMOVALS.keys():
        raise ValueError(f"rows: {', '.join(sorted(unknown))}; allowed: {', '.join(REMOVALS)}")
    for one in args.checkouts:
        if "=" not in one or not Path(one.split("=", 1)[1]).is_dir():
            raise ValueError(f"checkouts: {one!r}; allowed: NAME=FOLDER")
    checkouts = {name: Path(path).resolve() for name, path in (one.split("=", 1) for one in args.checkouts)}
    rows = tuple(dict.fromkeys(("base", *args.rows, *checkouts)))
    folders = {row: checkouts.get(row) or build(row, args.out / "builds").resolve() for row in rows}
    wanted = [(row, scenario) for row in rows for scenario in args.scenarios]
    found = {one: episodes(args, one[1], folders[one[0]], args.out / one[0] / one[1]) for one in wanted}
    lines = [
        {"behaviour": BEHAVIOUR, "row": row, "scenario": scenario}
        | {name: round(value, 3) for name, value in compared(found["base", scenario], found[row, scenario]).items()}
        for row, scenario in wanted
        if row != "base"
    ]
    write_csv(args.out / "worth.csv", lines)
    print((args.out / "worth.csv").read_text(encoding="utf-8"))


if __name__ == "__main__":
    run(Args, main)
