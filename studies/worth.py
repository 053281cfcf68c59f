"""The worth of each mechanism of the filter: the loss by its removal, in the same training episodes.

    python -m studies.worth  # every row; goes on where it stopped
    python -m studies.worth --rows iteration jcbb --scenarios paper clutter --episodes 64
    python -m studies.worth --checkouts earlier=../clone-of-an-earlier-commit

A row is a copy of the packages with a few more lines (`studies.removals`), or another checkout. It is compared with the
row ``base`` by `studies.paired`.
"""

import argparse
import csv
import os
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from studies.paired import FIGURES, compare
from studies.removals import REMOVALS

ROOT = Path(__file__).parents[1]
PACKAGES = "activeslam_gym", "baselines", "agents", "studies"
SCENARIOS = "paper", "office", "corner", "clusters", "clutter", "rooms", "hand-held"
POLICIES = "mi-mi", "greedy-plus", "sweep", "generalist"
SEED = 4_300_600_000  # of the first training episode


def build(row: str, folder: Path) -> Path:
    """A copy of the packages with the lines of ``row``, made where it is not there."""
    target = folder / row
    if not target.exists():
        ignored = shutil.ignore_patterns("__pycache__", "entries")
        for package in PACKAGES:
            shutil.copytree(ROOT / package, target / package, ignore=ignored)
        for module, lines in REMOVALS[row].items():
            with open(target / "activeslam_gym" / f"{module}.py", "a") as file:
                file.write(f"\n\n{lines}\n")
    return target


def play_row(folder: Path, results: Path, args: argparse.Namespace) -> None:
    """Play what is missing of a row, in a process that imports the packages of ``folder``."""
    done = {(one["scenario"], one["policy"]) for one in read(results)}
    wanted = [(scenario, policy) for scenario in args.scenarios for policy in args.policies]
    if missing := [f"{scenario}:{policy}" for scenario, policy in wanted if (scenario, policy) not in done]:
        paths = {"PYTHONPATH": os.pathsep.join([str(folder), str(ROOT)]), "OMP_NUM_THREADS": "1"}
        script = str(ROOT / "studies" / "worth_episodes.py")
        command = [sys.executable, script, str(results), str(args.seed), str(args.episodes), *missing]
        subprocess.run(command, env={**os.environ, **paths}, cwd=folder, check=True)


def read(path: Path) -> list[dict[str, str]]:
    """The episodes in a file of results."""
    if not path.exists():
        return []
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


def report(page: Path) -> None:
    """Fill the section ``worth`` of a ``page`` from ``studies/worth.csv``: the worst figures of each row."""
    from agents.tools.sections import put_section, table

    rows: dict[tuple[str, str], list[dict[str, str]]] = {}
    for one in read(ROOT / "studies" / "worth.csv"):
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
    header = ("without", "of `BEHAVIOUR`", "failures, points", "score", "under 0, points", "NEES of landmarks")
    put_section(page, "worth", table(header, lines))


def main() -> None:
    """Play what is missing, and write the table, ``worth.csv``."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("results/worth"), help="folder of the results")
    parser.add_argument("--rows", nargs="*", default=list(REMOVALS), help="rows to play")
    parser.add_argument("--scenarios", nargs="*", default=SCENARIOS, help="scenarios to play in")
    parser.add_argument("--policies", nargs="*", default=POLICIES, help="policies to play")
    parser.add_argument("--episodes", type=int, default=256, help="episodes of each policy in each scenario")
    parser.add_argument("--seed", type=int, default=SEED, help="seed of the first episode")
    parser.add_argument("--jobs", type=int, default=2, help="rows that are played at the same time")
    parser.add_argument("--report", type=Path, help="only fill the section ``worth`` of this page from the files here")
    parser.add_argument("--checkouts", nargs="*", default=[], metavar="NAME=PATH", help="other versions, as more rows")
    args = parser.parse_args()
    if args.report:
        return report(args.report)
    if unknown := set(args.rows) - set(REMOVALS):
        parser.error(f"--rows: {', '.join(sorted(unknown))} unknown; allowed: {', '.join(REMOVALS)}")
    checkouts = {name: Path(path).resolve() for name, path in (one.split("=", 1) for one in args.checkouts)}
    rows = list(dict.fromkeys(["base", *args.rows, *checkouts]))
    (args.out / "builds").mkdir(parents=True, exist_ok=True)
    folders = {row: checkouts.get(row) or build(row, args.out / "builds").resolve() for row in rows}
    results = {row: (args.out / f"{row}-episodes.csv").resolve() for row in rows}
    with ThreadPoolExecutor(args.jobs) as pool:
        list(pool.map(lambda row: play_row(folders[row], results[row], args), rows))
    with open(args.out / "worth.csv", "w", newline="") as file:
        writer = csv.DictWriter(file, ("row", "scenario", *FIGURES))
        writer.writeheader()
        for row in rows[1:]:
            for scenario, figures in compare(read(results["base"]), read(results[row])).items():
                rounded = {name: f"{figures[name]:.3f}".rstrip("0").rstrip(".") for name in FIGURES}
                writer.writerow({"row": row, "scenario": scenario, **rounded})
    print((args.out / "worth.csv").read_text())


if __name__ == "__main__":
    main()
