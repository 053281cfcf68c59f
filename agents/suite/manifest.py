"""A suite: the scenarios, the protocol and the baselines that its entries share, and the seeds of its test episodes.

A suite is a manifest, ``manifests/NAME.json``. The seeds of its test episodes are made from the hash of the commit that
the manifest came with, so those episodes were unknown before. That hash is drawn once: it is a row of
``manifests/draws.csv``, beside the digest of the manifest (`Suite.digest`). A manifest that has been drawn is final: a
change needs another name.
A suite without a draw is for development: anyone may look at its episodes, those of `config.benchmark_seed`.
"""

import csv
import hashlib
import json
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from activeslam_gym import BEHAVIOUR
from activeslam_gym.config import SCENARIOS, TRAINING_SEED, benchmark_seed, did_you_mean
from activeslam_gym.evaluation.code import digest
from agents.tools.files import reading

FOLDER = Path(__file__).with_name("manifests")
DRAWN = TRAINING_SEED // 2, TRAINING_SEED
"""Range of the test seeds: over those of development and validation, and under those of training."""


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

    def is_open_loop(self, policies: Collection[str]) -> bool:
        """Whether all these policies are its open loops."""
        return set(policies) <= set(self.open_loops)

    def environment(self, scenario: str) -> dict[str, Any]:
        """The arguments of `task.make_environment` for a scenario."""
        return {"scenario": scenario, **self.protocol}


def drawn_seed(commit: str, scenario: str, index: int) -> int:
    """The seed of a test episode: SHA-256 of the commit, the scenario and the index, within `DRAWN`."""
    low, high = DRAWN
    drawn = hashlib.sha256(f"{commit} {scenario} {index}".encode()).digest()
    return low + int.from_bytes(drawn[:8], "big") % (high - low)


def suite(name: str) -> Suite:
    """The suite of that name, or of a manifest of your own (NAME.json).

    Raises:
        ValueError: there is none; its manifest is damaged, has changed since its draw, or is of another `BEHAVIOUR`.
    """
    path = Path(name) if name.endswith(".json") else FOLDER / f"{name}.json"
    if not path.is_file():
        known = sorted(one.stem for one in FOLDER.glob("*.json"))
        allowed = f"{', '.join(known)}, a manifest of your own (NAME.json)"
        raise ValueError(f"suite: {name!r}{did_you_mean(name, known)}; allowed: {allowed}")
    drawn = next((row for row in draws(path.parent) if row["suite"] == path.stem), None)
    with reading(path):
        given = json.loads(path.read_text(encoding="utf-8"))
        fields: dict[str, Any] = {key: tuple(part) if isinstance(part, list) else part for key, part in given.items()}
        made = Suite(name=path.stem, digest=digest(path), commit=drawn["commit"] if drawn else "", **fields)
        if (unknown := [one for one in made.scenarios if one not in SCENARIOS]) or not made.scenarios:
            raise ValueError(f"scenarios: {', '.join(unknown)}; allowed: {', '.join(SCENARIOS)}")
        if len(set(made.scenarios)) < len(made.scenarios) or not isinstance(made.open_loops, tuple):
            raise ValueError("scenarios: each once; open_loops: a list of policies")
        if not isinstance(made.episodes, int) or made.episodes < 1:
            raise ValueError(f"episodes: {made.episodes}; allowed: 1 or more")
    if drawn and drawn["manifest"] != made.digest:
        raise ValueError(f"suite: the manifest of {made.name!r} has changed since its draw; a change needs a new name")
    if made.behaviour != BEHAVIOUR:
        of = f"{made.name!r} is of BEHAVIOUR {made.behaviour}, and this code of {BEHAVIOUR}"
        raise ValueError(f"suite: {of}; allowed: a suite of this code's, or a checkout of the suite's time")
    return made


def draws(folder: Path = FOLDER) -> list[dict[str, str]]:
    """All draws, the oldest first: suite, digest of the manifest, commit, day and reason of each."""
    path = folder / "draws.csv"
    if not path.exists():
        return []
    with reading(path), path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))
