"""The `State` of a live run after each image: a page shows it, and a recording keeps it as JSON."""

from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np

from activeslam_gym.motion import Motion
from activeslam_gym.vision.film import Moment
from activeslam_gym.vision.search import Searched


class Standing(str, Enum):
    """How the tracking goes: no target seen yet; well; few matches; the camera is lost; no image is left."""

    WAITING = "waiting"
    TRACKING = "tracking"
    UNSURE = "unsure"
    LOST = "lost"
    OVER = "over"


@dataclass(kw_only=True)
class State(Moment):
    """After an image, in the world axes of the filter; metres, seconds, pixels, bits."""

    frame: int
    """Images that were tracked, this one included."""
    time: float
    standing: Standing
    words: str
    """The standing as a sentence."""
    command: Motion
    """The present advice."""
    scores: np.ndarray
    """(7,) float. Information of each motion when the command was chosen; NaN before the first."""
    advised: np.ndarray
    """(7,) int. Times that each motion was advised."""
    log2_dets: np.ndarray
    """(3,) float. log2 |P| of camera, map and total."""
    landmarks: int
    """Features that were ever mapped."""
    milliseconds: float
    """Processor time of this image."""
    rate: float = 0.0
    """Images a second, by the clock."""
    follows: bool | None = None
    """Whether the simulated person follows the advice; None for a real one."""
    truth: np.ndarray | None = None
    """(13,) float. The true camera, in a rendered room."""


def plain(state: State) -> dict[str, Any]:
    """The state without its image as JSON holds it; numbers but the time to six digits, NaN as None."""
    return {name: _plain(value) for name, value in vars(state).items() if name != "image"} | {"time": float(state.time)}


def _plain(value: Any) -> Any:
    if isinstance(value, Searched):
        return {name: _plain(one) for name, one in value._asdict().items()}
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, list):
        return [_plain(one) for one in value]
    if isinstance(value, float):
        return float(f"{value:.6g}") if np.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value
