"""Settings of the greedy policies: for each scenario those with the highest median log score on training episodes.

Of those with which at most one episode in `EPISODES` is lost; where there is none, the fewest losses count.
Where medians differ by less than 1 %, more episodes may decide: in `hall` 80 others gave `mi-mi` 2322 bits with 3 s,
2243 with 2 s. `python -m baselines` chooses the settings; they stand in the scenarios' fields, and their medians in
`best_readings.json`.
"""

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activeslam_gym import Scenario
from activeslam_gym.config import TRAINING_SEED

from .greedy import HeldInformation, greedy
from .policy import Policy, played

TABLE = Path(__file__).with_name("best_readings.json")
READINGS: dict[str, tuple[Callable[[Any], Policy], tuple[float, ...]]] = {
    "gaze_horizon": (lambda env: greedy(env, gaze_criterion="mutual_information"), (1.0, 2.0, 3.0, 5.0, 8.0)),
    "plan_horizon": (HeldInformation, (4.0, 8.0, 12.0, 16.0)),
    "plan_position_std": (HeldInformation, (0.125, 0.25, 0.5, 1.0)),
}
"""Each field, the policy that it is chosen for (`mi-mi`, `greedy-plus`), and its candidates [s, s, m]."""
EPISODES, BATCH = 32, 16
"""Training episodes of each candidate, beside those that choose the open loops; episodes at a time."""
TRIED_WITH = 0.5  # ``plan_position_std`` [m] with which the horizon is chosen
MOST_LOST = 1  # up to so many lost episodes of a candidate count as none
FIRST_SEED = TRAINING_SEED + 100_000


def choose_readings(scenario: Scenario, *_: Any) -> dict[str, Any]:
    """The best value of each field of `READINGS`, and each candidate's median log score [bit] and lost episodes.

    A lost episode counts as it is scored. Horizons longer than the episode are left out.
    """
    entry: dict[str, Any] = {"scenario": scenario.name, "episodes": EPISODES, "medians": {}, "lost": {}}
    scenario = dataclasses.replace(scenario, plan_position_std=TRIED_WITH)
    for field, (make, candidates) in READINGS.items():
        values = [value for value in candidates if value <= scenario.duration] or [scenario.duration]
        readings: list[Scenario] = [dataclasses.replace(scenario, **dict[str, Any]({field: one})) for one in values]
        ends = [_ends(make, reading) for reading in readings]
        medians = [float(np.median(scores)) for scores, _ in ends]
        lost = [int(failed.sum()) for _, failed in ends]
        scenario = readings[max(range(len(values)), key=lambda k: (-max(lost[k], MOST_LOST), medians[k]))]
        entry[field] = getattr(scenario, field)
        entry["medians"][field] = {f"{value:g}": round(median, 1) for value, median in zip(values, medians)}
        entry["lost"][field] = {f"{value:g}": count for value, count in zip(values, lost)}
    return entry


def _ends(make: Callable[[Any], Policy], scenario: Scenario) -> NDArray[np.float64]:
    """(2, EPISODES) log score [bit] at the end of training episodes, and whether they were lost."""
    starts = range(FIRST_SEED, FIRST_SEED + EPISODES, BATCH)
    episodes = [one for start in starts for one in played(make, scenario, range(start, start + BATCH))]
    return np.array([(episode.log_score[-1], episode.lost) for episode in episodes]).T
