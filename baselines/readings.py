"""Horizons of the greedy policies: for each scenario the one with the highest median log score on training episodes.

`python -m baselines` chooses them; they stand in the scenarios' fields, and their medians in `best_readings.json`.
"""

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activeslam_gym import ActiveSLAMVectorEnv, Scenario
from activeslam_gym.config import TRAINING_SEED
from activeslam_gym.evaluation import play

from .greedy import greedy
from .held import HeldInformation
from .policy import Policy

TABLE = Path(__file__).with_name("best_readings.json")
READINGS: dict[str, tuple[Callable[[Any], Policy], tuple[float, ...]]] = {
    "gaze_horizon": (lambda env: greedy(env, gaze_criterion="mutual_information"), (1.0, 2.0, 3.0, 5.0, 8.0)),
    "plan_horizon": (HeldInformation, (4.0, 8.0, 12.0, 16.0)),
}
"""Each field, the policy that it is chosen for (`mi-mi`, `held-information`), and its candidates [s]."""
EPISODES, BATCH = 32, 16
"""Training episodes of each candidate, beside those that choose the open loops; episodes at a time."""
FIRST_SEED = TRAINING_SEED + 100_000


def choose_readings(scenario: Scenario, *_: Any) -> dict[str, Any]:
    """The best value of each field of `READINGS`, and the median log score of each candidate [bit].

    A lost episode counts as it is scored. Candidates longer than the episode are left out.
    """
    entry: dict[str, Any] = {"scenario": scenario.name, "episodes": EPISODES, "medians": {}}
    for field, (make, candidates) in READINGS.items():
        values = [value for value in candidates if value <= scenario.duration] or [scenario.duration]
        readings: list[Scenario] = [dataclasses.replace(scenario, **dict[str, Any]({field: one})) for one in values]
        medians = [float(np.median(_log_scores(make, reading))) for reading in readings]
        scenario = readings[int(np.argmax(medians))]
        entry[field] = getattr(scenario, field)
        entry["medians"][field] = {f"{value:g}": round(median, 1) for value, median in zip(values, medians)}
    return entry


def _log_scores(make: Callable[[Any], Policy], scenario: Scenario) -> NDArray[np.float64]:
    """(EPISODES,) log score [bit] at the end of training episodes."""
    env = ActiveSLAMVectorEnv(BATCH, scenario, end_when_lost=False, autoreset_mode="DISABLED")
    scores: list[float] = []
    for first in range(FIRST_SEED, FIRST_SEED + EPISODES, BATCH):
        episodes = play(env, make(env), range(first, first + BATCH), period=env.duration)
        scores += [episode.log_score[-1] for episode in episodes]
    env.close()
    return np.array(scores)
