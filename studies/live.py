"""The paper's live system from rendered pixels: does a person who follows the advice know more?

    python -m studies.live --episodes 44 --long 14 --seed 5000006 --report docs/live.md

Persons who follow, move at random or stay, in the same rendered rooms, with the same hand and gaze. The first of the
episodes, ``--long``, last to the last of ``--seconds``, the others to the first.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from activeslam_gym.evaluation import Store
from activeslam_gym.evaluation.store import Arrays
from activeslam_gym.live.source import FOLLOW, HABITS, NEVER, STILL
from activeslam_gym.live.trial import Second, trial
from agents.summary import Column
from agents.tools.arguments import within
from agents.tools.sections import table
from studies import Study, run

PERSONS = {FOLLOW: "follows", NEVER: "random", STILL: "stays"}
COMPARED = ((FOLLOW, ""), (NEVER, ""), (STILL, ""), (FOLLOW, NEVER), (FOLLOW, STILL))  # a person, less another
MEASURES = (
    Column("log2_det_total", "log₂|P|", digits=0),
    Column("log_score", "log score [bit]", digits=0),
    Column("position_error", "position error [cm]", scale=100.0),
)
LOST = Column("lost", "lost, %", "share", 100.0, 0)
HEADER = ("after", "person", *(one.title for one in (*MEASURES, LOST)))
Runs = Mapping[str, Mapping[int, Arrays]]  # habit → seed → the columns of its seconds


class Trial(NamedTuple):
    """An episode; a `Job` of the store."""

    seed: int
    habit: str
    lasts: float  # [s]

    @property
    def label(self) -> str:
        return f"{self.seed}-{self.habit}"

    @property
    def group(self) -> Any:
        return self

    @property
    def key(self) -> dict[str, Any]:
        return {"live": self}


def play_trials(trials: Sequence[Trial]) -> list[Arrays]:
    """Play one after the other."""
    runs = [trial(*one) for one in trials]
    return [{name: np.array([getattr(now, name) for now in one]) for name in Second._fields} for one in runs]


def at(episodes: Mapping[int, Arrays], time: float) -> dict[int, dict[str, Any]]:
    """Seed → the last second up to ``time``, of the episodes that lasted until then."""
    lasting = {seed: one for seed, one in episodes.items() if one["time"][-1] > time - 1.0}
    return {
        seed: {name: values[one["time"] <= time + 1e-6][-1] for name, values in one.items()}
        for seed, one in lasting.items()
    }


def rows(runs: Runs, time: float) -> Iterator[list[str]]:
    """A row for each person and each difference in the same rooms, at a time."""
    for habit, other in COMPARED:
        ours, theirs = at(runs[habit], time), at(runs[other], time) if other else {}
        lead = [{m.key: own[m.key] - (theirs[s][m.key] if other else 0.0) for m in MEASURES} for s, own in ours.items()]
        name = f"{PERSONS[habit]} − {PERSONS[other]}" if other else PERSONS[habit]
        lost = "" if other else LOST.text(LOST.of(ours.values()))
        yield [f"{time:g} s, {len(ours)} rooms", name, *(one.text(one.of(lead)) for one in MEASURES), lost]


@dataclass(frozen=True, kw_only=True)
class Args(Study):
    """Persons who follow the advice of the live page, move at random, or stay, in the same rendered rooms."""

    section = "live"
    episodes: int = 3
    """Episodes of each simulated person."""
    seed: int = 5_000_006
    """Seed of the first episode; a failure was traced in the six before."""
    seconds: tuple[float, ...] = (35.0, 167.0)
    """Times in seconds at which the persons are compared."""
    long: int = 0
    """Number of episodes that last to the last of these times; the others last to the first."""

    def __post_init__(self) -> None:
        super().__post_init__()
        within(self, long=(0, 10**6))
        if not all(1.0 <= one <= 36_000.0 for one in self.seconds):
            raise ValueError(f"seconds: {self.seconds}; allowed: 1 to 36000 each")


def main(args: Args) -> None:
    """Play, print the tables, and regenerate the page."""
    lasts = [max(args.seconds) if j < args.long else min(args.seconds) for j in range(args.episodes)]
    trials = [Trial(args.seed + j, habit, time) for j, time in enumerate(lasts) for habit in HABITS]
    runs: dict[str, dict[int, Arrays]] = {habit: {} for habit in HABITS}
    with closing(Store(args.out, args.workers).gather(trials, play_trials)) as finished:
        for one, arrays in finished:
            runs[one.habit][one.seed] = arrays
    text = table(HEADER, [row for time in args.seconds if time <= max(lasts) for row in rows(runs, time)])
    args.publish(text)


if __name__ == "__main__":
    run(Args, main)
