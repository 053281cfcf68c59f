"""The state of a live run after an image: all that a page shows and a recording keeps, in plain numbers and arrays."""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from activeslam_gym.motion import CAMERA_SIZE, MOTION_COUNT, Motion
from activeslam_gym.vision.frontend import DOUBTED, MATCHED, MISSED

WAITING, TRACKING, UNSURE, LOST, OVER = "waiting", "tracking", "unsure", "lost", "over"
"""No target seen yet; tracking well; few matches; few matches for a second; no image left."""


@dataclass
class State:
    """After an image, with n features, of which and of the fiducials m were searched; in the filter's world axes."""

    frame: int
    """Images that were tracked, this one included."""
    time: float
    """[s]"""
    image: np.ndarray
    """(h, w) uint8."""
    standing: str
    """WAITING, TRACKING, UNSURE, LOST or OVER."""
    words: str
    """The same as a sentence."""
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
    """(n,) bool, as in `slam.estimate.Estimate`."""
    fiducials: np.ndarray
    """(K, 3) corners of the target [m]."""
    searched: np.ndarray
    """(m,) ids of the features and fiducials searched in the image."""
    pixels: np.ndarray
    """(m, 2) predicted measurements [px]."""
    ellipses: np.ndarray
    """(m, 2, 2) covariances of the innovations [px^2]."""
    outcomes: np.ndarray
    """(m,) `vision.frontend` MISSED, MATCHED or DOUBTED."""
    command: int
    """The `Motion` advised at present."""
    scores: np.ndarray
    """(7,) information [bit] of each motion when the command was chosen; NaN before the first."""
    advised: np.ndarray
    """(7,) times that each motion was advised."""
    log2_dets: np.ndarray
    """(3,) log2 |P| of camera, map and total."""
    landmarks: int
    """Features that were ever mapped."""
    births: int
    """Features initialised in this image."""
    milliseconds: float
    """Processor time of this image."""
    rate: float = 0.0
    """Images a second, by the clock."""
    follows: bool | None = None
    """Whether the simulated person follows the advice; None for a real one."""
    marked: int = 0
    """Id of the marked feature, or 0."""
    truth: np.ndarray | None = None
    """(13,) the true camera, in a rendered room."""

    @property
    def motion(self) -> Motion:
        """The command."""
        return Motion(self.command)

    @property
    def stds(self) -> np.ndarray:
        """(n, 3) standard deviations of the points [m]."""
        return np.sqrt(np.maximum(np.einsum("nii->ni", self.covariances), 0.0))


_ARRAYS: dict[str, tuple[type, tuple[Any, ...]]] = {
    "camera": (float, (CAMERA_SIZE,)), "camera_covariance": (float, (3, 3)),
    "ids": (int, ("n",)), "points": (float, ("n", 3)), "covariances": (float, ("n", 3, 3)), "mapped": (bool, ("n",)),
    "searched": (int, ("m",)), "pixels": (float, ("m", 2)), "ellipses": (float, ("m", 2, 2)), "outcomes": (int, ("m",)),
    "fiducials": (float, ("K", 3)), "scores": (float, (MOTION_COUNT,)), "advised": (int, (MOTION_COUNT,)),
    "log2_dets": (float, (3,)), "truth": (float, (CAMERA_SIZE,)),
}  # fmt: skip
"""Types and shapes of the arrays of a `State`, but for the image."""
_ALLOWED = {"standing": (WAITING, TRACKING, UNSURE, LOST, OVER), "command": range(MOTION_COUNT)}
_LARGEST = 1e30
"""Greatest number; its square is finite."""


def plain(state: State) -> dict[str, Any]:
    """The state without its image as JSON holds it; numbers to six digits, NaN as None."""
    return {field.name: _plain(getattr(state, field.name)) for field in fields(State) if field.name != "image"}


def state_of(values: dict[str, Any], image: np.ndarray) -> State:
    """The state that `plain` turned into ``values``, with its ``image``.

    Raises:
        ValueError: ``values`` are those of no state.
    """
    kinds, sizes = {field.name: field.type for field in fields(State)}, dict.fromkeys("nmK", -1)
    try:
        made: dict[str, Any] = {
            name: _array(name, value, sizes) if name in _ARRAYS else scalar(name, kinds[name], value)
            for name, value in values.items()
        }
        return State(image=image, **made)
    except (TypeError, KeyError) as error:
        raise ValueError(f"this is no state of a live recording ({error})") from None


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


def _array(name: str, value: Any, sizes: dict[str, int]) -> np.ndarray | None:
    """The array ``value`` of a field; ``sizes`` are the known lengths of n, m and K, else -1."""
    if value is None and name == "truth":
        return None
    kind, axes = _ARRAYS[name]
    shape = tuple(sizes.get(axis, axis) for axis in axes)
    try:
        made: np.ndarray = np.array(value, kind).reshape(shape)
        fits = isinstance(value, list) and not (np.abs(made) > _LARGEST).any()
    except (TypeError, ValueError, OverflowError):
        fits = False
    if not fits or (name == "outcomes" and not np.isin(made, (MISSED, MATCHED, DOUBTED)).all()):
        raise ValueError(f"{name}: {value!r:.40}; allowed: {kind.__name__} in the shape {shape}")
    sizes.update({axis: length for axis, length in zip(axes, made.shape) if isinstance(axis, str)})
    return made
