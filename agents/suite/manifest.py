"""A suite: the scenarios, the protocol and the baselines that its entries share, and the seeds of its test episodes.

A suite is a manifest, ``manifests/NAME.json``. The seeds of its test episodes are made from the hash of the commit that
the manifest came with, so those episodes were unknown before. That hash is drawn once, by

    python -m agents.suite.manifest v1 --reason "the first release"

which adds a row to ``manifests/draws.csv``. A manifest that has been drawn is final: a change needs another name.
A suite without a draw is for development: anyone may look at its episodes, those of `config.benchmark_seed`.
"""

import argparse
import csv
import hashlib
import json
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, get_type_hints

from activeslam_gym import BEHAVIOUR
from activeslam_gym.config import SCENARIOS, TRAINING_SEED, benchmark_seed
from activeslam_gym.evaluation.code import digest
from agents.tools.arguments import demand
from agents.tools.files import reading

FOLDER = Path(__file__).with_name("manifests")
DRAWN = TRAINING_SEED // 2, TRAINING_SEED
"""Range of the test seeds: over those of development and validation, and under those of training."""
HEADER = ("suite", "manifest", "commit", "day", "reason")


@dataclass(frozen=True)
class Suite:
    """A manifest, with the commit of its draw."""

    name: str
    digest: str  # of the manifest's file
    commit: str  # of which the test seeds are made; "" where they are those of development
    behaviour: int  # `activeslam_gym.BEHAVIOUR` that it is played with
    scenarios: tuple[str, ...]
    protocol: dict[str, Any]  # arguments of the environment, the same in all scenarios
    episodes: int  # of each scenario
    open_loops: tuple[str, ...]  # in each scenario the best of them has a normalised score of 1
    training_seeds: int  # how many a learned entry has at the least

    @property
    def label(self) -> str:
        """The suite in a page."""
        return f"suite {self.name}, manifest {self.digest}"

    def played(self, episodes: int | None) -> int:
        """How many episodes of each scenario are asked for, all by None. Raises ValueError for more than there are."""
        if episodes is not None and not 1 <= episodes <= self.episodes:
            raise ValueError(f"episodes: {episodes}; allowed: 1 to {self.episodes}")
        return episodes or self.episodes

    def seeds(self, scenario: str, episodes: int) -> list[int]:
        """The seeds of the first ``episodes`` test episodes of a scenario."""
        if not self.commit:
            return list(range(benchmark_seed(scenario), benchmark_seed(scenario) + episodes))
        return [drawn_seed(self.commit, scenario, index) for index in range(episodes)]

    def environment(self, scenario: str) -> dict[str, Any]:
        """The arguments of `task.make_environment` for a scenario."""
        return {"scenario": scenario, **self.protocol}


def drawn_seed(commit: str, scenario: str, index: int) -> int:
    """The seed of a test episode: SHA-256 of the commit, the scenario and the index, within `DRAWN`."""
    low, high = DRAWN
    drawn = hashlib.sha256(f"{commit} {scenario} {index}".encode()).digest()
    return low + int.from_bytes(drawn[:8], "big") % (high - low)


def manifest_of(name: str) -> Path:
    """The manifest of a suite, by the suite's name or by the file (NAME.json)."""
    return Path(name) if name.endswith(".json") else FOLDER / f"{name}.json"


def suite(name: str) -> Suite:
    """The suite of that name, or of a manifest of your own (NAME.json).

    Raises:
        ValueError: there is none; its manifest is damaged, has changed since its draw, or is of another `BEHAVIOUR`.
    """
    path = manifest_of(name)
    if not path.is_file():
        known = ", ".join(sorted(one.stem for one in FOLDER.glob("*.json")))
        raise ValueError(f"suite: {name!r}; allowed: {known}, a manifest of your own (NAME.json)")
    drawn = next((row for row in draws(path.parent) if row["suite"] == path.stem), None)
    with reading(path):
        given = json.loads(path.read_text(encoding="utf-8"))
        for field, value in given.items():
            demand(field, value, get_type_hints(Suite).get(field, Any))
        fields: dict[str, Any] = {key: tuple(part) if isinstance(part, list) else part for key, part in given.items()}
        made = Suite(name=path.stem, digest=digest(path), commit=drawn["commit"] if drawn else "", **fields)
        if (unknown := [one for one in made.scenarios if one not in SCENARIOS]) or not made.scenarios:
            raise ValueError(f"scenarios: {', '.join(unknown)}; allowed: {', '.join(SCENARIOS)}")
        if made.episodes < 1:
            raise ValueError(f"episodes: {made.episodes}; allowed: 1 or more")
    if drawn and drawn["manifest"] != made.digest:
        raise ValueError(f"suite: the manifest of {made.name!r} has changed since its draw; a change needs a new name")
    if made.behaviour != BEHAVIOUR:
        of = f"{made.name!r} is of BEHAVIOUR {made.behaviour}, and this code of {BEHAVIOUR}"
        raise ValueError(f"suite: {of}; allowed: a suite of this code's, or a checkout of the suite's time")
    return made


def draws(folder: Path = FOLDER) -> list[dict[str, str]]:
    """All draws, the oldest first: rows of `HEADER`."""
    path = folder / "draws.csv"
    if not path.exists():
        return []
    with reading(path), path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def draw(name: str, reason: str) -> str:
    """Draw the test seeds of a suite: log the commit that last changed its manifest, and return its hash.

    Raises:
        ValueError: there is no reason, the suite has been drawn, or its manifest is not committed.
    """
    if not reason.strip():
        raise ValueError("reason: none given; it stays in draws.csv")
    of, path = suite(name), manifest_of(name)
    if of.commit:
        raise ValueError(f"suite: {of.name!r} has been drawn, from the commit {of.commit}; a new draw needs a new name")
    changed = _git(path.parent, "status", "--porcelain", "--", path.name)
    commit = _git(path.parent, "log", "-1", "--format=%H", "--", path.name)
    if changed or not commit:
        raise ValueError(f"suite: the manifest of {of.name!r} is not committed; commit it first")
    log = path.parent / "draws.csv"
    is_new = not log.exists()
    with log.open("a", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        if is_new:
            writer.writerow(HEADER)
        writer.writerow((of.name, of.digest, commit, f"{datetime.now(timezone.utc):%Y-%m-%d}", reason.strip()))
    return commit


def _git(folder: Path, *arguments: str) -> str:
    try:
        done = subprocess.run(["git", "-C", str(folder), *arguments], capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError) as error:
        raise ValueError(f"suite: {str(folder)!r} is not in a clone with git: {error}") from error
    return done.stdout.strip()


def main(arguments: Sequence[str] | None = None) -> None:
    """Draw the test seeds of a suite."""
    parser = argparse.ArgumentParser(prog="python -m agents.suite.manifest", description=main.__doc__)
    parser.add_argument("suite")
    parser.add_argument("--reason", required=True)
    args = parser.parse_args(arguments)
    try:
        print(f"{args.suite}: drawn from the commit {draw(args.suite, args.reason)}; commit draws.csv.")
    except ValueError as error:
        parser.error(str(error))


if __name__ == "__main__":
    main()
