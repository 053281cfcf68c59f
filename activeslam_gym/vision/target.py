"""A target of known size, whose corners are the fiducials, so that its first sight is the start, with scale.

It is a rectangle, whose corners in the first image are given, or a board of numbered markers (ChArUco or AprilTag),
which finds itself, and of which a part is enough.

The target's frame is the world: origin at its centre, X to the right and Y up as it is printed, Z towards the viewer.

Its looks from a pose are drawn, so that the templates of its corners have none of a picture's aliasing.
"""

import reprlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter

from activeslam_gym.config import is_number, whole_number
from activeslam_gym.kernels import Record
from activeslam_gym.vision.calibration import check_names, read_object
from activeslam_gym.vision.opencv import opencv
from activeslam_gym.vision.views import pixels_of, plane_points, projected

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


def read_target(path: str | Path, pixels: Callable[[np.ndarray], np.ndarray] = lambda pixels: pixels) -> Target:
    """The target in a JSON file: see docs/vision.md for the fields of each kind. ``pixels`` maps those of the user's
    images (n, 2) to those of the calibration (n, 2): a rectangle's corners are given in the former.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it is no JSON, or a field is missing or wrong; the message names it.
        ModuleNotFoundError: it is a board, and OpenCV is not installed.
    """
    target = target_from(read_object(path), str(path))
    return target._replace(corners_px=pixels(target.corners_px)) if isinstance(target, Rectangle) else target


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


# Its looks ------------------------------------------------------------------------------------------------------------


_EDGE_RAYS, _BOARD_RAYS = 20, 6  # rays a side of a pixel by which a rectangle's edges, or a board, are drawn
_BESIDE = 5.0  # pixels beside a rectangle's edges that are drawn
_CELL = 80  # pixels of a square or tag as it is printed
_BLACK, _WHITE = 25.0, 225.0  # grey levels of a printed rectangle
_LEAST_SLANT = 0.3  # sine of the angle between sight line and plane under which a printed rectangle is not drawn
_NEARER = 0.9  # share of the first distance from which templates show nothing beside the `_BESIDE` pixels of that
_RIM = 1.5  # pixels at the edge of its sheet in which there is some of the background
_AROUND = 22.0  # pixels around a corner that its templates may need: half a patch, and the reach of the blur

Box = tuple[slice, slice]  # rows and columns of a part of an image


def drawn(
    image: np.ndarray, camera: Record, target: Target, pose: np.ndarray, fiducials: np.ndarray
) -> tuple[np.ndarray, np.ndarray, bool]:
    """The ``image`` (h, w) as float32 with the target drawn as it is seen from ``pose`` (>= 7,), the pixels (K, 2) of
    its ``fiducials`` (K, 3), and whether it is a rectangle that is brighter than its sheet.

    A template cut from a picture has the picture's aliasing for ever: a corner a quarter of a pixel off stays off. One
    that is drawn is off by the error of each new image alone.
    """
    out, bright = image.astype(np.float32), False
    if isinstance(target, Rectangle):
        bright = _draw_rectangle(out, camera, target, pose)
    else:
        _draw_board(out, camera, target, pose)
    return out, projected(camera, pose, fiducials), bright


def _draw_rectangle(out: np.ndarray, camera: Record, target: Rectangle, pose: np.ndarray) -> bool:
    """Draw the edges of a rectangle into ``out`` (h, w), and ``_BESIDE`` pixels beside them. Whether it is brighter
    than these."""

    def depths(X: np.ndarray) -> np.ndarray:
        """Whether, and how far [px], each point is inside the rectangle."""
        metres = np.minimum(0.5 * target.width - np.abs(X[..., 0]), 0.5 * target.height - np.abs(X[..., 1]))
        depth = metres * camera.focal / pose[2]
        return np.stack((depth > 0.0, depth))

    box = _box_around(projected(camera, pose, target.fiducials), _BESIDE, out.shape)
    inside, depth = _pixel_means(camera, pose, box, _EDGE_RAYS, depths)
    part = out[box]
    within, beside = np.median(part[(depth > 1.5) & (depth < 4.0)]), np.median(part[(depth < -1.5) & (depth > -4.0)])
    near = np.abs(depth) < _BESIDE
    part[near] = (beside + (within - beside) * inside)[near]
    return bool(within > beside)


def _draw_board(out: np.ndarray, camera: Record, board: Board, pose: np.ndarray) -> None:
    """Draw a board into ``out`` (h, w) in the image's greys, in all pixels that are wholly on it; some of it may be
    behind the camera."""
    x, y = 0.5 * board.size
    ends = np.array(((-x, -y, 0.0), (-x, y, 0.0), (x, -y, 0.0), (x, y, 0.0)))
    pixels, picture = pixels_of(camera, pose, ends), printed(board)
    whole = np.array(((0, 0), (out.shape[1], out.shape[0])))
    box = _box_around(whole if np.isnan(pixels).any() else pixels, 2.0, out.shape)
    seen = _pixel_means(camera, pose, box, _BOARD_RAYS, lambda X: printed_value(board, picture, X))
    part, on = out[box], np.isfinite(seen)
    contrast, black = np.polyfit(seen[on], part[on], 1)
    part[on] = (contrast * seen + black)[on]


def as_first_seen(
    camera: Record, target: Target, first: np.ndarray, fiducials: np.ndarray, bright: bool, pose: np.ndarray, k: int
) -> tuple[np.ndarray, np.ndarray]:
    """The target around corner ``k`` of its ``fiducials`` (K, 3) from ``pose`` (>= 7,), where little is known of its
    surroundings: the picture (h, w) float32, NaN beside it, and the corner's pixel (2,). A rectangle's sheet reaches as
    far beyond the edges as `drawn` demands of the view from ``first`` (>= 7,); it is dark where the target is
    ``bright``.

    Raises:
        ValueError: as `printed_rectangle`, or too little is known around a rectangle, since it is not nearer than then.
    """
    if isinstance(target, Rectangle):
        distance = np.linalg.norm(first[:3])
        if np.linalg.norm(pose[:3]) > _NEARER * distance:
            raise ValueError("too little is known around the target")
        beside = 2.0 * (_BESIDE + _RIM) * distance / camera.focal
        sheet = target.width + beside, target.height + beside
        picture, pixel = printed_rectangle(camera, target, sheet, pose, k, 0.0)
        return (_BLACK + _WHITE - picture if bright else picture), pixel
    out, whole, corner = _nothing(camera), printed(target), projected(camera, pose, fiducials[k : k + 1])
    box = _box_around(corner, _AROUND, out.shape)
    if min(out[box].shape) > 0:
        out[box] = _pixel_means(camera, pose, box, _BOARD_RAYS, lambda X: printed_value(target, whole, X))
    return out, corner[0]


def _nothing(camera: Record) -> np.ndarray:
    """A picture (h, w) of which nothing is known."""
    return np.full((int(camera.height), int(camera.width)), np.nan, np.float32)


@cache
def printed(board: Board) -> np.ndarray:
    """The board as it is printed (h, w) uint8, ``_CELL`` pixels to the pitch, without a margin."""
    return board.pattern.generateImage(np.rint(board.size * _CELL / board.pitch).astype(int).tolist())


def printed_value(board: Board, picture: np.ndarray, X: np.ndarray) -> np.ndarray:
    """Grey values (...) of the `printed` ``picture`` at ``X`` (..., 2) [m]; NaN beside the board."""
    h, w = picture.shape
    share = (X * (1.0, -1.0) + 0.5 * board.size) / board.size
    on = np.all((share >= 0.0) & (share < 1.0), axis=-1)
    j, i = np.moveaxis((np.where(on[..., None], share, 0.0) * (w, h)).astype(int), -1, 0)
    return np.where(on, picture[i, j].astype(float), np.nan)


def printed_rectangle(
    camera: Record, target: Rectangle, sheet: tuple[float, float], pose: np.ndarray, k: int, softness: float
) -> tuple[np.ndarray, np.ndarray]:
    """The target as it is printed on a ``sheet`` (width, height [m]), seen from ``pose`` (>= 7,) in its frame: the
    picture (h, w) float32 around its corner ``k``, NaN elsewhere and beside the sheet, and the corner's pixel (2,).

    ``softness``: deviation of the camera's blur [px]. A template that is sharper than the image is found inside of
    the corner, and so is one that shows white where the sheet has ended.

    Raises:
        ValueError: the corner is behind the camera, or the target is seen from its edge or from behind.
    """
    if pose[2] < _LEAST_SLANT * np.linalg.norm(pose[:3]):
        raise ValueError("the target is not seen from before it")
    corner, out = projected(camera, pose, target.fiducials[k : k + 1]), _nothing(camera)
    box = rows, columns = _box_around(corner, _AROUND, out.shape)
    if min(out[box].shape) < 2:
        return out, corner[0]
    X = plane_points(camera, pose, *(np.arange(part.start, part.stop) for part in (columns, rows)))
    share, on = 1.0, True
    for axis, half in enumerate((0.5 * target.width, 0.5 * target.height)):
        from_middle = np.abs(X[..., axis])
        per_pixel = np.hypot(*np.gradient(X[..., axis]))
        share = share * np.clip((half - from_middle) / per_pixel + 0.5, 0.0, 1.0)
        on = on & (from_middle < 0.5 * sheet[axis] - _RIM * per_pixel)
    seen = _WHITE + (_BLACK - _WHITE) * share
    out[box] = np.where(on, gaussian_filter(seen, softness) if softness > 0.0 else seen, np.nan)
    return out, corner[0]


def _box_around(pixels: np.ndarray, reach: float, shape: tuple[int, ...]) -> Box:
    """The part of an image of ``shape`` (h, w) that is ``reach`` pixels around ``pixels`` (n, 2)."""
    low = np.maximum(np.floor(pixels.min(axis=0) - reach).astype(int), 0)
    high = np.maximum(np.minimum(np.ceil(pixels.max(axis=0) + reach).astype(int) + 1, shape[::-1]), 0)
    return slice(low[1], high[1]), slice(low[0], high[0])


def _pixel_means(
    camera: Record, pose: np.ndarray, box: Box, rays: int, value: Callable[[np.ndarray], np.ndarray]
) -> np.ndarray:
    """(..., h, w) the mean over each pixel of a ``box`` of the ``value`` (..., m, n) of points (m, n, 2) of the plane
    [m], by ``rays`` a side of a pixel."""
    steps = (np.arange(rays) + 0.5) / rays - 0.5
    y, x = ((np.arange(part.start, part.stop)[:, None] + steps).ravel() for part in box)
    values = value(plane_points(camera, pose, x, y))
    return values.reshape(*values.shape[:-2], len(y) // rays, rays, len(x) // rays, rays).mean(axis=(-3, -1))
