"""The card of learned weights: how they were trained, their results, and their limits."""

import json
import platform
from pathlib import Path
from typing import Any

import numpy as np

from activeslam_gym import BEHAVIOUR
from activeslam_gym.config import positive_number
from activeslam_gym.evaluation.code import machine, package_versions
from agents.learn.recipe import ALGORITHMS
from agents.tools.files import reading

FLOOR = -100.0  # least count of a validation episode, as much as the failure penalty: one does not choose the weights
CARD = "card"  # name of the card among the arrays of a file of weights
PACKAGES = ("activeslam-gym", "stable-baselines3", "torch", "gymnasium", "numba", "numpy")
LIMITS = (
    "Trained in the scenarios of the recipe alone: other scenarios, noise, motions and durations were not trained. It "
    "reads the belief, never the truth, and holds each decision for decision_period seconds."
)


def card_of(recipe: dict[str, Any], steps: int, seconds: float, validation_episodes: int) -> dict[str, Any]:
    """The card of weights that are kept after `steps` decisions and `seconds` of training.

    0 `validation_episodes`: they are the last ones, not chosen.
    """
    best = f"best mean return of the deterministic policy in {validation_episodes} validation episodes, {FLOOR:g} bits "
    best += f"the least, the failure penalty counted {recipe['forfeit_weight']:g} times"
    return {
        "command": " ".join(["python -m agents train", *_arguments(recipe)]),
        **recipe,
        "behaviour": BEHAVIOUR,
        "steps": steps,
        "seconds": round(seconds, 1),
        "chosen": best if validation_episodes else "the last of an interrupted training, before any validation",
        "machine": machine(),
        "versions": {"python": platform.python_version()} | package_versions(PACKAGES),
        "limits": LIMITS,
    }


def _arguments(recipe: dict[str, Any]) -> list[str]:
    """The recipe as arguments of the command."""
    lists = {name: " ".join(value) for name, value in recipe.items() if isinstance(value, list)}
    return [f"--{name.replace('_', '-')} {value}" for name, value in (recipe | lists).items() if value != ""]


def read_card(weights: Path) -> dict[str, Any]:
    """The card of the weights in a file (.npz): the one that the file holds, and the results beside it (.json).

    Older weights hold none. Raises ValueError where it is absent or damaged, or of other weights.
    """
    path = weights.with_suffix(".json")
    with reading(weights), np.load(weights, allow_pickle=False) as file:
        held = json.loads(str(file[CARD])) if CARD in file else {}
        if CARD in file and not (isinstance(held, dict) and "width" in held):
            raise ValueError("the card that it holds has no width")
        if not held and not path.exists():
            raise ValueError(f"it holds no card, and there is no {path.name} beside it")
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
