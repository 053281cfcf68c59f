"""The lens that explains pictures of a flat board with known corners: the command ``calibrate``.

A board is a chessboard of so many inner corners, or a ChArUco board of so many squares. Its size does not enter the
lens. Axes are those of image files here, x right and y down, in which equation 1 is u = u0 + u_c / sqrt(1 + K r_c^2).
OpenCV fits its own models, and SciPy equation 1 from there.

Where a board is waved before a live camera, `BoardCalibration` chooses the views, and says where to hold it next.
"""

import base64
import json
import math
import reprlib
import sys
from collections.abc import Callable, Sequence
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares
from scipy.sparse import block_diag, coo_array, hstack
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from activeslam_gym.files import argument, demand_writable_file, written_whole
from activeslam_gym.vision.calibration import Calibration, calibration_from
from activeslam_gym.vision.first_sight import are_enough, corners_in, refined
from activeslam_gym.vision.lens_files import Lens
from activeslam_gym.vision.opencv import opencv
from activeslam_gym.vision.other_lenses import fitted
from activeslam_gym.vision.sources import SourceError, images_of
from activeslam_gym.vision.target import CHARUCO, Board, printed
from activeslam_gym.vision.views import reduced

KINDS = ("chessboard", CHARUCO)
MODELS = ("equation-1", "radtan", "fisheye")
LEAST_PICTURES = 3
_ENOUGH = 200  # from so many pictures on, as of a video, some are left out, evenly
_SIDES = (3, 100)  # fewest and most columns and rows of a board
_MARKER_SHARE = 0.75  # side of a ChArUco board's markers, in squares
_MARKERS = 50  # markers of its dictionary, 4x4_50: a board has at most as many
_SEARCHED = 1000  # a board is searched in images no longer than this [px]
_WINDOWS = {"chessboard": 0.2, CHARUCO: 0.1}  # half sides of the windows in which corners are refined, in squares
_BOUND = 1.0  # residual beyond which a corner counts little [px]
_FAR, _QUIET = 4.0, 0.25  # a view is left out at so many medians of all views' residuals, each at least so many pixels
_MISFIT = 0.0015  # residual up to which equation 1 is never refused, as a share of the image's width
_UNLIKE = 3.0  # residual of equation 1 over that of radtan, from which the lens has not equation 1
_NO_LENS = 0.005  # residual from which the pictures agree on no lens, as a share of the image's width
_WORST = 1e12  # condition of a lens's scaled information from which it is singular
_VAGUE = 0.1  # deviation of a focal length that the pictures do not determine, as a share of it
_TILT_IT = "tilt the board differently in each picture"

View = tuple[np.ndarray, np.ndarray]
"""Corners on the board (n, 3) [squares] and in the picture (n, 2) [px]."""


class Fit(NamedTuple):
    """A lens and how well it explains the corners."""

    calibration: Calibration  # of equation 1, or the nearest to the lens of OpenCV's
    residual_px: float  # root mean square of a corner's residual from this lens, each axis
    stds: np.ndarray  # (4,) of focal length, principal point and (first) distortion, see `_deviations`
    kept: list[int]  # of all pictures that showed the board, the numbers of those that agree
    lens: Lens | None = None  # of OpenCV's, where it was asked for


def find_board(image: np.ndarray, kind: str, columns: int, rows: int) -> View | None:
    """The corners of the board in a grey ``image`` (h, w) uint8, or None if it does not show enough of it.

    A large image is searched at reduced size. The corners are refined at full size, since OpenCV's detectors shift them
    together where the board is tilted.
    """
    scale = max(1.0, max(image.shape) / _SEARCHED)
    small = reduced(image, scale)
    if kind == CHARUCO:
        board = Board(CHARUCO, columns, rows, 1.0, _MARKER_SHARE, "DICT_4X4_50")
        prints = (corners_in(small, board._replace(legacy=legacy)) for legacy in (False, True))
        points, pixels = next((one for one in prints if are_enough(one[0])), np.empty((2, 0, 3)))
        found, points = len(points) > 0, points * (1.0, -1.0, 1.0)
    else:
        cv2 = opencv()
        found, pixels = cv2.findChessboardCornersSB(small, (columns, rows), flags=cv2.CALIB_CB_ACCURACY)
        y, x = (axis.ravel() for axis in np.mgrid[:rows, :columns])
        points = np.stack((x, y, 0.0 * x), axis=1)
    if not found:
        return None
    pixels = scale * (pixels.reshape(-1, 2).astype(float) + 0.5) - 0.5
    apart = cKDTree(pixels).query(pixels, 2)[0][:, 1].min()
    return points, refined(image, pixels, max(int(_WINDOWS[kind] * apart), 3))


def fit_lens(views: Sequence[View], width: int, height: int, model: str = MODELS[0]) -> Fit:
    """The lens of images of ``width`` x ``height`` pixels that explains the ``views`` best.

    A view whose residual is far over the median of all was found in the wrong place: it is left out, and so is one with
    which OpenCV fails.

    Raises:
        ValueError: they do not determine the lens, or contradict each other.
    """
    kept, size = [*range(len(views))], (width, height)
    while True:
        if len(kept) < LEAST_PICTURES:
            raise ValueError(f"fewer than {LEAST_PICTURES} of {len(views)} pictures agree on a lens")
        try:
            lens, poses, residuals, stds = _by_opencv([views[k] for k in kept], size, model == "fisheye")
        except ValueError:
            able = [k for k in kept if _has_lens(views[k], size, model == "fisheye")]
            if len(able) == len(kept):
                raise
            kept = able
            continue
        worst, most = int(residuals.argmax()), _FAR * max(float(np.median(residuals)), _QUIET)
        if residuals[worst] <= most:
            break
        del kept[worst]
    residual = _plausible(math.sqrt(float(np.mean(residuals**2))), width)
    try:
        calibration = fitted(lens, "the fitted lens")[0]
    except ValueError:
        _demand_certainty(float(lens.matrix[0, 0]), stds[0])
        raise
    if model == MODELS[0]:
        own, (calibration, residual, stds) = residual, _equation_1([views[k] for k in kept], calibration, poses)
        if _plausible(residual, width) > max(_MISFIT * width, _UNLIKE * own):
            found = f"its residual is {residual:.1f} px, and {own:.1f} px with --model radtan"
            raise ValueError(f"the lens has not equation 1, or its pixels are not square: {found}, which fits")
    _demand_certainty(calibration.focal_px, stds[0])
    return Fit(calibration, residual, stds, kept, None if model == MODELS[0] else lens)


def _demand_certainty(focal_px: float, std: float) -> None:
    """A ValueError, if the pictures do not determine the focal length."""
    if std >= _VAGUE * focal_px:
        about = f"focal length {focal_px:.0f} +- {std:.0f} px"
        raise ValueError(f"the pictures do not determine the lens ({about}): {_TILT_IT}")


def _plausible(residual: float, width: int) -> float:
    """The ``residual`` [px]; a ValueError, if a lens for images so wide has none so large."""
    if residual > _NO_LENS * width:
        why = "corners were found in wrong places, or it is another kind of lens (--model)"
        raise ValueError(f"the pictures agree on no lens: its residual is {residual:.1f} px; {why}")
    return residual


def _by_opencv(
    views: Sequence[View], size: tuple[int, int], fisheye: bool
) -> tuple[Lens, np.ndarray, np.ndarray, np.ndarray]:
    """OpenCV's calibration: lens, poses (n, 6), residuals of the views (n,) [px], and deviations of f, u0, v0, k1."""
    cv2, K = opencv(), np.eye(3)
    points, pixels = ([np.array(view[k], np.float32).reshape(1, -1, 3 - k) for view in views] for k in (0, 1))
    try:
        if fisheye:
            names = cv2.fisheye if hasattr(cv2.fisheye, "CALIB_FIX_SKEW") else cv2  # OpenCV 4, 5
            flags = names.CALIB_RECOMPUTE_EXTRINSIC | names.CALIB_FIX_SKEW
            _, K, bent, turns, shifts = cv2.fisheye.calibrate(points, pixels, size, K, np.zeros(4), flags=flags)
        else:
            _, K, bent, turns, shifts = cv2.calibrateCamera(points, pixels, size, None, None)
    except cv2.error as error:
        said = " ".join(str(error).split())[-120:]
        raise ValueError(f"OpenCV finds no lens; {_TILT_IT}: {said}") from None
    lens, poses = Lens(size, fisheye, K, bent.ravel()), np.hstack([np.reshape(x, (-1, 3)) for x in (turns, shifts)])
    errors, J = list[np.ndarray](), list[tuple[np.ndarray, np.ndarray]]()
    project = cv2.fisheye.projectPoints if fisheye else cv2.projectPoints
    for (corners, seen), turn, shift in zip(views, turns, shifts):
        expected, by = project(corners[:, None], turn, shift, K, bent)[:2]
        errors.append((expected[:, 0] - seen).ravel())
        J.append((by[:, :8], by[:, 8:14]) if fisheye else (by[:, 6:], by[:, :6]))
    stds = _deviations(J, errors)[[0, 2, 3, 4]]
    return lens, poses, np.array([np.sqrt(np.mean(each**2)) for each in errors]), stds


def _deviations(jacobians: Sequence[tuple[np.ndarray, np.ndarray]], errors: Sequence[np.ndarray]) -> np.ndarray:
    """(m,) standard deviations of a lens's m parameters, infinite where other lenses explain the corners as well.

    Of each view: the Jacobians of the pixels by the lens (2 n, m) and by the board's pose (2 n, 6), and the residuals
    (2 n,). If these are independent, the covariance is A = s^2 (J^T J)^-1; if the residuals of a view are alike, since
    the lens is not quite of the model, it is B, of changes of the lens with each view (Bell and McCaffrey 2002). B - A
    counts where it is greater than A: few views give B roughly.
    """
    free = [J - C @ np.linalg.lstsq(C, J, rcond=None)[0] for J, C in jacobians]  # whatever the pose
    scale = np.linalg.norm(np.concatenate(free), axis=0)
    information = np.sum([(J / scale).T @ (J / scale) for J in free], axis=0)
    if not np.linalg.cond(information) < _WORST:
        return np.full(len(scale), np.inf)
    root = np.linalg.inv(np.linalg.cholesky(information)).T / scale[:, None]  # root root^T = (J^T J)^-1
    changes = []
    for J, error in zip(free, errors):
        share, axes = np.linalg.eigh(root.T @ J.T @ J @ root)  # of the information that this view has
        changes.append(root @ axes @ (axes.T @ root.T @ J.T @ error / np.sqrt(np.maximum(1.0 - share, 1e-3))))
    count = sum(map(len, errors)) - len(scale) - 6 * len(errors)
    independent = sum(error @ error for error in errors) / max(count, 1) * (root**2).sum(axis=1)
    return np.sqrt(np.maximum(independent, (np.array(changes) ** 2).sum(axis=0) - independent))


def _has_lens(view: View, size: tuple[int, int], fisheye: bool) -> bool:
    """Whether OpenCV's calibration ends with this ``view`` alone."""
    try:
        return bool(_by_opencv([view], size, fisheye))
    except ValueError:
        return False


def _before(pose: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(n, 2) where the rays of ``points`` (n, 3) of a board at a ``pose`` (6,) meet the plane at depth 1."""
    there = Rotation.from_rotvec(pose[:3]).apply(points) + pose[3:]
    return there[:, :2] / there[:, 2:]


def _equation_1(views: Sequence[View], first: Calibration, poses: np.ndarray) -> tuple[Calibration, float, np.ndarray]:
    """The calibration, its residual [px] and its `_deviations` (4,), from a ``first`` one and ``poses`` (n, 6)."""
    f = first.focal_px

    def residuals(x: np.ndarray) -> np.ndarray:
        out = []
        for (points, pixels), pose in zip(views, x[4:].reshape(-1, 6)):
            ray = _before(pose, points)
            root = np.sqrt(np.maximum(1.0 + x[3] * (x[0] / f * ray) ** 2 @ np.ones((2, 1)), 1e-3))
            out.append(x[0] * ray / root + x[1:3] - pixels)
        return np.concatenate(out).ravel()

    blocks = block_diag([coo_array(np.ones((2 * len(points), 6))) for points, _ in views])
    pattern = hstack((coo_array(np.ones((blocks.shape[0], 4))), blocks))
    start = np.concatenate(((f, *first[3:5], first.distortion * f**2), poses.ravel()))
    fit = least_squares(residuals, start, jac_sparsity=pattern, x_scale="jac", loss="soft_l1", f_scale=_BOUND)
    ends = np.cumsum([2 * len(points) for points, _ in views])[:-1]
    J, errors = np.split(fit.jac.toarray(), ends), np.split(fit.fun, ends)
    stds = _deviations([(by[:, :4], by[:, 4 + 6 * k :][:, :6]) for k, by in enumerate(J)], errors)
    found = (*first[:2], *fit.x[:3].tolist(), float(fit.x[3]) / f**2)
    calibration = calibration_from(dict(zip(Calibration._fields, found)), "the fitted lens is none that can be used")
    return calibration, math.sqrt(float(np.mean(fit.fun**2))), stds * (1.0, 1.0, 1.0, f**-2)


def calibrate(images: str | Path, kind: str, columns: int, rows: int, out: str | Path, model: str = MODELS[0]) -> Fit:
    """The lens from the pictures ``images`` (a folder, a pattern or a video) of a board, written to the file ``out`` in
    JSON: a `Calibration`, or one of the models of OpenCV as it has them.

    Raises:
        SourceError, ValueError: a picture is unreadable or of another size, or too few show the board.
        ModuleNotFoundError: OpenCV is not installed.
    """
    if kind not in KINDS:
        raise ValueError(f"kind must be one of {', '.join(KINDS)}, got {kind!r}")
    least, most = _SIDES
    if not least <= min(columns, rows) <= max(columns, rows) <= most:
        sizes = " x ".join(map(reprlib.repr, (columns, rows)))
        raise ValueError(f"the board must have {least} to {most} columns and rows, got {sizes}")
    if kind == CHARUCO and columns * rows // 2 > _MARKERS:
        raise ValueError(f"a charuco board must have at most {_MARKERS} markers, got {columns} x {rows} squares")
    views, numbers, shape = list[View](), list[int](), (0, 0)
    with argument("out"):
        demand_writable_file(Path(out))
    with argument("images", SourceError):
        source = images_of(images, timed=False)
        every = 1 + max((source.total or 0) - 1, 0) // _ENOUGH
        for number, (_, image) in islice(enumerate(source.frames), 0, None, every):
            shape = image.shape
            if (view := find_board(image, kind, columns, rows)) is not None:
                views.append(view)
                numbers.append(number)
    if len(views) < LEAST_PICTURES:
        counted = "squares" if kind == CHARUCO else "inner corners (one fewer than squares)"
        what = f"a board of {columns} x {rows} {counted}"
        raise ValueError(f"{what} was found in {len(views)} pictures; {LEAST_PICTURES} or more are needed")
    fit = fit_lens(views, shape[1], shape[0], model)
    if left_out := np.delete(numbers, fit.kept).tolist():
        named = ", ".join(source.names[k] if source.names else f"image {k} (from 0)" for k in left_out)
        print(f"left out, since no lens explains their corners with the others': {named}", file=sys.stderr)
    with written_whole(Path(out)) as unfinished:
        fields = fit.lens.fields() if fit.lens else fit.calibration._asdict()
        unfinished.write_text(json.dumps(fields, indent=1) + "\n")
    return fit


# A board that is waved before a live camera ---------------------------------------------------------------------------

BOARD = Board(CHARUCO, 7, 5, 0.036, 0.027, "DICT_4X4_50")
"""A board that fits on a sheet of A4 or Letter, of the dictionary and markers of `calibrate`."""
_CORNERS = 8  # fewest of a view
_OTHER = 0.08  # difference of a view's middle and tilts from those of every kept view, at least
_BLURRED = 0.015  # mean way of the corners since the image before, at most, in widths of the image
_LEAST, _MOST = 10, 40  # views from which a fit is tried, and at which it is taken as it is
_SURE = 0.004  # deviation of the focal length, as a share of it, at which the views are enough
_BESIDE = 0.06  # distance of a view's middle from the image's, in sizes of it
_TILT = 0.12  # growth of the depth across the board, as a share
_NEEDS: dict[str, Callable[[np.ndarray, np.ndarray], bool]] = {
    "Move the board to the upper left of the picture": lambda at, tilt: max(at) < -_BESIDE,
    "Move the board to the lower right of the picture": lambda at, tilt: min(at) > _BESIDE,
    "Move the board to the upper right of the picture": lambda at, tilt: min(at[0], -at[1]) > _BESIDE,
    "Move the board to the lower left of the picture": lambda at, tilt: min(-at[0], at[1]) > _BESIDE,
    "Tilt the board, its left side nearer to the camera": lambda at, tilt: tilt[0] > _TILT,
    "Tilt the board, its right side nearer to the camera": lambda at, tilt: tilt[0] < -_TILT,
    "Tilt the board, its top nearer to the camera": lambda at, tilt: tilt[1] > _TILT,
    "Tilt the board, its bottom nearer to the camera": lambda at, tilt: tilt[1] < -_TILT,
}
"""What views must show: of the view's middle, from the image's, and of its tilts by columns and rows."""


class BoardCalibration:
    """Collects views of `BOARD` until they determine the lens."""

    def __init__(self) -> None:
        self._needs, self._tried = dict(_NEEDS), _LEAST - 1
        self._views: list[View] = []
        self._shown: list[np.ndarray] = []
        self._last: View | None = None
        self._shape, self._why = tuple[int, ...](), ""
        self.fit: Fit | None = None
        """The lens, as soon as it is known."""

    def add(self, image: np.ndarray) -> str:
        """Take in an image (h, w) uint8; a sentence for the person who waves. At the end there is a `fit`."""
        if self._views and image.shape != self._shape:
            (h, w), (height, width) = image.shape, self._shape
            return f"Turn the device back: the first views are of {width} x {height} pixels, and this one of {w} x {h}."
        view = find_board(image, BOARD.kind, BOARD.columns, BOARD.rows)
        before, self._last = self._last, view
        if view is None or len(view[0]) < _CORNERS:
            words = "Hold the board before the camera, so that its squares are seen"
        elif before is None or way_between(before, view) > _BLURRED * image.shape[1]:
            words = "Move more slowly"
        else:
            at, tilt = view[1].mean(axis=0) / image.shape[::-1] - 0.5, _tilt(view)
            needs = {words: need for words, need in self._needs.items() if not need(at, tilt)}
            shows = np.concatenate((at, tilt))
            new = all(np.linalg.norm(shows - one) > _OTHER for one in self._shown)
            if new or len(needs) < len(self._needs):
                self._needs = needs
                self._shown.append(shows)
                self._keep(view, image.shape)
            words = self._why or next(iter(self._needs), "Tilt the board in other ways, nearer and farther away")
        return f"{words} ({len(self._views)} views so far)."

    def _keep(self, view: View, shape: tuple[int, ...]) -> None:
        """Keep a view, and try a fit where views are enough."""
        self._views.append(view)
        self._shape = shape
        enough = len(self._views) >= _MOST
        if len(self._views) <= self._tried or (self._needs and not enough):
            return
        self._tried = len(self._views) + 1
        try:
            fit = fit_lens(self._views, shape[1], shape[0])
        except ValueError as error:  # it is not determined yet
            self._why = f"No lens is found: {error}" if enough else ""
            return
        if enough or fit.stds[0] < _SURE * fit.calibration.focal_px:
            self.fit = fit


def _tilt(view: View) -> np.ndarray:
    """(2,) growth of the depth from the board's left to its right and from top to bottom, as a share of it."""
    H, _ = opencv().findHomography(view[0][:, :2], view[1])
    return H[2, :2] * (BOARD.columns, BOARD.rows) / H[2, 2]


def way_between(one: View, other: View) -> float:
    """Mean way of the corners that both views show [px]; infinite where there is none."""
    same = (np.abs(one[0][:, None] - other[0]) < 0.1).all(axis=-1)
    i, j = np.nonzero(same)
    return float(np.linalg.norm(one[1][i] - other[1][j], axis=1).mean()) if len(i) else np.inf


def sheet() -> bytes:
    """`BOARD` as an SVG to be printed at 100 %, on white."""
    png = base64.b64encode(opencv().imencode(".png", printed(BOARD))[1].tobytes()).decode()
    width, height = np.rint(1e3 * BOARD.size).astype(int)
    around = f'width="{width + 20}mm" height="{height + 20}mm" viewBox="-10 -10 {width + 20} {height + 20}"'
    ground = f'<rect x="-10" y="-10" width="{width + 20}" height="{height + 20}" fill="#fff"/>'
    picture = f'<image width="{width}" height="{height}" href="data:image/png;base64,{png}"/>'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {around}>{ground}{picture}</svg>'.encode()
