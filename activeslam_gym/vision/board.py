"""Pictures of a flat board with known corners, and the lens of equation 1 that explains them: what ``calibrate`` does.

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
from activeslam_gym.vision.opencv import opencv
from activeslam_gym.vision.sources import open_images

KINDS = ("chessboard", "charuco")
LEAST_PICTURES = 3
_SIDES = (3, 100)
"""The fewest and the most columns and rows of a board."""
_MARKER_SHARE = 0.75
"""Side of a ChArUco board's markers, in squares."""
_MARKERS = 50
"""Markers of its dictionary, 4x4_50: a board has at most as many."""
_FOCALS = (0.45, 0.65, 0.9, 1.3)
"""Focal lengths from which the fit starts, in widths of the image."""

View = tuple[np.ndarray, np.ndarray]
"""Corners on the board (n, 2) [squares] and in the picture (n, 2) [px]."""


class Fit(NamedTuple):
    """A lens and how well it explains the corners."""

    calibration: Calibration
    residual_px: float
    """Root mean square of a corner's residual, each axis [px]."""
    stds: np.ndarray
    """(4,) of focal length, principal point and distortion, from the residual."""
    pictures: int
    """That showed the board."""


def find_board(image: np.ndarray, kind: str, columns: int, rows: int) -> View | None:
    """The corners of the board in a grey ``image`` (h, w) uint8, or None if it does not show enough of it."""
    cv2 = opencv()
    if kind == "charuco":
        aruco = cv2.aruco
        board = aruco.CharucoBoard(
            (columns, rows), 1.0, _MARKER_SHARE, aruco.getPredefinedDictionary(aruco.DICT_4X4_50)
        )
        pixels, ids = aruco.CharucoDetector(board).detectBoard(image)[:2]
        if ids is None or len(ids) < 6:
            return None
        return np.array(board.getChessboardCorners())[ids.ravel(), :2].astype(float), pixels.reshape(-1, 2).astype(
            float
        )
    found, pixels = cv2.findChessboardCornersSB(image, (columns, rows), flags=cv2.CALIB_CB_ACCURACY)
    if not found:
        return None
    y, x = np.mgrid[:rows, :columns]
    return np.stack((x.ravel(), y.ravel()), axis=1).astype(float), pixels.reshape(-1, 2).astype(float)


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
        p = Rotation.from_rotvec(pose[:3]).apply(np.pad(points, ((0, 0), (0, 1)))) + pose[3:]
        u_c = f * p[:, :2] / np.maximum(p[:, 2:], 1e-3)
        d = np.maximum(1.0 + bend * (u_c**2).sum(1), 1e-3)
        out.append(u_c / np.sqrt(d)[:, None] + (u0, v0) - pixels)
    return np.concatenate(out).ravel()


def _guess(views: Sequence[View], focal: float, width: int, height: int) -> np.ndarray:
    """The parameters for a lens without distortion: each board's pose is that of its homography."""
    middle = 0.5 * np.array((width - 1.0, height - 1.0))
    poses = [_pose(points, (pixels - middle) / focal) for points, pixels in views]
    return np.concatenate(((focal, *middle, 0.0), *poses))


def _pose(points: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """(6,) the pose of a board whose ``points`` (n, 2) are seen along (x, y, 1): H = [r1 r2 t] (Zhang 2000)."""
    one, zero = np.ones((len(points), 1)), np.zeros((len(points), 3))
    h = np.hstack((points, one))
    rows = np.vstack((np.hstack((h, zero, -rays[:, :1] * h)), np.hstack((zero, h, -rays[:, 1:] * h))))
    H = np.linalg.svd(rows)[2][-1].reshape(3, 3)
    H /= math.copysign(math.sqrt(np.linalg.norm(H[:, 0]) * np.linalg.norm(H[:, 1])), H[2] @ (*points.mean(0), 1.0))
    U, _, Vt = np.linalg.svd(np.column_stack((H[:, 0], H[:, 1], np.cross(H[:, 0], H[:, 1]))))
    R = U @ np.diag((1.0, 1.0, np.linalg.det(U @ Vt))) @ Vt
    return np.concatenate((Rotation.from_matrix(R).as_rotvec(), H[:, 2]))


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
    if kind == "charuco" and columns * rows // 2 > _MARKERS:
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
