"""A target of known size, whose corners are the fiducials, so that its first sight is the start, with scale.

It is a rectangle, whose corners in the first image are given, or a board of numbered markers (ChArUco or AprilTag),
which finds itself, and of which a part is enough.

The target's frame is the world: origin at its centre, X to the right and Y up as it is printed, Z towards the viewer.
"""

import reprlib
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from activeslam_gym.config import is_number, whole_number
from activeslam_gym.vision.calibration import check_names, read_object
from activeslam_gym.vision.opencv import opencv

CORNERS = ("top_left", "top_right", "bottom_left", "bottom_right")
RECTANGLE, CHARUCO, LEGACY, APRILTAG = "rectangle", "charuco", "charuco-legacy", "apriltag"
_FIELDS = {
    RECTANGLE: {"kind", "width", "height", "corners_px"},
    **dict.fromkeys((CHARUCO, LEGACY), {"kind", "columns", "rows", "square", "marker", "dictionary"}),
    APRILTAG: {"kind", "columns", "rows", "tag", "gap", "dictionary"},
}
"""Fields of a target's file, by its kind."""
FACING = np.array((0.0, 0.0, 1.0, 0.0))
"""q_WC of a camera before the target that looks straight at it, upright: half a turn about Y."""
_METRES = (1e-6, 1e6)  # least and greatest length of a target
_FARTHEST = 1e5  # greatest coordinate of a corner in the first image [px]


class Rectangle(NamedTuple):
    """A rectangle of known size and where it is in the first image."""

    width: float  # [m]
    height: float  # [m]
    corners_px: np.ndarray  # (4, 2) corners in the first image, to the pixel, in the order of `CORNERS`

    @property
    def fiducials(self) -> np.ndarray:
        """(4, 3) corners in the world [m]."""
        x, y = 0.5 * self.width, 0.5 * self.height
        return np.array(((-x, y, 0.0), (x, y, 0.0), (-x, -y, 0.0), (x, -y, 0.0)))


class Board(NamedTuple):
    """A flat board of markers."""

    kind: str  # CHARUCO or APRILTAG
    columns: int  # squares of a ChArUco board, or tags, in a row
    rows: int
    pitch: float  # from one square, or tag, to the next [m]
    marker: float  # side of a marker: of its black part [m]
    dictionary: str  # OpenCV's name: DICT_4X4_50, DICT_APRILTAG_36h11, ...
    legacy: bool = False  # of ChArUco, as OpenCV before 4.6 has it: the first square of even rows has a marker

    @property
    def size(self) -> np.ndarray:
        """(2,) width and height of all squares or tags [m]."""
        gap = 0.0 if self.kind == CHARUCO else self.pitch - self.marker
        return np.array((self.columns, self.rows)) * self.pitch - gap

    @property
    def pattern(self) -> Any:
        """OpenCV's board."""
        aruco, size, markers = opencv().aruco, (self.columns, self.rows), markers_of(self.dictionary)
        if self.kind == CHARUCO:
            board = aruco.CharucoBoard(size, self.pitch, self.marker, markers)
            board.setLegacyPattern(self.legacy)
            return board
        return aruco.GridBoard(size, self.marker, self.pitch - self.marker, markers)

    @property
    def points(self) -> np.ndarray:
        """(n, 3) corners [m]: inner corners of the squares row by row; of tags, each one's four, clockwise from its top
        left."""
        squares = self.kind == CHARUCO
        return self.upright(self.pattern.getChessboardCorners() if squares else self.pattern.getObjPoints())

    def upright(self, corners: Any) -> np.ndarray:
        """(n, 3) [m] in the target's frame of OpenCV's ``corners``, which it counts from the top left downwards."""
        down = np.round(np.reshape(corners, (-1, 3))[:, :2].astype(float), 7)  # OpenCV's have 24 bits
        return np.pad((down - 0.5 * self.size) * (1.0, -1.0), ((0, 0), (0, 1)))


Target = Rectangle | Board


def markers_of(name: str) -> Any:
    """OpenCV's dictionary of that name."""
    aruco = opencv().aruco
    return aruco.getPredefinedDictionary(getattr(aruco, name))


def read_target(path: str | Path) -> Target:
    """The target in a JSON file: see docs/vision.md for the fields of each kind.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it is no JSON, or a field is missing or wrong; the message names it.
        ModuleNotFoundError: it is a board, and OpenCV is not installed.
    """
    return target_from(read_object(path), str(path))


def target_from(fields: dict[str, Any], where: str = "the target") -> Target:
    """The target that ``fields`` describe, checked; errors name their origin ``where``.

    Raises:
        ValueError: a field is missing, unknown or wrong.
        ModuleNotFoundError: it is a board, and OpenCV is not installed.
    """
    kind = fields.get("kind", RECTANGLE)
    if not isinstance(kind, str) or kind not in _FIELDS:
        raise ValueError(f"{where}: kind must be {', '.join(_FIELDS)}, got {reprlib.repr(kind)}")
    check_names(fields, _FIELDS[kind], where)
    try:
        return _rectangle_from(fields) if kind == RECTANGLE else _board_from(fields)
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None


def _rectangle_from(fields: dict[str, Any]) -> Rectangle:
    width, height, corners = _metres(fields, "width"), _metres(fields, "height"), fields["corners_px"]
    if not isinstance(corners, dict):
        raise ValueError(f"corners_px must name {', '.join(CORNERS)}")
    check_names(corners, set(CORNERS), "corners_px")
    try:
        pixels = np.array([corners[name] for name in CORNERS], float)
    except (TypeError, ValueError, OverflowError):
        pixels = np.empty(0)
    if pixels.shape != (4, 2) or not (np.abs(pixels) <= _FARTHEST).all():
        raise ValueError(f"each of corners_px must be two numbers [x, y] of at most {_FARTHEST:g} pixels")
    return Rectangle(width, height, pixels)


def _board_from(fields: dict[str, Any]) -> Board:
    kind, name, legacy = fields["kind"], fields["dictionary"], fields["kind"] == LEGACY
    kind = CHARUCO if legacy else kind
    least = 3 if kind == CHARUCO else 1
    columns, rows = (whole_number(side, fields[side], least) for side in ("columns", "rows"))
    if kind == CHARUCO:
        pitch, marker, needed = _metres(fields, "square"), _metres(fields, "marker"), columns * rows // 2
        if marker >= pitch:
            raise ValueError(f"marker must be smaller than square, got {marker!r} and {pitch!r}")
    else:
        marker, needed = _metres(fields, "tag"), columns * rows
        pitch = marker + _metres(fields, "gap")
        if needed < 2:
            raise ValueError("an AprilTag board must have two tags or more")
    prefix, example = ("DICT", "4x4_50") if kind == CHARUCO else ("DICT_APRILTAG", "36h11")
    dictionary = f"{prefix}_{name.upper() if isinstance(name, str) else ''}"
    try:
        there = len(markers_of(dictionary).bytesList)
    except AttributeError:
        wrong = reprlib.repr(name)
        raise ValueError(f"dictionary must be one of OpenCV's, {example} for example, got {wrong}") from None
    if needed > there:
        raise ValueError(f"the board has {reprlib.repr(needed)} markers, the dictionary {name} only {there}")
    return Board(kind, columns, rows, pitch, marker, dictionary, legacy)


def _metres(fields: dict[str, Any], name: str) -> float:
    value, (least, greatest) = fields[name], _METRES
    if is_number(value) and least <= value <= greatest:
        return float(value)
    given = reprlib.repr(value)
    raise ValueError(f"{name} must be a positive number of metres, {least:g} to {greatest:g}, got {given}")
