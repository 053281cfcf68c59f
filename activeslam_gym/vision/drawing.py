"""A target as it looks from a pose, drawn, so that the templates of its corners have none of a picture's aliasing."""

from collections.abc import Callable
from functools import cache

import numpy as np
from scipy.ndimage import gaussian_filter

from activeslam_gym.kernels import Record
from activeslam_gym.vision.target import Board, Rectangle, Target
from activeslam_gym.vision.views import plane_points, projected

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
) -> tuple[np.ndarray, np.ndarray]:
    """The ``image`` (h, w) as float32 with the target drawn as it is seen from ``pose`` (>= 7,), and the pixels (K, 2)
    of its ``fiducials`` (K, 3).

    A template cut from a picture has the picture's aliasing for ever: a corner a quarter of a pixel off stays off. One
    that is drawn is off by the error of each new image alone.
    """
    out = image.astype(np.float32)
    if isinstance(target, Rectangle):
        _draw_rectangle(out, camera, target, pose)
    else:
        _draw_board(out, camera, target, pose)
    return out, projected(camera, pose, fiducials)


def _draw_rectangle(out: np.ndarray, camera: Record, target: Rectangle, pose: np.ndarray) -> None:
    """Draw the edges of a rectangle into ``out`` (h, w), and ``_BESIDE`` pixels beside them."""

    def depths(X: np.ndarray) -> np.ndarray:
        """Whether, and how far [px], each point is inside the rectangle."""
        metres = np.minimum(0.5 * target.width - np.abs(X[..., 0]), 0.5 * target.height - np.abs(X[..., 1]))
        depth = metres * camera.focal / pose[2]
        return np.stack((depth > 0.0, depth))

    box = _box_around(projected(camera, pose, target.fiducials), _BESIDE, out.shape)
    inside, depth = _pixel_means(camera, pose, box, _EDGE_RAYS, depths)
    part = out[box]
    dark, bright = np.median(part[(depth > 1.5) & (depth < 4.0)]), np.median(part[(depth < -1.5) & (depth > -4.0)])
    near = np.abs(depth) < _BESIDE
    part[near] = (bright + (dark - bright) * inside)[near]


def _draw_board(out: np.ndarray, camera: Record, board: Board, pose: np.ndarray) -> None:
    """Draw a board into ``out`` (h, w) in the image's greys, in all pixels that are wholly on it."""
    x, y = 0.5 * board.size
    ends = np.array(((-x, -y, 0.0), (-x, y, 0.0), (x, -y, 0.0), (x, y, 0.0)))
    box, picture = _box_around(projected(camera, pose, ends), 2.0, out.shape), printed(board)
    seen = _pixel_means(camera, pose, box, _BOARD_RAYS, lambda X: printed_value(board, picture, X))
    part, on = out[box], np.isfinite(seen)
    contrast, black = np.polyfit(seen[on], part[on], 1)
    part[on] = (contrast * seen + black)[on]


def as_first_seen(
    camera: Record, target: Target, first: np.ndarray, fiducials: np.ndarray, pose: np.ndarray, k: int
) -> tuple[np.ndarray, np.ndarray]:
    """The target around corner ``k`` of its ``fiducials`` (K, 3) from ``pose`` (>= 7,), where little is known of its
    surroundings: the picture (h, w) float32, NaN beside it, and the corner's pixel (2,). A rectangle's sheet reaches as
    far beyond the edges as `drawn` demands of the view from ``first`` (>= 7,).

    Raises:
        ValueError: as `printed_rectangle`, or too little is known around a rectangle, since it is not nearer than then.
    """
    if isinstance(target, Rectangle):
        distance = np.linalg.norm(first[:3])
        if np.linalg.norm(pose[:3]) > _NEARER * distance:
            raise ValueError("too little is known around the target")
        beside = 2.0 * (_BESIDE + _RIM) * distance / camera.focal
        return printed_rectangle(camera, target, (target.width + beside, target.height + beside), pose, k, 0.0)
    out, picture, pixel = _nothing(camera), printed(target), projected(camera, pose, fiducials[k : k + 1])
    box = _box_around(pixel, _AROUND, out.shape)
    if min(out[box].shape) > 0:
        out[box] = _pixel_means(camera, pose, box, _BOARD_RAYS, lambda X: printed_value(target, picture, X))
    return out, pixel[0]


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
    j, i = np.moveaxis((share * (w, h)).astype(int), -1, 0)
    return np.where(on, picture[np.clip(i, 0, h - 1), np.clip(j, 0, w - 1)].astype(float), np.nan)


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
