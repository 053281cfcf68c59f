"""A board of numbered markers for a target: ChArUco or AprilTag.

The numbers tell which corner is which, so nobody has to say where the board is in the first image, and a part of it is
enough. Its frame is any target's: origin at its centre, X to the right and Y up as it is printed, Z towards the viewer.
"""

from typing import Any, NamedTuple

import numpy as np

from activeslam_gym.kernels import Record
from activeslam_gym.vision.opencv import opencv
from activeslam_gym.vision.views import bounding_box, plane_points, projected, supersampled

CHARUCO, APRILTAG = "charuco", "apriltag"
LEAST_CORNERS = 6
"""Fewer corners are no start."""
_CELL = 80
"""Pixels of a square or tag as it is printed."""
_SAMPLES = 6
"""Rays a side of a pixel by which a board is drawn."""
_WINDOW = 0.8
"""Half side of the window of a corner's fit, in what is free around it: the board may lean away."""
_MODULES = 10.0
"""Black and white fields along a tag, at most."""


class Board(NamedTuple):
    """A flat board of markers."""

    kind: str
    """CHARUCO or APRILTAG."""
    columns: int
    """Squares of a ChArUco board, or tags, in a row."""
    rows: int
    pitch: float
    """From one square, or tag, to the next [m]."""
    marker: float
    """Side of a marker: of its black part [m]."""
    dictionary: str
    """OpenCV's name: DICT_4X4_50, DICT_APRILTAG_36h11, ..."""

    @property
    def size(self) -> np.ndarray:
        """(2,) width and height of all squares or tags [m]."""
        gap = 0.0 if self.kind == CHARUCO else self.pitch - self.marker
        return np.array((self.columns, self.rows)) * self.pitch - gap

    @property
    def points(self) -> np.ndarray:
        """(n, 3) corners by number [m]: inner corners of the squares row by row; of tags, each one's four, clockwise
        from its top left."""
        if self.kind == CHARUCO:
            j, i = np.meshgrid(np.arange(1, self.columns), np.arange(1, self.rows))
            down = self.pitch * np.stack((j.ravel(), i.ravel()), axis=1)
        else:
            j, i = np.meshgrid(np.arange(self.columns), np.arange(self.rows))
            corners = self.marker * np.array(((0, 0), (1, 0), (1, 1), (0, 1)))
            down = (self.pitch * np.stack((j.ravel(), i.ravel()), axis=1)[:, None] + corners).reshape(-1, 2)
        upright = (down - 0.5 * self.size) * (1.0, -1.0)
        return np.pad(upright, ((0, 0), (0, 1)))


def markers_of(name: str) -> Any:
    """OpenCV's dictionary of that name."""
    aruco = opencv().aruco
    return aruco.getPredefinedDictionary(getattr(aruco, name))


def find_corners(image: np.ndarray, board: Board) -> tuple[np.ndarray, np.ndarray]:
    """What of the ``board`` the ``image`` (h, w) uint8 shows: numbers (m,) of the corners and their pixels (m, 2).

    Raises:
        ValueError: it shows fewer than LEAST_CORNERS.
    """
    numbers, pixels = _squares(image, board) if board.kind == CHARUCO else _tags(image, board)
    if len(numbers) < LEAST_CORNERS:
        raise ValueError(
            f"the first image shows {len(numbers)} of the {len(board.points)} corners of the target, a board of kind "
            f"{board.kind}; {LEAST_CORNERS} or more are needed"
        )
    return numbers, _refined(image, board, board.points[numbers, :2], pixels)


def _squares(image: np.ndarray, board: Board) -> tuple[np.ndarray, np.ndarray]:
    """Numbers and pixels of a ChArUco board's corners, roughly."""
    pixels, numbers = opencv().aruco.CharucoDetector(_charuco(board)).detectBoard(image)[:2]
    if numbers is None:
        return np.zeros(0, int), np.zeros((0, 2))
    return np.ravel(numbers).astype(int), np.reshape(pixels, (-1, 2)).astype(float)


def _tags(image: np.ndarray, board: Board) -> tuple[np.ndarray, np.ndarray]:
    """The same of tags."""
    corners, tags, _ = opencv().aruco.ArucoDetector(markers_of(board.dictionary)).detectMarkers(image)
    known = [k for k, tag in enumerate(np.ravel([] if tags is None else tags)) if tag < board.columns * board.rows]
    numbers = [4 * int(np.ravel(tags)[k]) + c for k in known for c in range(4)]
    pixels = [np.reshape(corners[k], (4, 2)) for k in known]
    return np.array(numbers, int), np.concatenate(pixels).astype(float) if pixels else np.zeros((0, 2))


def _charuco(board: Board) -> Any:
    aruco = opencv().aruco
    return aruco.CharucoBoard((board.columns, board.rows), board.pitch, board.marker, markers_of(board.dictionary))


def _refined(image: np.ndarray, board: Board, points: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """The corners below the pixel, in a window that nothing else of the board reaches into."""
    cv2, spread = opencv(), np.std(pixels, axis=0)
    per_metre = float(np.linalg.norm(spread) / np.linalg.norm(np.std(points, axis=0)))
    gap = board.pitch - board.marker
    free = 0.5 * gap if board.kind == CHARUCO else min(gap, board.marker / _MODULES)
    half = int(np.clip(_WINDOW * free * per_metre, 2, 5))
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 40, 0.002)
    rough = pixels.astype(np.float32).reshape(-1, 1, 2).copy()
    found = cv2.cornerSubPix(image, rough, (half, half), (-1, -1), stop).reshape(-1, 2)
    return found.astype(float)


def printed(board: Board) -> np.ndarray:
    """The board as it is printed (h, w) uint8, ``_CELL`` pixels to the pitch, without a margin."""
    if board.kind == CHARUCO:
        return _charuco(board).generateImage((board.columns * _CELL, board.rows * _CELL))
    cv2, dictionary, per_metre = opencv(), markers_of(board.dictionary), _CELL / board.pitch
    side = round(board.marker * per_metre)
    width, height = np.rint(board.size * per_metre).astype(int)
    out = np.full((height, width), 255, np.uint8)
    for tag in range(board.columns * board.rows):
        i, j = divmod(tag, board.columns)
        marker = cv2.aruco.generateImageMarker(dictionary, tag, side)
        out[i * _CELL : i * _CELL + side, j * _CELL : j * _CELL + side] = marker
    return out


def printed_value(board: Board, picture: np.ndarray, X: np.ndarray) -> np.ndarray:
    """Grey values (...) of the `printed` ``picture`` at ``X`` (..., 2) [m]; NaN beside the board."""
    h, w = picture.shape
    share = (X * (1.0, -1.0) + 0.5 * board.size) / board.size
    on = np.all((share >= 0.0) & (share < 1.0), axis=-1)
    j, i = (share * (w, h)).astype(int)[..., 0], (share * (w, h)).astype(int)[..., 1]
    return np.where(on, picture[np.clip(i, 0, h - 1), np.clip(j, 0, w - 1)].astype(float), np.nan)


def drawn_board(image: np.ndarray, camera: Record, board: Board, pose: np.ndarray) -> np.ndarray:
    """The ``image`` (h, w) as float32 with the board drawn as it is seen from ``pose`` (>= 7,), in the image's greys.

    So the templates of its corners have none of the picture's aliasing and noise. Pixels that are not wholly on the
    board are the picture's.
    """
    out, half = image.astype(np.float32), 0.5 * board.size
    ends = np.array([(x, y, 0.0) for x in (-half[0], half[0]) for y in (-half[1], half[1])])
    low, high = bounding_box(projected(camera, pose, ends), 2.0, image.shape)
    x, y = supersampled(low, high, _SAMPLES)
    values = printed_value(board, printed(board), plane_points(camera, pose, x, y))
    drawn = values.reshape(high[1] - low[1], _SAMPLES, high[0] - low[0], _SAMPLES).mean(axis=(1, 3))
    part, on = out[low[1] : high[1], low[0] : high[0]], np.isfinite(drawn)
    contrast, black = np.polyfit(drawn[on], part[on], 1)
    part[on] = (contrast * drawn + black)[on]
    return out
