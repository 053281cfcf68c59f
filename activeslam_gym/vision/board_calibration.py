"""A calibration by waving a board before a camera: which of its views are kept, and where to hold it next."""

import base64
from collections.abc import Callable

import numpy as np

from activeslam_gym.vision.board import Fit, View, find_board, fit_lens
from activeslam_gym.vision.drawing import printed
from activeslam_gym.vision.opencv import opencv
from activeslam_gym.vision.target import CHARUCO, Board

BOARD = Board(CHARUCO, 7, 5, 0.036, 0.027, "DICT_4X4_50")
"""A board that fits on a sheet of A4 or Letter, of the dictionary and markers of `calibrate`."""
_CORNERS = 8
"""Fewest corners of a view."""
_OTHER, _BLURRED = 0.08, 0.015
"""Difference of a view's middle and tilts from those of every kept view, at least; mean way of the corners since the
image before, at most, in widths of the image."""
_LEAST, _MOST = 10, 40
"""Views from which a fit is tried, and at which it is taken as it is."""
_SURE = 0.004
"""Deviation of the focal length, as a share of it, at which the views are enough."""
_BESIDE, _TILT = 0.06, 0.12
"""Distance of a view's middle from the image's, in sizes of it; growth of the depth across the board, as a share."""
Need = Callable[[np.ndarray, np.ndarray], bool]
_NEEDS: dict[str, Need] = {
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
    """Collects views of a ``board`` until they determine the lens."""

    def __init__(self, board: Board = BOARD) -> None:
        self._board, self._needs, self._tried = board, dict(_NEEDS), _LEAST - 1
        self._views: list[View] = []
        self._shown: list[np.ndarray] = []
        self._last: View | None = None
        self.fit: Fit | None = None
        """The lens, as soon as it is known."""

    def add(self, image: np.ndarray) -> str:
        """Take in an image (h, w) uint8; a sentence for the person who waves. At the end there is a `fit`."""
        view = find_board(image, self._board.kind, self._board.columns, self._board.rows)
        before, self._last = self._last, view
        if view is None or len(view[0]) < _CORNERS:
            words = "Hold the board before the camera, so that its squares are seen"
        elif before is None or _way(before, view) > _BLURRED * image.shape[1]:
            words = "Move more slowly"
        else:
            at, tilt = view[1].mean(axis=0) / image.shape[::-1] - 0.5, self._tilt(view)
            needs = {words: need for words, need in self._needs.items() if not need(at, tilt)}
            shows = np.concatenate((at, tilt))
            new = all(np.linalg.norm(shows - one) > _OTHER for one in self._shown)
            if new or len(needs) < len(self._needs):
                self._needs = needs
                self._shown.append(shows)
                self._keep(view, image.shape)
            words = next(iter(self._needs), "Tilt the board in other ways, nearer and farther away")
        return f"{words} ({len(self._views)} views so far)."

    def _keep(self, view: View, shape: tuple[int, ...]) -> None:
        """Keep a view, and try a fit where views are enough."""
        self._views.append(view)
        enough = len(self._views) >= _MOST
        if len(self._views) <= self._tried or (self._needs and not enough):
            return
        self._tried = len(self._views) + 1
        try:
            fit = fit_lens(self._views, shape[1], shape[0])
        except ValueError:  # it is not determined yet
            return
        if enough or fit.stds[0] < _SURE * fit.calibration.focal_px:
            self.fit = fit

    def _tilt(self, view: View) -> np.ndarray:
        """(2,) growth of the depth from the board's left to its right and from top to bottom, as a share of it."""
        H, _ = opencv().findHomography(view[0][:, :2], view[1])
        return H[2, :2] * (self._board.columns, self._board.rows) / H[2, 2]


def _way(one: View, other: View) -> float:
    """Mean way of the corners that both show [px]; infinite where there is none."""
    same = (np.abs(one[0][:, None] - other[0]) < 0.1).all(axis=-1)
    i, j = np.nonzero(same)
    return float(np.linalg.norm(one[1][i] - other[1][j], axis=1).mean()) if len(i) else np.inf


def sheet(board: Board = BOARD) -> bytes:
    """The ``board`` as an SVG to be printed at 100 %, on white."""
    png = base64.b64encode(opencv().imencode(".png", printed(board))[1].tobytes()).decode()
    width, height = np.rint(1e3 * board.size).astype(int)
    around = f'width="{width + 20}mm" height="{height + 20}mm" viewBox="-10 -10 {width + 20} {height + 20}"'
    ground = f'<rect x="-10" y="-10" width="{width + 20}" height="{height + 20}" fill="#fff"/>'
    picture = f'<image width="{width}" height="{height}" href="data:image/png;base64,{png}"/>'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {around}>{ground}{picture}</svg>'.encode()
