"""Record what the environments do, for `tests/test_frozen.py`: `python -m tests.record_frozen` in the clone.

Six seconds of fixed, open-loop actions in each of some scenarios. Only behaviour that is meant to change is recorded
again, with `activeslam_gym.BEHAVIOUR` raised; a released environment then has a new id (see CONTRIBUTING.md).
"""

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

import activeslam_gym
from activeslam_gym.information import CRITERIA

FOLDER = Path(__file__).parent / "frozen"
SECONDS = 6.0
SIGHTS = 3
"""Observations and scores are recorded at the reset and so many times after it, evenly."""
POINTS, IMAGES = "ActiveSLAM-v0", "ActiveSLAMPixels-v0"
CASES = {  # environment, scenario, seed, gaze period [s]; with images, seeds whose runs do not depend on last digits
    "paper": (POINTS, "paper", 0, 0.25),
    "every-frame": (POINTS, "paper", 1, 0.05),
    "paper-literal": (POINTS, "paper-literal", 2, 0.25),
    "clutter": (POINTS, "clutter", 3, 0.25),
    "hand-held": (POINTS, "hand-held", 4, 0.2),
    "pixels": (IMAGES, "pixels", 8, 0.25),
    "hand-held-pixels": (IMAGES, "hand-held-pixels", 6, 0.2),
}


def action(step: int) -> tuple[int, int]:
    """The fixed action of a step: motions differ in mid-period too, where they mean nothing; a gaze lasts three."""
    return (3 * step + 2) % 7, (step // 3 + 1) % 3


def play(case: str) -> dict[str, np.ndarray]:
    """What an environment does in a case, as named arrays whose first axis is time (K + 1 moments with the reset)."""
    env_id, scenario, seed, gaze_period = CASES[case]
    env: Any = gym.make(env_id, scenario=scenario, gaze_period=gaze_period, duration=SECONDS)
    observation, info = env.reset(seed=seed)
    moments, seen, scores = [(0.0, False, False, info)], [observation], [scores_of(env)]
    between = round(SECONDS / gaze_period) // SIGHTS
    while not (moments[-1][1] or moments[-1][2]):
        observation, *moment = env.step(action(len(moments) - 1))
        moments.append(tuple(moment))
        if (len(moments) - 1) % between == 0:
            seen.append(observation)
            scores.append(scores_of(env))
    infos = [numbers(moment[3]) for moment in moments]
    recorded = {f"info.{name}": np.array([one[name] for one in infos]) for name in infos[0]}
    for k, name in enumerate(("reward", "terminated", "truncated")):
        recorded[name] = np.array([float(moment[k]) for moment in moments])
    recorded["observation"], recorded["scores"] = np.array(seen), np.array(scores)
    return recorded


def scores_of(env: Any) -> np.ndarray:
    """Every criterion's scores of the motions and of the gazes, one after the other."""
    inner = env.unwrapped
    return np.concatenate([np.r_[inner.motion_scores(name), inner.gaze_scores(name)] for name in CRITERIA])


def numbers(info: dict[str, Any], prefix: str = "") -> dict[str, float]:
    """The numbers of a nested `info`, by dotted name."""
    flat: dict[str, float] = {}
    for key, value in info.items():
        flat |= numbers(value, f"{prefix}{key}.") if isinstance(value, dict) else {prefix + key: float(value)}
    return flat


if __name__ == "__main__":
    for case, (env_id, *_) in CASES.items():
        np.savez_compressed(FOLDER / f"{env_id}-{case}.npz", behaviour=activeslam_gym.BEHAVIOUR, **play(case))
        print(f"recorded {case}")
