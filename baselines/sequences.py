"""Sequences: up to four actions, each held for a share of the episode; and a search for the best of them.

`best-sequence` plays the best open loop of a scenario, chosen on rooms of training. Of named scenarios it stands in
`best_sequences.json`, which `python -m baselines` regenerates. Of others it is searched when it is first asked for,
which takes minutes, shows a bar, and goes on where an interrupted search ended.
"""

import math
from collections.abc import Sequence as Many
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from activeslam_gym import Gaze, Motion, Scenario, core_of
from activeslam_gym.config import TRAINING_SEED
from activeslam_gym.evaluation.store import NOT_KEPT, Store

from . import constants
from .constants import CONSTANTS, Times, found_or_chosen
from .fixed import Planned
from .policy import Environment

TABLE = Path(__file__).with_name("best_sequences.json")
LONGEST = 4  # actions of a sequence, at most
RANDOM = 200  # so many random sequences are tried beside the constants,
HALVINGS = ((2, 40), (6, 12), (16, 6))  # in so many more rooms, and so many of them are kept
REFINEMENTS = 4  # so often those kept are changed, each a few times,
CHILDREN = 16  # to so many new ones in all,
TRIALS = (8, 5)  # which play so many of the same rooms, and so many of them the others
LAST_ROOMS = 40  # the best of those kept is judged in so many new rooms


class Sequence(NamedTuple):
    """Held actions, one after the other."""

    actions: tuple[tuple[int, int], ...]  # motion and gaze of each
    ends: tuple[float, ...]  # until which share of the episode each is held; the last is 1

    def plan(self, periods: int) -> NDArray[np.int64]:
        """(periods, 2) motion and gaze of each motion period: of the action that is held when it begins."""
        begins = np.arange(periods) / periods
        at = np.searchsorted(np.array(self.ends[:-1]) - 1e-9, begins, side="right")
        return np.array(self.actions, np.int64)[at]

    def longest(self) -> tuple[int, int]:
        """Motion and gaze of the action that is held longest."""
        return self.actions[int(np.argmax(np.diff((0.0, *self.ends))))]

    def words(self) -> str:
        """In words: ``BACKWARDS STAY to 54 %, then RIGHT LEFT``."""
        names = [f"{Motion(motion).name} {Gaze(gaze).name}" for motion, gaze in self.actions]
        parts = [f"{name} to {end:.0%}".replace("%", " %") for name, end in zip(names[:-1], self.ends[:-1])]
        return ", ".join([*parts, f"then {names[-1]}" if parts else names[-1]])


class BestSequence(Planned):
    """The best sequence of the scenario, by the median log score, that a search found: better ones may exist."""

    def __init__(self, env: Environment) -> None:
        core = core_of(env)
        periods = math.ceil(core.duration / core.motion_period - 1e-9)
        super().__init__(env, best_sequence(core).plan(periods))


def best_sequence(env: Any) -> Sequence:
    """The best sequence for the scenario, the motion period and the duration of ``env``, a bare environment."""
    return sequence_from(found_or_chosen(TABLE, env, choose_sequence, "sequence"))


def sequence_from(entry: dict[str, Any]) -> Sequence:
    """Of an entry of the table."""
    actions = tuple((int(Motion[motion]), int(Gaze[gaze])) for motion, gaze, _ in entry["sequence"])
    return Sequence(actions, tuple(end for *_, end in entry["sequence"]))


# The search ---------------------------------------------------------------------------------------------------------


def choose_sequence(scenario: Scenario, times: Times, store: Store = NOT_KEPT) -> dict[str, Any]:
    """The sequence of the highest median log score: its actions and ends, and the medians of the best finalists [bit].

    Random sequences and constants by successive halving; then the best are changed for some rounds, judged in the
    same rooms; at last those left and every constant play new rooms, by which alone the best is chosen. A scenario of
    images is played with images only then, by the best (see `constants.searched`). ``store`` keeps the rounds that are
    over, so that a second search goes on.
    """
    from tqdm import tqdm

    rng, first, quick = np.random.default_rng(0), TRAINING_SEED, constants.searched(scenario)
    held = [constant(tuple(action)) for action in CONSTANTS.tolist()]
    pool = held + [random_sequence(rng) for _ in range(RANDOM)]
    scores = np.empty((len(pool), 0))

    def play(sequences: list[Sequence], seeds: range) -> NDArray[np.float64]:
        found = log_scores(sequences, quick, seeds, times=times, store=store)
        bar.update()
        return found

    rounds = len(HALVINGS) + 2 * REFINEMENTS + 1
    with tqdm(total=rounds, unit="round", disable=None) as bar:  # None: where there is no terminal
        for rooms, kept in HALVINGS:
            more = play(pool, range(first + scores.shape[1], first + scores.shape[1] + rooms))
            pool, scores = _best(pool, np.hstack((scores, more)), kept)
        seeds = range(first, first + scores.shape[1])
        for _ in range(REFINEMENTS):
            children = [changed(pool[k % len(pool)], rng) for k in range(CHILDREN)]
            tried, kept = TRIALS
            children, begun = _best(children, play(children, seeds[:tried]), kept)
            ended = play(children, seeds[tried:])
            pool, scores = _best([*pool, *children], np.vstack((scores, np.hstack((begun, ended)))), HALVINGS[-1][1])
        last, new = list(dict.fromkeys([*pool, *held])), range(seeds.stop, seeds.stop + LAST_ROOMS)
        pool, scores = _best(last, play(last, new), HALVINGS[-1][1])
        if quick != scenario:
            pool, scores = _best(pool, log_scores(pool, scenario, new, times, store), len(pool))
    best = list(zip(pool, scores))[: HALVINGS[-1][1]]
    medians = {one.words(): round(float(np.median(row)), 1) for one, row in best}
    named = [[Motion(m).name, Gaze(g).name, round(end, 3)] for (m, g), end in zip(pool[0].actions, pool[0].ends)]
    return {"scenario": scenario.name, "sequence": named, "rooms": scores.shape[1], "medians": medians}


def _best(pool: list[Sequence], scores: NDArray[np.float64], kept: int) -> tuple[list[Sequence], NDArray[np.float64]]:
    """Those ``kept`` of a pool with the highest median of their ``scores`` (s, r), the best first."""
    order = np.argsort(-np.median(scores, axis=1), kind="stable")[:kept]
    return [pool[k] for k in order], scores[order]


def constant(action: tuple[int, int]) -> Sequence:
    """One action for the whole episode."""
    return Sequence((action,), (1.0,))


def random_sequence(rng: np.random.Generator) -> Sequence:
    """One to `LONGEST` actions with random shares."""
    length = int(rng.integers(1, LONGEST + 1))
    return _of([_random_action(rng) for _ in range(length)], rng.uniform(0.2, 1.0, length))


def changed(one: Sequence, rng: np.random.Generator) -> Sequence:
    """With one or two changes: other shares, another action or only its motion or gaze, one more, or one less."""
    actions, shares = list(one.actions), np.diff((0.0, *one.ends))
    for _ in range(rng.integers(1, 3)):
        k, what = int(rng.integers(len(actions))), rng.integers(5)
        if what <= 1:
            shares = shares * np.exp(0.7 * rng.standard_normal(len(shares)))
        elif what == 2:
            motion, gaze = _random_action(rng)
            actions[k] = ((motion, gaze), (motion, actions[k][1]), (actions[k][0], gaze))[rng.integers(3)]
        elif what == 3 and len(actions) < LONGEST:
            actions.insert(k + int(rng.integers(2)), _random_action(rng))
            shares = np.insert(shares, k, shares.sum() * rng.uniform(0.05, 0.5))
        elif what == 4 and len(actions) > 1:
            del actions[k]
            shares = np.delete(shares, k)
    return _of(actions, shares)


def _of(actions: Many[tuple[int, int]], shares: NDArray[np.float64]) -> Sequence:
    """The sequence with these ``shares`` of the episode, of any sum."""
    ends = np.cumsum(shares) / shares.sum()
    return Sequence(tuple(actions), (*ends[:-1].round(3).tolist(), 1.0))


def _random_action(rng: np.random.Generator) -> tuple[int, int]:
    return int(rng.integers(len(Motion))), int(rng.integers(len(Gaze)))


def log_scores(
    sequences: Many[Sequence], scenario: Scenario, seeds: Many[int], times: Times, store: Store = NOT_KEPT
) -> NDArray[np.float64]:
    """(s, r) log score [bit] at the end of episodes that play each of ``sequences`` with each of ``seeds``."""
    periods = math.ceil(times[2] / times[1] - 1e-9)
    return constants.log_scores(np.array([one.plan(periods) for one in sequences]), scenario, seeds, times, store)
