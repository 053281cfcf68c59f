"""The lens of equation 1 that explains pictures of a flat board with known corners: the command ``calibrate``.

A board is a chessboard of so many inner corners, or a ChArUco board of so many squares. Its size does not enter the
lens. Axes are those of image files here, x right and y down, in which equation 1 is u = u0 + u_c / sqrt(1 + K r_c^2).
"""

import json
import math
import reprlib
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from activeslam_gym.files import written_whole
from activeslam_gym.vision.calibration import Calibration
from activeslam_gym.vision.first_sight import LEAST_CORNERS, corners_in
from activeslam_gym.vision.opencv import opencv
from activeslam_gym.vision.sources import open_images
from activeslam_gym.vision.target import CHARUCO, Board

KINDS = ("chessboard", CHARUCO)
LEAST_PICTURES = 3
_SIDES = (3, 100)  # fewest and most columns and rows of a board
_MARKER_SHARE = 0.75  # side of a ChArUco board's markers, in squares
_MARKERS = 50  # markers of its dictionary, 4x4_50: a board has at most as many
_FOCALS = (0.45, 0.65, 0.9, 1.3)  # focal lengths from which the fit starts, in widths of the image

View = tuple[np.ndarray, np.ndarray]
"""Corners on the board (n, 3) [squares] and in the picture (n, 2) [px]."""


class Fit(NamedTuple):
    """A lens and how well it explains the corners."""

    calibration: Calibration
    residual_px: float  # root mean square of a corner's residual, each axis
    stds: np.ndarray  # (4,) of focal length, principal point and distortion, from the residual
    pictures: int  # that showed the board


def find_board(image: np.ndarray, kind: str, columns: int, rows: int) -> View | None:
    """The corners of the board in a grey ``image`` (h, w) uint8, or None if it does not show enough of it."""
    if kind == CHARUCO:
        board = Board(CHARUCO, columns, rows, 1.0, _MARKER_SHARE, "DICT_4X4_50")
        points, pixels = corners_in(image, board)
        return (points * (1.0, -1.0, 1.0), pixels) if len(points) >= LEAST_CORNERS else None
    cv2 = opencv()
    found, pixels = cv2.findChessboardCornersSB(image, (columns, rows), flags=cv2.CALIB_CB_ACCURACY)
    y, x = (axis.ravel() for axis in np.mgrid[:rows, :columns])
    return (np.stack((x, y, 0.0 * x), axis=1), pixels.reshape(-1, 2).astype(float)) if found else None


def fit_lens(views: Sequence[View], width: int, height: int) -> Fit:
    """The lens of images of ``width`` x ``height`` pixels that explains the ``views`` best.

    Raises:
        ValueError: there are too few views, or no lens explains them.
    """
    if len(views) < LEAST_PICTURES:
        raise ValueError(f"the board was found in {len(views)} pictures; {LEAST_PICTURES} or more are needed")
    fits = [least_squares(_residuals, _guess(views, share * width, width, height), args=(views,), x_scale="jac",
                          max_nfev=60) for share in _FOCALS]  # fmt: skip
    fits = [fit for fit in fits if np.isfinite(fit.cost) and fit.x[0] > 0.0]
    if not fits:
        raise ValueError("no lens explains the corners of the board")
    best = min(fits, key=lambda fit: fit.cost)
    best = least_squares(_residuals, best.x, args=(views,), x_scale="jac", loss="soft_l1", f_scale=1.0)
    f, u0, v0, bend = best.x[:4]
    degrees = max(len(best.fun) - len(best.x), 1)
    spread = np.sqrt(np.diag(np.linalg.pinv(best.jac.T @ best.jac))[:4] * (best.fun @ best.fun) / degrees)
    lens = Calibration(width, height, float(f), float(u0), float(v0), max(float(bend), 0.0))
    return Fit(lens, math.sqrt(float(np.mean(best.fun**2))), spread, len(views))


def _residuals(x: np.ndarray, views: Sequence[View]) -> np.ndarray:
    """Predicted - measured pixels. ``x``: f, u0, v0, K, then each board's rotation vector and place in the camera."""
    f, u0, v0, bend = x[:4]
    out = []
    for (points, pixels), pose in zip(views, x[4:].reshape(-1, 6)):
        p = Rotation.from_rotvec(pose[:3]).apply(points) + pose[3:]
        u_c = f * p[:, :2] / np.maximum(p[:, 2:], 1e-3)
        d = np.maximum(1.0 + bend * (u_c**2).sum(1), 1e-3)
        out.append(u_c / np.sqrt(d)[:, None] + (u0, v0) - pixels)
    return np.concatenate(out).ravel()


def _guess(views: Sequence[View], focal: float, width: int, height: int) -> np.ndarray:
    """The parameters for a lens without distortion, with each board's pose through it."""
    cv2, middle = opencv(), 0.5 * np.array((width - 1.0, height - 1.0))
    poses = [cv2.solvePnP(points, (pixels - middle) / focal, np.eye(3), None)[1:] for points, pixels in views]
    return np.concatenate(((focal, *middle, 0.0), *(np.ravel(pose) for pose in poses)))


def calibrate(images: str | Path, kind: str, columns: int, rows: int, out: str | Path) -> Fit:
    """The lens from the pictures ``images`` (a folder, a pattern or a video) of a board, written to the file ``out``.

    Raises:
        SourceError, ValueError: a picture is unreadable, coloured or of another size, or too few show the board.
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
    views, shape = [], (0, 0)
    for _, image in open_images(images, 1.0):
        shape = image.shape
        if (view := find_board(image, kind, columns, rows)) is not None:
            views.append(view)
    fit = fit_lens(views, shape[1], shape[0])
    with written_whole(Path(out)) as unfinished:
        unfinished.write_text(json.dumps(fit.calibration._asdict(), indent=1) + "\n")
    return fit
