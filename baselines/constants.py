"""`best-constant`: the best of the 21 constant actions on rooms of training, for the scenario at hand.

Of named scenarios it stands in `best_constants.json`, which `python -m baselines` makes anew. Of others it is chosen
when it is first asked for, which takes a minute or so and is said.
"""

import json
import sys
from collections.abc import Callable
from dataclasses import fields
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activeslam_gym import ActiveSLAMVectorEnv, Gaze, Motion, Scenario
from activeslam_gym.config import TRAINING_SEED

from .policy import Actions, Environment, Policy

TABLE = Path(__file__).with_name("best_constants.json")
ROOMS = 8
"""In so many rooms all constants are tried,"""
FINALISTS = 4
"""and so many of them"""
MORE_ROOMS = 24
"""in so many more."""

Choose = Callable[[Scenario, float, float, float], dict[str, Any]]
"""(scenario, gaze period, motion period, duration) -> an entry of a table."""
CONSTANTS: Actions = np.array([(motion, gaze) for motion in Motion for gaze in Gaze])
"""(21, 2) the constant actions."""


class BestConstant(Policy):
    """The best constant action of the scenario, by the median log score: what decides has to beat it."""

    def __init__(self, env: Environment) -> None:
        super().__init__(env)
        self.action = best_constant(self.env)

    def choose_motion(self) -> Actions:
        return self.always(self.action[0])

    def choose_gaze(self) -> Actions:
        return self.always(self.action[1])


def best_constant(env: Any) -> tuple[Motion, Gaze]:
    """The best constant action for the scenario, the motion period and the duration of ``env``, a bare environment."""
    found = found_or_chosen(TABLE, env, choose, "constant action")
    return Motion[found["motion"]], Gaze[found["gaze"]]


def found_or_chosen(path: Path, env: Any, choose: Choose, what: str) -> dict[str, Any]:
    """The entry of the table ``path`` for ``env``, or, where it has none, the best one that ``choose`` finds now."""
    return table_of(path).get(key_of(env)) or _chosen(choose, what, *_asked(env))


def key_of(env: Any) -> str:
    """What the choice depends on, as JSON: the fields of the scenario that are not `Scenario`'s own, and the times."""
    scenario, plain = env.scenario, Scenario()
    own = {field.name: getattr(scenario, field.name) for field in fields(scenario)}
    differing = {name: value for name, value in own.items() if value != getattr(plain, name) and name != "name"}
    return json.dumps(differing | {"motion_period": env.motion_period, "duration": env.duration}, sort_keys=True)


@cache
def table_of(path: Path) -> dict[str, dict[str, Any]]:
    """What was chosen before."""
    return json.loads(path.read_text(encoding="utf-8"))


def _asked(env: Any) -> tuple[Scenario, float, float, float]:
    """Arguments of a `Choose`; steps are motion periods where the duration is a whole number of them."""
    whole = abs(env.duration / env.motion_period % 1.0 - 0.5) > 0.5 - 1e-6
    return env.scenario, env.motion_period if whole else env.gaze_period, env.motion_period, env.duration


@cache
def _chosen(choose: Choose, what: str, scenario: Scenario, *times: float) -> dict[str, Any]:
    """``choose``, once a process, and said."""
    told = f"baselines: choosing the best {what} for {scenario.name!r}, {times[-1]:g} s"
    print(f"{told}, in rooms of training (once a process) ...", file=sys.stderr, flush=True)
    return choose(scenario, *times)


def choose(scenario: Scenario, gaze_period: float, motion_period: float, duration: float) -> dict[str, Any]:
    """The constant action of the highest median log score: its names, and the medians of the finalists [bit].

    All constants play `ROOMS` rooms, the best `FINALISTS` of them `MORE_ROOMS` more.
    """
    times = {"gaze_period": gaze_period, "motion_period": motion_period, "duration": duration}
    first = np.array([log_scores(action, scenario, TRAINING_SEED, ROOMS, **times) for action in CONSTANTS])
    finalists = np.argsort(-np.median(first, axis=1), kind="stable")[:FINALISTS]
    seed = TRAINING_SEED + ROOMS
    more = [log_scores(CONSTANTS[k], scenario, seed, MORE_ROOMS, **times) for k in finalists]
    medians = np.median(np.concatenate((first[finalists], more), axis=1), axis=1)
    ranked = sorted(zip(medians.tolist(), CONSTANTS[finalists].tolist()), reverse=True)
    named = {f"{Motion(motion).name} {Gaze(gaze).name}": round(median, 1) for median, (motion, gaze) in ranked}
    motion, gaze = next(iter(named)).split()
    return {"scenario": scenario.name, "motion": motion, "gaze": gaze, "rooms": ROOMS + MORE_ROOMS, "medians": named}


def log_scores(action: Any, scenario: Scenario, seed: int, rooms: int, **times: float) -> NDArray[np.float64]:
    """(rooms,) log score [bit] at the end of runs in which nothing but ``action`` (2,) is done, from ``seed`` on."""
    env = ActiveSLAMVectorEnv(rooms, scenario, end_when_lost=False, autoreset_mode="DISABLED", **times)  # type: ignore[arg-type]
    env.reset(seed=seed)
    actions, over = np.tile(action, (rooms, 1)), np.zeros(rooms, bool)
    while not over.all():
        _, _, _, over, infos = env.step(actions)
    env.close()
    return infos["log_score"]
