"""The records of a live run in plain numbers and arrays: facts `About` it, and its `State` after each image.

A page shows both, and a recording keeps both as JSON. Annotations give the shapes of arrays and the ranges of numbers,
which `record_of` checks.
"""

import json
from dataclasses import dataclass
from enum import Enum, EnumMeta
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin, get_type_hints

import numpy as np

from activeslam_gym.motion import CAMERA_SIZE, MOTION_COUNT, Motion
from activeslam_gym.vision.film import Moment
from activeslam_gym.vision.outcome import Searched

Request = Literal["pause", "step", "restart", "follow", "mark", "save"]
"""Requests of a page, each with a value: whether to pause, and whether the simulated person follows; the id of a
feature to mark, or 0; else True."""
_LARGEST = {float: 1e30, int: 2**62}
"""Greatest numbers by their types; their squares are finite."""


class Standing(str, Enum):
    """How the tracking goes: no target seen yet; well; few matches; the camera is lost; no image is left."""

    WAITING = "waiting"
    TRACKING = "tracking"
    UNSURE = "unsure"
    LOST = "lost"
    OVER = "over"


@dataclass(frozen=True)
class About:
    """Facts about a run; metres, pixels."""

    name: str
    """Of the source."""
    image_size: Annotated[tuple[int, int], (1, 8192)]
    """Width and height."""
    focal: Annotated[float, (1e-3, 1e9)]
    rate: Annotated[float, (1e-6, 1e6)]
    """Image rate of the source [Hz]."""
    room_size: Annotated[tuple[float, float, float], (1e-3, 1e6)]
    person: bool
    """Whether a simulated person holds the camera, in a room of `room_size` about the origin; else it is a guess."""
    replay: bool = False
    """Whether this is the replay of a recording."""


@dataclass
class State:
    """After an image, in the world axes of the filter; metres, seconds, pixels, bits.

    The map has n features and K fiducials, of which m were searched. Each array has its type and shape beside it.
    """

    frame: int
    """Images that were tracked, this one included."""
    time: float
    image: np.ndarray
    """(h, w) uint8."""
    standing: Standing
    words: str
    """The standing as a sentence."""
    camera: Annotated[np.ndarray, float, (CAMERA_SIZE,)]
    """Estimate: position, quaternion, velocity, angular velocity."""
    camera_covariance: Annotated[np.ndarray, float, (3, 3)]
    """Of the position."""
    ids: Annotated[np.ndarray, int, ("n",)]
    """Of the features."""
    points: Annotated[np.ndarray, float, ("n", 3)]
    covariances: Annotated[np.ndarray, float, ("n", 3, 3)]
    mapped: Annotated[np.ndarray, bool, ("n",)]
    """As in `slam.estimate.Estimate`."""
    fiducials: Annotated[np.ndarray, float, ("K", 3)]
    """Corners of the target."""
    searched: Annotated[np.ndarray, int, ("m",)]
    """Ids of the features and fiducials that were searched in the image."""
    pixels: Annotated[np.ndarray, float, ("m", 2)]
    """Predicted measurements."""
    ellipses: Annotated[np.ndarray, float, ("m", 2, 2)]
    """Covariances of the innovations."""
    outcomes: Annotated[np.ndarray, int, ("m",), (0, 2)]
    """`vision.frontend` MISSED, MATCHED or DOUBTED."""
    command: Motion
    """The present advice."""
    scores: Annotated[np.ndarray, float, (MOTION_COUNT,)]
    """Information of each motion when the command was chosen; NaN before the first."""
    advised: Annotated[np.ndarray, int, (MOTION_COUNT,)]
    """Times that each motion was advised."""
    log2_dets: Annotated[np.ndarray, float, (3,)]
    """log2 |P| of camera, map and total."""
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
    truth: Annotated[np.ndarray | None, float, (CAMERA_SIZE,)] = None
    """The true camera, in a rendered room."""

    @property
    def moment(self) -> Moment:
        """Its picture and map."""
        searched = Searched(self.searched, self.pixels, self.ellipses, self.outcomes)
        return Moment(self.image, searched, self.points, self.covariances, self.mapped, self.fiducials, self.camera)

    @property
    def motion(self) -> Motion:
        """The command."""
        return self.command

    @property
    def stds(self) -> np.ndarray:
        """(n, 3) standard deviations of the points [m]."""
        return np.sqrt(np.maximum(np.einsum("nii->ni", self.covariances), 0.0))


def plain(state: State) -> dict[str, Any]:
    """The state without its image as JSON holds it; numbers to six digits, NaN as None."""
    return {name: _plain(value) for name, value in vars(state).items() if name != "image"}


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, list):
        return [_plain(one) for one in value]
    if isinstance(value, float):
        return float(f"{value:.6g}") if np.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value


Made = TypeVar("Made", About, State)


def record_of(kind: type[Made], text: str, **given: Any) -> Made:
    """The record of a ``kind`` that stands in ``text`` as a JSON object; ``given`` fields are not read from it.

    Raises:
        ValueError: there is no such record in it.
    """
    hints, sizes = get_type_hints(kind, include_extras=True), dict.fromkeys("nmK", -1)
    try:
        values = json.loads(text)
        if not isinstance(values, dict):
            raise ValueError("no JSON object")
        made = {name: _field(name, hints[name], value, sizes) for name, value in values.items()}
        return kind(**{**made, **given})
    except RecursionError:
        raise ValueError("nested too deeply") from None
    except (TypeError, KeyError) as error:
        raise ValueError(f"this is no {kind.__name__} of a live recording ({error})") from None


def _field(name: str, hint: Any, value: Any, sizes: dict[str, int]) -> Any:
    """The ``value`` of a field, as its ``hint`` demands; ``sizes`` are the known lengths of n, m and K, else -1."""
    kind, *rules = get_args(hint) if get_origin(hint) is Annotated else (hint,)
    try:
        if len(rules) > 1:
            return None if value is None and type(None) in get_args(kind) else _array(value, sizes, *rules)
        if get_origin(kind) is tuple:
            return tuple(_scalar(one, number, *rules) for one, number in zip(get_args(kind), value, strict=True))
        return _scalar(kind, value, *rules)
    except (TypeError, ValueError, OverflowError):
        allowed = ", ".join(str(getattr(one, "__name__", one)) for one in rules or [kind])
        raise ValueError(f"{name}: {value!r:.40}; allowed: {allowed}") from None


def _scalar(kind: Any, value: Any, bounds: tuple[float, float] | None = None) -> Any:
    if kind in _LARGEST:
        low, high = bounds or (-_LARGEST[kind], _LARGEST[kind])
        fits = type(value) in (int, kind) and low <= value <= high
    elif isinstance(kind, EnumMeta):
        return kind(value if type(value) in (int, str) else None)
    else:
        fits = isinstance(value, kind)
    if not fits:
        raise ValueError
    return value


def _array(value: Any, sizes: dict[str, int], kind: type, axes: Any, bounds: Any = None) -> np.ndarray:
    made: np.ndarray = np.array(value, kind).reshape([sizes.get(axis, axis) for axis in axes])
    low, high = bounds or (-_LARGEST[float], _LARGEST[float])
    if not isinstance(value, list) or ((made < low) | (made > high)).any():
        raise ValueError
    sizes.update({axis: length for axis, length in zip(axes, made.shape) if isinstance(axis, str)})
    return made
