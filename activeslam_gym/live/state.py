"""What is known after an image: all that a page shows and a recording keeps, in plain numbers and arrays."""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from activeslam_gym.motion import CAMERA_SIZE, MOTION_COUNT, Motion
from activeslam_gym.vision.frontend import DOUBTED, MATCHED, MISSED

WAITING, TRACKING, UNSURE, LOST, OVER = "waiting", "tracking", "unsure", "lost", "over"
"""How it goes: no target seen yet; well; hardly anything is found; nothing is found for a second; no image is left."""


@dataclass
class State:
    """After an image. n features, m searched things; world axes as the filter's."""

    frame: int
    """Images before this one."""
    time: float
    """[s]"""
    image: np.ndarray
    """(h, w) uint8."""
    standing: str
    """How it goes: WAITING, TRACKING, UNSURE, LOST or OVER."""
    words: str
    """The same in a sentence for people."""
    camera: np.ndarray
    """(13,) estimate: position, quaternion, velocity, angular velocity."""
    camera_covariance: np.ndarray
    """(3, 3) of its position [m^2]."""
    ids: np.ndarray
    """(n,) of the features."""
    points: np.ndarray
    """(n, 3) [m]."""
    covariances: np.ndarray
    """(n, 3, 3) [m^2]."""
    mapped: np.ndarray
    """(n,) bool: its depth is known well."""
    fiducials: np.ndarray
    """(K, 3) corners of the target [m]."""
    searched: np.ndarray
    """(m,) ids of what was searched in the image."""
    pixels: np.ndarray
    """(m, 2) where each was expected [px]."""
    ellipses: np.ndarray
    """(m, 2, 2) covariances of that [px^2]."""
    outcomes: np.ndarray
    """(m,) `vision.frontend` MISSED, MATCHED or DOUBTED."""
    command: int
    """The `Motion` that is advised now."""
    scores: np.ndarray
    """(7,) information [bit] of each motion when the command was chosen; NaN before the first."""
    told: np.ndarray
    """(7,) how often each motion was advised."""
    log2_dets: np.ndarray
    """(3,) log2 |P| of camera, map and total."""
    landmarks: int
    """Landmarks that were ever mapped: it never falls."""
    births: int
    """Features born in this image."""
    milliseconds: float
    """Time that this image took on one core."""
    rate: float = 0.0
    """Images a second, lately."""
    follows: bool | None = None
    """Whether the simulated person follows; None where a real one holds the camera."""
    marked: int = 0
    """Id of the feature that the user has marked, or 0."""
    truth: np.ndarray | None = None
    """(13,) where the camera really is, where somebody knows."""

    @property
    def motion(self) -> Motion:
        """The command."""
        return Motion(self.command)


ARRAYS = {"camera", "camera_covariance", "ids", "points", "covariances", "mapped", "fiducials", "searched", "pixels",
          "ellipses", "outcomes", "scores", "told", "log2_dets", "truth"}  # fmt: skip
"""Fields of `State` that are arrays, but for the image."""
_SHAPES = {"camera": (CAMERA_SIZE,), "camera_covariance": (3, 3), "points": (-1, 3), "covariances": (-1, 3, 3),
           "fiducials": (-1, 3), "pixels": (-1, 2), "ellipses": (-1, 2, 2), "scores": (MOTION_COUNT,),
           "told": (MOTION_COUNT,), "log2_dets": (3,), "truth": (CAMERA_SIZE,)}  # fmt: skip
_ALIKE = ("ids", "points", "covariances", "mapped"), ("searched", "pixels", "ellipses", "outcomes")
"""Arrays of n rows, and of m."""
_ALLOWED = {"standing": (WAITING, TRACKING, UNSURE, LOST, OVER), "command": range(MOTION_COUNT)}
_LARGEST = 1e30
"""Whose square is still a number."""


def plain(state: State) -> dict[str, Any]:
    """The state without its image as JSON holds it; numbers to six digits, NaN as None."""
    out: dict[str, Any] = {}
    for field in fields(State):
        if field.name != "image":
            out[field.name] = _plain(getattr(state, field.name))
    return out


def state_of(values: dict[str, Any], image: np.ndarray) -> State:
    """The state that `plain` made these ``values`` of, with its ``image``.

    Raises:
        ValueError: they are not of a state.
    """
    kinds = {field.name: field.type for field in fields(State)}
    try:
        made: dict[str, Any] = {
            name: _array(name, value) if name in ARRAYS else scalar(name, kinds[name], value)
            for name, value in values.items()
        }
        state = State(image=image, **made)
    except (TypeError, KeyError) as error:
        raise ValueError(f"this is no state of a live recording ({error})") from None
    for names in _ALIKE:
        if len({len(getattr(state, name)) for name in names}) > 1:
            raise ValueError(f"{', '.join(names)} have different lengths")
    return state


def scalar(name: str, kind: Any, value: Any) -> Any:
    """``value``, read from JSON, of a field ``name`` that is annotated as ``kind``.

    Raises:
        ValueError: it is of another type, not finite, too large, or not allowed in `State`.
    """
    if kind is float:
        fits = type(value) in (int, float) and abs(value) <= _LARGEST
    elif kind is int:
        fits = type(value) is int and abs(value) < 2**63
    else:
        fits = isinstance(value, kind)
    if not fits or value not in _ALLOWED.get(name, (value,)):
        raise ValueError(f"{name}: {value!r:.40}; allowed: {_ALLOWED.get(name, getattr(kind, '__name__', kind))}")
    return value


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, list):
        return [_plain(one) for one in value]
    if isinstance(value, float):
        return float(f"{value:.6g}") if np.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value


def _array(name: str, value: Any) -> np.ndarray | None:
    if value is None and name == "truth":
        return None
    kind = {"ids": int, "searched": int, "outcomes": int, "told": int, "mapped": bool}.get(name, float)
    shape = _SHAPES.get(name, (-1,))
    try:
        made: np.ndarray = np.array(value, kind).reshape(shape)
        fits = isinstance(value, list) and not (np.abs(made) > _LARGEST).any()
    except (TypeError, ValueError, OverflowError):
        fits = False
    if not fits or (name == "outcomes" and not np.isin(made, (MISSED, MATCHED, DOUBTED)).all()):
        raise ValueError(f"{name}: {value!r:.40}; allowed: {kind.__name__} in the shape {shape}")
    return made
