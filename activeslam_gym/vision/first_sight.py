"""The target in the first image: its corners below the pixel, and the pose of the camera before it."""

import math
from typing import Any

import numpy as np
from scipy.ndimage import map_coordinates
from scipy.spatial.transform import Rotation

from activeslam_gym.camera import pixel_from_camera_point, ray_from_pixel
from activeslam_gym.geometry import rotate_left
from activeslam_gym.kernels import Record, compiled
from activeslam_gym.vision.opencv import opencv
from activeslam_gym.vision.target import CHARUCO, LEGACY, Board, Rectangle, Target, markers_of
from activeslam_gym.vision.views import pixels_and_jacobian, pose_of, projected

_SIDES = ((0, 1), (2, 3), (0, 2), (1, 3))  # of the rectangle, by corners: top, bottom, left, right
_REACH = 4.0  # corners of a rectangle are known to so many pixels
_ROUNDS = 4  # times that its edges are sought from the corners found before
_LEAST_CONTRAST = 25.0  # grey levels between the two sides of its edge
LEAST_CORNERS = 6  # fewer corners of a board are no start
_IN_A_ROW = 1e-3  # width of corners over their length, under which they are in a row
_WINDOW = 0.8  # half side of the window of a corner's fit, in the free space around it: the board may be slanted
_MODULES = 10.0  # black and white fields along a tag, at most
_MISSED = (0.6, 0.004)  # most that corners' pixels deviate by: pixels, or a share of the target's extent if more
_MARKER_ERROR = 0.1  # most that the side of a ChArUco board's markers may be off
_ITERATIONS = 50  # of the fit of a pose, at most
_FIDUCIALS = 8  # corners of a board that are searched in every image


def seen_corners(image: np.ndarray, camera: Record, target: Target) -> tuple[np.ndarray, np.ndarray]:
    """The target's corners that the ``image`` (h, w) uint8 shows: (n, 3) [m] and their pixels (n, 2).

    Raises:
        ValueError: the target is not there, or its corners in the image are not enough.
    """
    if isinstance(target, Rectangle):
        return target.fiducials, refine_corners(image, camera, target.corners_px)
    points, pixels = corners_in(image, target, camera)
    if not are_enough(points):
        raise ValueError(
            f"the first image shows {len(points)} of the {len(target.points)} corners of the target, a board of kind "
            f"{target.kind}; {LEAST_CORNERS} or more are needed, not in a row{other_print(image, target)}"
        )
    per_metre = float(np.linalg.norm(np.std(pixels, axis=0)) / np.linalg.norm(np.std(points, axis=0)))
    gap = target.pitch - target.marker
    free = 0.5 * gap if target.kind == CHARUCO else min(gap, target.marker / _MODULES)  # around a corner
    return points, refined(image, pixels, int(np.clip(_WINDOW * free * per_metre, 2, 5)))


def other_print(image: np.ndarray, target: Target) -> str:
    """Why the ``target`` is not found in the ``image``, where it is a board that is printed in another way, or there
    twice."""
    if isinstance(target, Rectangle):
        return ""
    legacy = target._replace(legacy=not target.legacy)
    if target.kind == CHARUCO and are_enough(corners_in(image, legacy)[0]):
        return f'; it has the pattern of kind "{LEGACY if legacy.legacy else CHARUCO}"'
    aruco, found = opencv().aruco, []
    for bits in (1, 2):
        parameters = aruco.DetectorParameters()
        parameters.markerBorderBits = bits
        ids = aruco.ArucoDetector(markers_of(target.dictionary), parameters).detectMarkers(image)[1]
        found.append(np.unique([] if ids is None else ids, return_counts=True))
    (numbers, counts), (wide, _) = found
    if len(wide) > len(numbers):
        return "; its tags have borders of two bits, as Kalibr's AprilGrid, which is not known"
    return f"; the picture has marker {numbers[counts.argmax()]} twice" if (counts > 1).any() else ""


def fiducials_among(points: np.ndarray) -> np.ndarray:
    """Of the corners ``points`` (n, 3) those that are searched in each image: 8 at most, far from each other."""
    chosen = [int(np.linalg.norm(points - points.mean(axis=0), axis=1).argmax())]
    while len(chosen) < min(_FIDUCIALS, len(points)):
        apart = np.linalg.norm(points[:, None] - points[chosen], axis=2).min(axis=1)
        chosen.append(int(apart.argmax()))
    return points[sorted(chosen)]


def refine_corners(image: np.ndarray, camera: Record, corners_px: np.ndarray) -> np.ndarray:
    """Corners (4, 2) [px] of the rectangle in ``image`` (h, w), from corners known to 4 pixels.

    Edge points are found along each side; a side is a straight line of *rays*, which the lens does not bend; corners
    are where two sides meet.

    Raises:
        ValueError: a side has too few edge points, so that there is no rectangle at this place.
    """
    corners = np.array(corners_px, float)
    for _ in range(_ROUNDS):
        lines = {side: _side(image, camera, *corners[list(side)]) for side in _SIDES}
        for corner in range(4):
            one, other = (lines[side] for side in _SIDES if corner in side)
            meeting = np.cross(one, other)
            pixel_from_camera_point(camera, np.append(meeting[:2] / meeting[2], 1.0), corners[corner])
        if not np.abs(corners - corners_px).max() <= 2.0 * _REACH:
            raise ValueError("the target's sides do not meet where its corners are said to be in the first image")
    return corners


def _side(image: np.ndarray, camera: Record, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Line (3,) l . (x, y, 1) = 0 of the rays of the side between two corners."""
    along = end - start
    across = np.array((-along[1], along[0])) / np.linalg.norm(along)
    steps, rays = np.arange(-_REACH, _REACH + 0.125, 0.25)[:, None], []
    for share in np.linspace(0.15, 0.85, max(int(0.7 * np.linalg.norm(along)), 8)):
        middle = start + share * along
        line = (middle + steps * across).T[::-1]
        shift = _edge(map_coordinates(image, line, output=float, order=1, mode="nearest"))
        if shift is not None:
            rays.append(ray_from_pixel(camera, middle + shift * across))
    if len(rays) < 8:
        raise ValueError(
            f"no edge of the target, which the first image must show, between the pixels {start.round(1).tolist()} and "
            f"{end.round(1).tolist()}"
        )
    return _line_through(np.array(rays))


def _edge(profile: np.ndarray) -> float | None:
    """Where a step stands in a ``profile`` (n,) from -_REACH to _REACH [px], or None if there is none.

    By its area: a step from a to b at e has the mean ((reach + e) a + (reach - e) b) / (2 reach), whatever blurs it or
    rings around it evenly; the steepest place would lock to whole pixels, as sharp as these edges are.
    """
    a, b = np.median(profile[:6]), np.median(profile[-6:])
    if abs(b - a) < _LEAST_CONTRAST:
        return None
    mean = float((profile[1:] + profile[:-1]).mean() / 2.0)
    shift = _REACH * (a + b - 2.0 * mean) / (b - a)
    return shift if abs(shift) < 0.75 * _REACH else None


def _line_through(rays: np.ndarray) -> np.ndarray:
    """The line (3,) nearest to the points ``rays`` (n, 3) of the plane z = 1, outliers left out."""
    kept = rays
    for _ in range(3):
        centre = kept[:, :2].mean(axis=0)
        normal = np.linalg.svd(kept[:, :2] - centre)[2][1]
        distance = np.abs((rays[:, :2] - centre) @ normal)
        kept = rays[distance <= max(2.5 * np.median(distance), 1e-4)]
    return np.array((*normal, -normal @ centre))


def corners_in(image: np.ndarray, board: Board, camera: Record | None = None) -> tuple[np.ndarray, np.ndarray]:
    """The corners of the ``board`` in the ``image`` (h, w) uint8, roughly: (n, 3) [m] and their pixels (n, 2). With the
    ``camera`` the size of the markers is tested, a ValueError: the scale depends on it, a lens does not."""
    aruco, pattern = opencv().aruco, board.pattern
    if board.kind == CHARUCO:
        found, numbers, markers, ids = aruco.CharucoDetector(pattern).detectBoard(image)
        if camera is not None and numbers is not None and len(numbers) >= LEAST_CORNERS:
            _demand_marker_size(board, camera, found, numbers, markers, ids)
    else:
        found, numbers = aruco.ArucoDetector(markers_of(board.dictionary)).detectMarkers(image)[:2]
    matched: Any = (None, None) if numbers is None else pattern.matchImagePoints(found, numbers)
    if matched[0] is None:
        return np.zeros((0, 3)), np.zeros((0, 2))
    return board.upright(matched[0]), np.reshape(matched[1], (-1, 2)).astype(float)


def are_enough(points: np.ndarray) -> bool:
    """Whether ``points`` (n, 3) of a board have a homography: LEAST_CORNERS or more, two of them beside each row."""
    rest = (np.delete(points, k, axis=0) for k in range(len(points)))
    spans = (np.linalg.svd(np.diff(some, axis=0), compute_uv=False) for some in rest)
    return len(points) >= LEAST_CORNERS and all(span[1] > _IN_A_ROW * span[0] for span in spans)


def _demand_marker_size(board: Board, camera: Record, corners: Any, numbers: Any, markers: Any, ids: Any) -> None:
    """A ValueError, if the markers are not as large against the squares as the ``board`` says. A homography has the
    board's plane and the rays of the ``camera``, which the lens does not bend."""
    cv2, pattern = opencv(), board.pattern
    corners, markers = (rays_of(camera, np.reshape(one, (-1, 2)).astype(float)) for one in (corners, markers))
    on_board = pattern.getChessboardCorners()[np.ravel(numbers), :2]
    H, _ = cv2.findHomography(on_board, corners)
    if H is None:
        return
    squares, known = cv2.perspectiveTransform(markers[:, None], np.linalg.inv(H)), pattern.getIds()
    sides = np.linalg.norm(np.diff(squares.reshape(-1, 4, 2)[np.isin(ids, known).ravel()], axis=1), axis=2)
    seen = float(np.median(sides)) if len(sides) else board.marker
    if abs(seen - board.marker) > _MARKER_ERROR * board.marker:
        share = f"{seen / board.pitch:.2f} of a square's side, not {board.marker / board.pitch:.2f}"
        raise ValueError(f"the target contradicts the first image: check marker and square; a marker has {share}")


def rays_of(camera: Record, pixels: np.ndarray) -> np.ndarray:
    """(n, 2) where the rays of ``pixels`` (n, 2) meet the plane at depth 1."""
    return np.array([ray_from_pixel(camera, pixel)[:2] for pixel in pixels])


def refined(image: np.ndarray, pixels: np.ndarray, half: int) -> np.ndarray:
    """Corners (n, 2) [px] below the pixel, each in a window of ``half`` its side [px]."""
    cv2 = opencv()
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 40, 0.001)
    rough = pixels.astype(np.float32).reshape(-1, 1, 2)
    return cv2.cornerSubPix(image, rough, (half, half), (-1, -1), stop).reshape(-1, 2).astype(float)


def demand_agreement(camera: Record, pose: np.ndarray, points: np.ndarray, pixels: np.ndarray) -> float:
    """By how much ``points`` (n, 3) from the ``pose`` miss the ``pixels`` (n, 2) [px], root mean square of each axis. A
    ValueError, if it is much: the target's file is wrong."""
    squares = ((projected(camera, pose, points) - pixels) ** 2).sum()
    missed = float(np.sqrt(squares / (2 * len(points) - 6)))  # the pose was fitted
    most = max(_MISSED[0], _MISSED[1] * float(np.linalg.norm(np.ptp(pixels, axis=0))))
    if missed > most:
        check = "sizes, order and turn of corners or tags, lens and focus; of a board columns, rows and gap (no pitch)"
        raise ValueError(
            f"the target contradicts the first image by {missed:.1f} px, {most:.1f} at most: check {check}"
        )
    return missed


def start_pose(
    camera: Record, points: np.ndarray, pixels: np.ndarray, corner_std: float
) -> tuple[np.ndarray, np.ndarray]:
    """Pose (7,) of the camera that sees ``points`` (n, 3) of the plane Z = 0 [m] at ``pixels`` (n, 2), and its
    covariance (6, 6), (J^T J)^-1 corner_std^2, of position and rotation (world frame) [m^2, rad^2].

    A plane's pose has two minima, whose normals are mirror images at the sight line; of those from which the target's
    printed side is seen (camera at Z > 0), the one with the smaller residual is kept. ``corner_std``: of the pixels.

    Raises:
        ValueError: no pose explains the pixels.
    """
    cv2, rays = opencv(), rays_of(camera, pixels)
    try:
        _, turn, shift = cv2.solvePnP(points, rays, np.eye(3), None)
    except cv2.error as error:  # of corners that are on one line, or found twice
        raise ValueError("the target's corners determine no pose") from error
    half_turn = Rotation.from_rotvec(np.pi * shift.ravel() / np.linalg.norm(shift))  # about the sight line
    mirrored = (half_turn * Rotation.from_rotvec(turn.ravel()) * Rotation.from_rotvec((0.0, 0.0, np.pi))).as_rotvec()
    fits = []
    for pose in (pose_of(turn, shift), pose_of(mirrored, shift)):
        pose, J, cost = _nearest_fit(camera, points, pixels, pose)
        if not math.isnan(cost) and pose[2] > 0.0:
            fits.append((cost, pose, corner_std**2 * np.linalg.inv(J.T @ J)))
    if not fits:
        tags = "are its tags counted from the bottom, as in Kalibr's AprilGrid?"
        why = "check the order of its corners_px" if len(points) < LEAST_CORNERS else tags  # a rectangle has four
        raise ValueError(f"no pose before the target explains its corners in the first image: {why}")
    return min(fits, key=lambda fit: fit[0])[1:]


@compiled
def _nearest_fit(
    camera: Record, points: np.ndarray, pixels: np.ndarray, pose: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float]:
    """The pose (7,) of a minimum near ``pose`` of the sum of squares of predicted - measured ``pixels`` (n, 2), the
    Jacobian (2 n, 6) there, and the sum, NaN if a point is behind the camera: Levenberg and Marquardt's method."""
    r, J = pixels_and_jacobian(camera, pose, points)
    r -= pixels
    cost, damping = (r * r).sum(), 1e-3
    for _ in range(0 if math.isnan(cost) else _ITERATIONS):
        A = np.dot(J.T, J)
        for k in range(6):
            A[k, k] *= 1.0 + damping
        step = np.linalg.solve(A, -np.dot(J.T, r.reshape(-1)))
        there = _moved(pose, step)
        r_there, J_there = pixels_and_jacobian(camera, there, points)
        r_there -= pixels
        cost_there = (r_there * r_there).sum()
        if cost_there < cost:
            pose, r, J, cost, damping = there, r_there, J_there, cost_there, 0.1 * damping
        else:
            damping *= 10.0
        if not np.abs(step).max() > 1e-9:
            break
    return pose, J, cost


@compiled
def _moved(pose: np.ndarray, x: np.ndarray) -> np.ndarray:
    """The ``pose`` (7,) shifted and turned, in the world frame, by ``x`` (6,)."""
    return np.concatenate((pose[:3] + x[:3], rotate_left(x[3:], pose[3:])))
