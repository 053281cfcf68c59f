"""`best-constant`: the best of the 21 constant actions on rooms of training, for the scenario at hand.

Of named scenarios it stands in `best_constants.json`, which `python -m baselines` regenerates. Of others it is chosen
when it is first asked for, which takes a minute or so and is said.
"""

import json
import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activeslam_gym import Gaze, Motion, Scenario, core_of
from activeslam_gym.config import TRAINING_SEED, fields_of
from activeslam_gym.evaluation.cluster import FOUND
from activeslam_gym.evaluation.code import package_sources
from activeslam_gym.evaluation.store import NOT_KEPT, Store, run_all
from activeslam_gym.files import demand_writable

from .fixed import Planned
from .policy import Actions, Environment, played

TABLE = Path(__file__).with_name("best_constants.json")
ROOMS = 8  # in so many rooms all constants are tried,
FINALISTS = 4  # and so many of them
LAST_ROOMS = 32  # are judged in so many new rooms

BATCH = 32  # episodes at a time
OF_PLANNERS = (
    "gaze_period", "motion_criterion", "negative_information", "gaze_horizon", "plan_horizon", "plan_position_std",
    "amortised_decision",
)  # fmt: skip
"""Fields of a scenario that change no open loop."""
Times = tuple[float, float, float]  # gaze period, motion period and duration [s]
Choose = Callable[[Scenario, Times, Store], dict[str, Any]]  # makes an entry of a table
CONSTANTS: Actions = np.array([(motion, gaze) for motion in Motion for gaze in Gaze])  # (21, 2) the constant actions


class BestConstant(Planned):
    """The best constant action of the scenario, by the median log score: what decides has to beat it."""

    def __init__(self, env: Environment) -> None:
        super().__init__(env, [best_constant(core_of(env))])


def best_constant(env: Any) -> tuple[Motion, Gaze]:
    """The best constant action for the scenario, the motion period and the duration of ``env``, a bare environment."""
    found = found_or_chosen(TABLE, env, choose, "constant action")
    return Motion[found["motion"]], Gaze[found["gaze"]]


def found_or_chosen(path: Path, env: Any, choose: Choose, what: str) -> dict[str, Any]:
    """The entry of the table ``path`` for ``env``, or, where it has none, the best one that ``choose`` finds now.

    It is said, and its episodes are kept in the user's cache, where that can be written. Its steps are motion periods
    where the duration is a whole number of them.
    """
    key = key_of(env)
    if found := table_of(path).get(key) or FOUND.get((path.stem, key)):
        return found
    whole = abs(env.duration / env.motion_period % 1.0 - 0.5) > 0.5 - 1e-6
    folder = Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"), "activeslam_gym")
    try:
        demand_writable(folder)
        store, where = Store(folder), f", kept in {folder}"
    except OSError:
        store, where = NOT_KEPT, ""
    message = f"baselines: choosing the best {what} for {env.scenario.name!r}, {env.duration:g} s"
    print(f"{message}, in training episodes{where} ...", file=sys.stderr, flush=True)
    times = env.motion_period if whole else env.gaze_period, env.motion_period, env.duration
    FOUND[path.stem, key] = found = choose(env.scenario, times, store)
    return found


def key_of(env: Any) -> str:
    """What the choice depends on, as JSON: the fields of the scenario that are not `Scenario`'s own, and the times.

    Fields that only planners read change no open loop.
    """
    own, plain = fields_of(env.scenario), fields_of(Scenario())
    unread = *OF_PLANNERS, "name"
    differing = {name: value for name, value in own.items() if value != plain[name] and name not in unread}
    return json.dumps(differing | {"motion_period": env.motion_period, "duration": env.duration}, sort_keys=True)


@cache
def table_of(path: Path) -> dict[str, dict[str, Any]]:
    """What was chosen before."""
    return json.loads(path.read_text(encoding="utf-8"))


def searched(scenario: Scenario) -> Scenario:
    """The scenario in which most episodes of a search are played: one of images has the sensor `corners`."""
    return replace(scenario, sensor="corners") if scenario.sensor == "images" else scenario


def choose(scenario: Scenario, times: Times, store: Store = NOT_KEPT) -> dict[str, Any]:
    """The constant action of the highest median log score: its names, and the medians of the finalists [bit].

    All constants play `ROOMS` rooms (see `searched`), the best `FINALISTS` of them `LAST_ROOMS` new ones, with images
    where the scenario has them.
    """
    plans, split = CONSTANTS[:, None], TRAINING_SEED + ROOMS
    first = log_scores(plans, searched(scenario), range(TRAINING_SEED, split), times, store)
    finalists = np.argsort(-np.median(first, axis=1), kind="stable")[:FINALISTS]
    last = log_scores(plans[finalists], scenario, range(split, split + LAST_ROOMS), times, store)
    medians = np.median(last, axis=1)
    ranked = sorted(zip(medians.tolist(), CONSTANTS[finalists].tolist()), reverse=True)
    named = {f"{Motion(motion).name} {Gaze(gaze).name}": round(median, 1) for median, (motion, gaze) in ranked}
    motion, gaze = next(iter(named)).split()
    return {"scenario": scenario.name, "motion": motion, "gaze": gaze, "rooms": LAST_ROOMS, "medians": named}


def log_scores(
    plans: Actions, scenario: Scenario, seeds: Sequence[int], times: Times, store: Store = NOT_KEPT
) -> NDArray[np.float64]:
    """(s, r) log score [bit] at the end of episodes in which each of ``plans`` (s, T, 2) is played with each seed (r,).

    What ``store`` has is not played again.
    """
    key = {"plans": plans.tolist(), "scenario": fields_of(scenario), "seeds": list(seeds), "times": times}
    key["code"] = package_sources("baselines", ("*.py",))

    def scores() -> dict[str, NDArray[Any]]:
        each, rooms = np.repeat(plans, len(seeds), axis=0), np.tile(seeds, len(plans))
        parts = [tuple(range(len(rooms)))[i : i + BATCH] for i in range(0, len(rooms), BATCH)]
        play = partial(_final_scores, plans=each, scenario=scenario, seeds=rooms.tolist(), times=times)
        ends = dict(run_all(play, parts, store.workers, None))
        return {"log_scores": np.concatenate([ends[part] for part in parts]).reshape(len(plans), len(seeds))}

    return store.of(f"{scenario.name}-{len(plans)}-plans", key, scores)["log_scores"]


def _final_scores(
    part: Sequence[int], plans: Actions, scenario: Scenario, seeds: list[int], times: Times
) -> NDArray[np.float64]:
    """(p,) log score [bit] at the end of the episodes of a ``part`` (p,) of ``plans`` (r, T, 2) and ``seeds`` (r,)."""
    named, own = dict(zip(("gaze_period", "motion_period", "duration"), times)), [seeds[i] for i in part]
    episodes = played(lambda env: Planned(env, plans[list(part)]), scenario, own, **named)
    return np.array([episode.log_score[-1] for episode in episodes])
