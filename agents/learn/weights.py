"""Learned weights in files, read without unpickling, each with its card: how it was trained, its results and limits.

Weights are plain arrays (``NAME.npz``). Their card stands in the same file, and as ``NAME.json`` beside it.
"""

import json
import platform
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from activeslam_gym import BEHAVIOUR
from activeslam_gym.config import positive_number
from activeslam_gym.evaluation.code import machine, package_versions
from activeslam_gym.files import written_whole
from agents.learn.recipe import ALGORITHMS, Recipe
from agents.tools.arguments import command_line
from agents.tools.files import json_text, reading, write_json

SHIPPED = Path(__file__).parents[1] / "pretrained"
FLOOR = -100.0  # least return of a validation episode, as much as the failure penalty: one does not choose the weights
CARD = "card"  # name of the card among the arrays of a file
PACKAGES = ("activeslam-gym", "stable-baselines3", "torch", "gymnasium", "numba", "numpy")
LIMITS = (
    "Trained in the scenarios of the recipe alone: other scenarios, noise, motions and durations were not trained. It "
    "reads the belief, never the truth, and holds each decision for decision_period seconds."
)
Weights = dict[str, np.ndarray]


def shipped() -> list[str]:
    """Names of the shipped weights."""
    return sorted(path.stem for path in SHIPPED.glob("*.npz"))


def path_of(name: str) -> Path | None:
    """The shipped weights of that name, or the file of weights (policy.npz) that it is; None where there is none."""
    path = Path(name) if name.endswith(".npz") else SHIPPED / f"{name}.npz"
    return path if path.is_file() else None


def read(name: str, argument: str = "policy") -> tuple[Weights, dict[str, Any]]:
    """Weights and card of `path_of` a name, which an ``argument`` has.

    Raises:
        ValueError: there are none of that name, or they are damaged.
    """
    if (path := path_of(name)) is None:
        raise ValueError(f"{argument}: {name!r}; allowed: {', '.join(shipped())}, or a file of weights, policy.npz")
    with reading(path), np.load(path, allow_pickle=False) as file:
        weights = {key: file[key] for key in file.files if key != CARD}
        require_finite(weights)
    return weights, read_card(path)


def save(path: Path, weights: Weights, card: dict[str, Any]) -> None:
    """Write weights with their card to ``path`` (.npz), and the card beside it (.json).

    Wherever the process is killed, the weights in the folder have their own card: the new file holds both, and takes
    its place when the card of the old weights is gone. Raises ValueError for weights that are not finite.
    """
    require_finite(weights)
    beside, arrays = path.with_suffix(".json"), {**weights, CARD: np.array(json_text(card))}
    with written_whole(path) as unfinished:
        np.savez(unfinished, **arrays)  # type: ignore[arg-type]
        beside.unlink(missing_ok=True)
    write_json(beside, card)


def require_finite(weights: Mapping[str, np.ndarray]) -> None:
    """Raise ValueError where weights are not all finite numbers."""
    for name, values in weights.items():
        if values.dtype.kind != "f" or not np.isfinite(values).all():
            raise ValueError(f"weights: {name} has values that are no finite numbers; the training has diverged")


def card_of(recipe: dict[str, Any], steps: int, seconds: float, chosen: bool) -> dict[str, Any]:
    """The card of weights after `steps` decisions and `seconds` of training: `chosen` ones, or the last."""
    best = f"best mean score of the deterministic policy in {recipe['validation_episodes']} validation episodes: its "
    best += f"return, at least {FLOOR:g} bits, plus {recipe['lost_penalty_weight'] - 1.0:g} times its failure penalty"
    return {
        "command": command_line("agents train", Recipe(**recipe)),
        **recipe,
        "behaviour": BEHAVIOUR,
        "steps": steps,
        "seconds": round(seconds, 1),
        "chosen": best if chosen else "the last of an interrupted training, before any validation",
        "machine": machine(),
        "versions": {"python": platform.python_version()} | package_versions(PACKAGES),
        "limits": LIMITS,
    }


def read_card(weights: Path) -> dict[str, Any]:
    """The card of the weights in a file (.npz): the one that the file holds, and the results beside it (.json).

    Raises ValueError where it is absent or damaged, or of other weights.
    """
    path = weights.with_suffix(".json")
    with reading(weights), np.load(weights, allow_pickle=False) as file:
        held = json.loads(str(file[CARD])) if CARD in file else None
        if not (isinstance(held, dict) and "width" in held):
            raise ValueError("it holds no card with a width; allowed: weights as `train` writes them")
    with reading(path if path.exists() else weights):
        card: dict[str, Any] = json.loads(path.read_text(encoding="utf-8")) if path.exists() else held
        positive_number("decision_period", card["decision_period"], "seconds")
        if not isinstance(card["width"], int) or not 1 <= card["width"] <= 2**13:
            raise ValueError(f"width: {str(card['width'])[:40]}; allowed: 1 to {2**13}")
        if card["algorithm"] not in ALGORITHMS:
            raise ValueError(f"algorithm: {card['algorithm']!r}; allowed: {', '.join(ALGORITHMS)}")
        if not held.items() <= card.items():
            raise ValueError(f"it is not the card in {weights.name}, but of other weights; delete it")
        return card
