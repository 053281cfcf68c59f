"""The `info` of an environment, and the `infos` of a batch, from the evaluation of its runs."""

from typing import Any

import numpy as np

from activeslam_gym.envs.reward import EVALUATION, LOST_PENALTY, REWARDS
from activeslam_gym.envs.run import EVENTS, Run

_TOLD = (
    "entropy log_score landmarks_mapped distinct_landmarks position_error orientation_error landmark_rmse position_nees"
).split()
"""Fields of the evaluation that `info` has under their own names."""


def info_of(runs: Run, reward: str) -> dict[str, Any]:
    """The `info` of the last step of a single run, of plain Python values; ``reward`` is that of the environment."""
    episode = runs.episode  # fields of arrays: those of a single record are slow to read
    values = dict(zip(EVALUATION.names or (), episode["evaluation"].tolist()[0], strict=True))
    lost = bool(episode["lost"][0]), bool(episode["lost_now"][0])
    return _tree(values, lost, reward, episode["gains"][0].tolist(), episode["events"].tolist()[0])


def infos_of(runs: Run, reward: str, included: np.ndarray) -> dict[str, Any]:
    """The `infos` of the last step of a batch, as Gymnasium's vector environments have them.

    An array (B,) for each number of `info_of`, in the same nested dicts, and beside each ``key`` a mask ``_key`` (B,)
    of the environments that it is of: those ``included`` (B,) bool; the others' numbers are 0.
    """

    everyone = bool(included.all())

    def kept(column: np.ndarray) -> np.ndarray:
        return column.copy() if everyone else np.where(included, column, column.dtype.type(0))

    episode = runs.episode
    values = {name: kept(episode["evaluation"][name]) for name in EVALUATION.names or ()}
    gains, events = map(kept, episode["gains"].T), (kept(episode["events"][name]) for name in EVENTS.names or ())
    lost = kept(episode["lost"]), kept(episode["lost_now"])
    return with_masks(_tree(values, lost, reward, gains, events), included)


def _tree(values: dict[str, Any], lost: Any, reward: str, gains: Any, events: Any) -> dict[str, Any]:
    """The tree of `info`, of the numbers of one run or of columns (B,) of numbers."""
    info: dict[str, Any] = {name: values[name] for name in _TOLD}
    info["log2_det"] = {part: values[f"log2_det_{part}"] for part in ("camera", "map", "total")}
    info["lost"], info["lost_at_end"] = lost
    names = (*REWARDS, LOST_PENALTY, *([reward] if reward not in REWARDS else []))
    info["reward_terms"] = dict(zip(names, gains, strict=False))  # the last one is a foreign reward's
    info["events"] = dict(zip(EVENTS.names or (), events, strict=True))
    return info


def with_masks(infos: dict[str, Any], included: np.ndarray) -> dict[str, Any]:
    """``infos`` with a mask ``_key`` beside each ``key``, in nested dicts too."""
    masked: dict[str, Any] = {}
    for key, value in infos.items():
        masked[key] = with_masks(value, included) if isinstance(value, dict) else value
        masked[f"_{key}"] = included.copy()
    return masked


def info_at(infos: dict[str, Any], i: int) -> dict[str, Any]:
    """The `info` of environment ``i`` in the `infos` of a batch: the inverse of `infos_of`."""
    return {
        key: info_at(value, i) if isinstance(value, dict) else value[i].item()
        for key, value in infos.items()
        if not key.startswith("_")
    }
