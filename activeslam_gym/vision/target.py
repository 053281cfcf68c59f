"""A target of known size: its corners are the fiducials, and its first sight is the start, with scale.

It is a rectangle, whose corners somebody has to point at, or a board of markers, which finds itself (`markers`).

The target's frame is the world: origin at its centre, X to the right and Y up as it is printed, Z towards the viewer.
"""

import math
import reprlib
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from activeslam_gym.camera import View, pixel_from_camera_point, ray_from_pixel
from activeslam_gym.config import is_number
from activeslam_gym.geometry import quaternion_exp, quaternion_product, rotate_left, rotation_matrix
from activeslam_gym.kernels import Record
from activeslam_gym.slam.sight import point_measurement
from activeslam_gym.vision.calibration import check_names, read_object
from activeslam_gym.vision.markers import APRILTAG, CHARUCO, Board, drawn_board, find_corners, markers_of
from activeslam_gym.vision.views import bounding_box, plane_points, projected, supersampled

CORNERS = ("top_left", "top_right", "bottom_left", "bottom_right")
FACING = np.array((0.0, 0.0, 1.0, 0.0))
"""q_WC of a camera before the target that looks straight at it, upright: half a turn about Y."""
_TILTS = ((0.0, 0.0), (0.6, 0.0), (-0.6, 0.0), (0.0, 0.6), (0.0, -0.6))
"""Turns of the target about its X and Y axis [rad] from which the fit starts: a plane's pose has two minima."""
_SIDES = ((0, 1), (2, 3), (0, 2), (1, 3))
"""The rectangle's sides, by corners: top, bottom, left, right."""


_SUPERSAMPLING = 20
"""Rays a side of a pixel by which edges are drawn."""
_ROUNDS = 4
"""Times that edges are sought from the corners found before."""
_LEAST_CONTRAST = 25.0
"""Grey levels between the two sides of the target's edge."""
RECTANGLE = "rectangle"
_FIDUCIALS = 8
"""Corners of a board that are searched in every image: those that are farthest from each other."""
_METRES = (1e-6, 1e6)
"""The least and the greatest length of a target [m]."""
_FARTHEST = 1e5
"""The greatest coordinate of a corner in the first image [px]."""
_FIELDS = {
    RECTANGLE: {"kind", "width", "height", "corners_px"},
    CHARUCO: {"kind", "columns", "rows", "square", "marker", "dictionary"},
    APRILTAG: {"kind", "columns", "rows", "tag", "gap", "dictionary"},
}
"""What a target's file must say, by its kind."""


class Rectangle(NamedTuple):
    """A rectangle of known size and where it is in the first image."""

    width: float
    """[m]"""
    height: float
    """[m]"""
    corners_px: np.ndarray
    """(4, 2) corners in the first image, to the pixel: top left, top right, bottom left, bottom right."""

    @property
    def fiducials(self) -> np.ndarray:
        """(4, 3) corners in the world [m]."""
        x, y = 0.5 * self.width, 0.5 * self.height
        return np.array(((-x, y, 0.0), (x, y, 0.0), (-x, -y, 0.0), (x, -y, 0.0)))


class Start(NamedTuple):
    """The camera before the target."""

    pose: np.ndarray
    """(7,) position [m] and quaternion q_WC, scalar first (filter axes: x left, y up, z forward)."""
    covariance: np.ndarray
    """(6, 6) of position and rotation (world frame) [m^2, rad^2]."""
    residual_px: float
    """Root mean square of the corners' residuals [px]."""


Target = Rectangle | Board


def read_target(path: str | Path) -> Target:
    """The target in a JSON file: see docs/vision.md for the fields of each kind.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it is no JSON, or a field is missing or wrong; the message names it.
        ModuleNotFoundError: it is a board, and OpenCV is not installed.
    """
    return target_from(read_object(path), str(path))


def target_from(fields: dict[str, Any], where: str = "the target") -> Target:
    """The target that ``fields`` describe, checked.

    Raises:
        ValueError: a field is missing, unknown or wrong.
        ModuleNotFoundError: it is a board, and OpenCV is not installed.
    """
    kind = fields.get("kind", RECTANGLE)
    if not isinstance(kind, str) or kind not in _FIELDS:
        raise ValueError(f"{where}: kind must be {', '.join(_FIELDS)}, got {reprlib.repr(kind)}")
    check_names(fields, _FIELDS[kind], where)
    return _rectangle_from(fields, where) if kind == RECTANGLE else _board_from(fields, where)


def _rectangle_from(fields: dict[str, Any], where: str) -> Rectangle:
    width, height = (_metres(fields, name, where) for name in ("width", "height"))
    corners = fields["corners_px"]
    if not isinstance(corners, dict):
        raise ValueError(f"{where}: corners_px must name {', '.join(CORNERS)}")
    check_names(corners, set(CORNERS), f"{where}: corners_px")
    try:
        pixels = np.array([corners[name] for name in CORNERS], float)
    except (TypeError, ValueError, OverflowError):
        pixels = np.empty(0)
    if pixels.shape != (4, 2) or not (np.abs(pixels) <= _FARTHEST).all():
        raise ValueError(f"{where}: each of corners_px must be two numbers [x, y] of at most {_FARTHEST:g} pixels")
    return Rectangle(width, height, pixels)


def _board_from(fields: dict[str, Any], where: str) -> Board:
    squares = fields["kind"] == CHARUCO
    least = 3 if squares else 1
    for name in ("columns", "rows"):
        value = fields[name]
        if isinstance(value, bool) or not isinstance(value, int) or value < least:
            raise ValueError(f"{where}: {name} must be a whole number of {least} or more, got {reprlib.repr(value)}")
    columns, rows = fields["columns"], fields["rows"]
    if squares:
        pitch, marker = (_metres(fields, name, where) for name in ("square", "marker"))
        if marker >= pitch:
            raise ValueError(f"{where}: marker must be smaller than square, got {marker!r} and {pitch!r}")
    else:
        marker, gap = (_metres(fields, name, where) for name in ("tag", "gap"))
        pitch = marker + gap
        if columns * rows < 2:
            raise ValueError(f"{where}: an AprilTag board must have two tags or more")
    name = fields["dictionary"]
    dictionary = f"{'DICT' if squares else 'DICT_APRILTAG'}_{name.upper() if isinstance(name, str) else ''}"
    try:
        there = len(markers_of(dictionary).bytesList)
    except AttributeError:
        example = "4x4_50" if squares else "36h11"
        raise ValueError(
            f"{where}: dictionary must be one of OpenCV's, {example} for example, got {reprlib.repr(name)}"
        ) from None
    needed = columns * rows // 2 if squares else columns * rows
    if needed > there:
        raise ValueError(f"{where}: the board has {reprlib.repr(needed)} markers, the dictionary {name} only {there}")
    return Board(fields["kind"], columns, rows, pitch, marker, dictionary)


def _metres(fields: dict[str, Any], name: str, where: str) -> float:
    value = fields[name]
    least, greatest = _METRES
    if not is_number(value) or not least <= value <= greatest:
        raise ValueError(
            f"{where}: {name} must be a positive number of metres, {least:g} to {greatest:g}, got {reprlib.repr(value)}"
        )
    return float(value)


# The first sight ------------------------------------------------------------------------------------------------------


def seen_corners(image: np.ndarray, camera: Record, target: Target) -> tuple[np.ndarray, np.ndarray]:
    """The target's corners that the ``image`` (h, w) uint8 shows: (n, 3) [m] and their pixels (n, 2).

    Raises:
        ValueError: the target is not there.
    """
    if isinstance(target, Rectangle):
        return target.fiducials, refine_corners(image, camera, target.corners_px)
    numbers, pixels = find_corners(image, target)
    return target.points[numbers], pixels


def fiducials_among(points: np.ndarray) -> np.ndarray:
    """Of the corners ``points`` (n, 3) those that are searched in each image: 8 at most, far from each other."""
    chosen = [int(np.linalg.norm(points - points.mean(axis=0), axis=1).argmax())]
    while len(chosen) < min(_FIDUCIALS, len(points)):
        apart = np.linalg.norm(points[:, None] - points[chosen], axis=2).min(axis=1)
        chosen.append(int(apart.argmax()))
    return points[sorted(chosen)]


def drawn(
    image: np.ndarray, camera: Record, target: Target, pose: np.ndarray, fiducials: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The ``image`` (h, w) as float32 with the target drawn as it is seen from ``pose`` (>= 7,), and the pixels (K, 2)
    of its ``fiducials`` (K, 3)."""
    if isinstance(target, Rectangle):
        return drawn_target(image, camera, target, pose)
    return drawn_board(image, camera, target, pose), projected(camera, pose, fiducials)


# Corners below the pixel ----------------------------------------------------------------------------------------------


def refine_corners(image: np.ndarray, camera: Record, corners_px: np.ndarray, reach: float = 4.0) -> np.ndarray:
    """Corners (4, 2) [px] of the rectangle in ``image`` (h, w), from corners known to ``reach`` pixels.

    Edge points are found along each side, across it; a side is a straight line of *rays*, where the lens bends nothing;
    a corner is where two of them meet.

    Raises:
        ValueError: a side has too few edge points, so that there is no rectangle at this place.
    """
    corners = np.array(corners_px, float)
    for _ in range(_ROUNDS):
        lines = {side: _side(image, camera, corners[side[0]], corners[side[1]], reach) for side in _SIDES}
        for corner in range(4):
            one, other = (lines[side] for side in _SIDES if corner in side)
            meeting = np.cross(one, other)
            ray = np.array((meeting[0] / meeting[2], meeting[1] / meeting[2], 1.0))
            pixel_from_camera_point(camera, ray, corners[corner])
        if not np.abs(corners - corners_px).max() <= 2.0 * reach:
            raise ValueError("the target's sides do not meet where its corners are said to be in the first image")
    return corners


def _side(image: np.ndarray, camera: Record, start: np.ndarray, end: np.ndarray, reach: float) -> np.ndarray:
    """Line (3,) l . (x, y, 1) = 0 of the rays of the side between two corners."""
    along = end - start
    across = np.array((-along[1], along[0])) / np.linalg.norm(along)
    rays = []
    for share in np.linspace(0.15, 0.85, max(int(0.7 * np.linalg.norm(along)), 8)):
        middle = start + share * along
        shift = _edge(_sampled(image, middle + np.arange(-reach, reach + 0.125, 0.25)[:, None] * across), reach)
        if shift is not None:
            rays.append(ray_from_pixel(camera, middle + shift * across))
    if len(rays) < 8:
        raise ValueError(f"no edge of the target between the pixels {start.tolist()} and {end.tolist()}")
    return _line_through(np.array(rays))


def _edge(profile: np.ndarray, reach: float) -> float | None:
    """Where a step stands in a ``profile`` (n,) from -reach to reach [px], or None if there is none.

    By its area: a step from a to b at e has the mean ((reach + e) a + (reach - e) b) / (2 reach), whatever blurs it or
    rings around it evenly; the steepest place would lock to whole pixels, as sharp as these edges are.
    """
    a, b = np.median(profile[:6]), np.median(profile[-6:])
    if abs(b - a) < _LEAST_CONTRAST:
        return None
    mean = float((profile[1:] + profile[:-1]).mean() / 2.0)
    shift = reach * (a + b - 2.0 * mean) / (b - a)
    return shift if abs(shift) < 0.75 * reach else None


def _line_through(rays: np.ndarray) -> np.ndarray:
    """The line (3,) nearest to the points ``rays`` (n, 3) of the plane z = 1, outliers left out."""
    kept = rays
    for _ in range(3):
        centre = kept[:, :2].mean(axis=0)
        normal = np.linalg.svd(kept[:, :2] - centre)[2][1]
        distance = np.abs((rays[:, :2] - centre) @ normal)
        kept = rays[distance <= max(2.5 * np.median(distance), 1e-4)]
    return np.array((*normal, -normal @ centre))


def _sampled(image: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Bilinear grey values (n,) at ``places`` (n, 2) [px]; those outside are taken from the edge."""
    h, w = image.shape
    x, y = np.clip(places[:, 0], 0, w - 1.001), np.clip(places[:, 1], 0, h - 1.001)
    j, i = x.astype(int), y.astype(int)
    a, b = x - j, y - i
    upper = (1 - a) * image[i, j] + a * image[i, j + 1]
    return (1 - b) * upper + b * ((1 - a) * image[i + 1, j] + a * image[i + 1, j + 1])


# The start ------------------------------------------------------------------------------------------------------------


def start_pose(camera: Record, points: np.ndarray, pixels: np.ndarray, corner_std: float) -> Start:
    """The camera that sees ``points`` (n, 3) of the plane Z = 0 [m] at ``pixels`` (n, 2), whose std is ``corner_std``.

    A plane's pose has two minima; of those from which the target's printed side is seen (camera at Z > 0), the one
    with the smaller residual is kept. The covariance is (J^T J)^-1 corner_std^2.

    Raises:
        ValueError: no pose explains the pixels.
    """
    tried = (_fit(camera, points, pixels, _guess(camera, points, pixels, tilt)) for tilt in _TILTS)
    fits = [fit for fit in tried if fit is not None and fit[0][2] > 0.0]
    if not fits:
        raise ValueError("no pose before the target explains its corners in the first image")
    pose, J, cost = min(fits, key=lambda fit: fit[2])
    return Start(pose, corner_std**2 * np.linalg.inv(J.T @ J), math.sqrt(cost / pixels.shape[0]))


def _guess(camera: Record, points: np.ndarray, pixels: np.ndarray, tilt: tuple[float, float]) -> np.ndarray:
    """A pose (7,) at the distance that the target's size suggests, rolled as its corners are, and turned round the
    target by ``tilt`` about its X and Y."""
    rays = np.array([ray_from_pixel(camera, pixel) for pixel in pixels])
    size = np.linalg.norm(points - points.mean(axis=0)) / np.linalg.norm(rays - rays.mean(axis=0))
    flat, seen = (
        p - p.mean(axis=0) for p in (points[:, :2] * (-1.0, 1.0), rays[:, :2])
    )  # from behind, as the eye has it
    roll = math.atan2(float(np.sum(flat[:, 0] * seen[:, 1] - flat[:, 1] * seen[:, 0])), float(np.sum(flat * seen)))
    upright = quaternion_product(FACING, quaternion_exp(np.array((0.0, 0.0, -roll))))
    q = quaternion_product(quaternion_exp(np.array((tilt[0], tilt[1], 0.0))), upright)
    position = points.mean(axis=0) - rotation_matrix(q) @ (size * rays.mean(axis=0))
    return np.concatenate((position, q))


def _fit(
    camera: Record, points: np.ndarray, pixels: np.ndarray, pose: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float] | None:
    """Levenberg-Marquardt on the corners' residuals: pose (7,), Jacobian (2 n, 6) and sum of squares; None if lost."""
    damping, current = 1e-3, _residuals(camera, points, pixels, pose)
    if current is None:
        return None
    for _ in range(60):
        r, J = current
        A = J.T @ J
        step = np.linalg.solve(A + damping * np.diag(np.diag(A)), J.T @ r)
        trial = np.concatenate((pose[:3] + step[:3], rotate_left(step[3:], pose[3:])))
        moved = _residuals(camera, points, pixels, trial)
        if moved is not None and moved[0] @ moved[0] <= r @ r:
            pose, current, damping = trial, moved, 0.3 * damping
            if np.abs(step).max() < 1e-10:
                break
        else:
            damping *= 5.0
    return pose, current[1], float(current[0] @ current[0])


def _residuals(
    camera: Record, points: np.ndarray, pixels: np.ndarray, pose: np.ndarray
) -> tuple[np.ndarray, np.ndarray] | None:
    """z - z_hat (2 n,) and the Jacobian of z_hat (2 n, 6) by position and rotation; None if a point is behind."""
    view = View(camera, pose, rotation_matrix(pose[3:]))
    r, J = np.empty((points.shape[0], 2)), np.empty((points.shape[0], 2, 6))
    z, H_y = np.empty(2), np.empty((2, 3))
    for i, point in enumerate(points):
        if not point_measurement(view, point, z, J[i], H_y):
            return None
        r[i] = pixels[i] - z
    return r.ravel(), J.reshape(-1, 6)


def drawn_target(
    image: np.ndarray, camera: Record, target: Rectangle, pose: np.ndarray, reach: float = 5.0
) -> tuple[np.ndarray, np.ndarray]:
    """The ``image`` (h, w) as float32 with the target's edges drawn as they are seen from ``pose`` (>= 7,), and its
    corners (4, 2) [px].

    A template cut from a picture has the picture's aliasing for ever: a corner a quarter of a pixel off stays off. One
    that is drawn, up to ``reach`` pixels beside the edges, is off by what is off in each new image alone.
    """
    corners = projected(camera, pose, target.fiducials)
    out = image.astype(np.float32)
    low, high = bounding_box(corners, reach, image.shape)
    depth = _depth_inside(camera, target, pose, *supersampled(low, high, _SUPERSAMPLING))
    blocks = depth.reshape(high[1] - low[1], _SUPERSAMPLING, high[0] - low[0], _SUPERSAMPLING)
    inside, middle = (blocks > 0.0).mean(axis=(1, 3)), blocks.mean(axis=(1, 3))
    part = out[low[1] : high[1], low[0] : high[0]]
    dark, bright = np.median(part[(middle > 1.5) & (middle < 4.0)]), np.median(part[(middle < -1.5) & (middle > -4.0)])
    near = np.abs(middle) < reach
    part[near] = (bright + (dark - bright) * inside)[near]
    return out, corners


def _depth_inside(camera: Record, target: Rectangle, pose: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """(len(y), len(x)) how far inside the rectangle each pixel looks, in pixels of its size there; negative outside."""
    X = plane_points(camera, pose, x, y)
    metres = np.minimum(0.5 * target.width - np.abs(X[..., 0]), 0.5 * target.height - np.abs(X[..., 1]))
    return metres * camera.focal / pose[2]
