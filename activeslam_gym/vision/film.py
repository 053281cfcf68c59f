"""A film of a track: the image with the searches and matches, beside the map from above."""

from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from activeslam_gym.files import written_whole
from activeslam_gym.motion import CAMERA_DIM
from activeslam_gym.slam.association import REJECTED
from activeslam_gym.vision.frontend import FrontEnd
from activeslam_gym.vision.opencv import opencv

_SCALE = 2  # pixels of the film for one of the image
_MATCHED, _MISSED, _PATH, _FEATURE = (80, 200, 80), (60, 60, 230), (0, 94, 213), (150, 150, 150)  # blue, green, red
_CODES = {".mp4": "mp4v", ".avi": "MJPG"}


class Film:
    """Writes a picture an image to the video ``path`` (.mp4 or .avi), ``rate`` [Hz]: a context, at whose end the file
    is there, whole or not at all.

    Raises:
        ValueError: ``path`` ends otherwise.
        OSError: at the end, the video cannot be read again: the disk is full.
    """

    def __init__(self, path: str | Path, rate: float) -> None:
        self._path, self._rate = Path(path), float(rate)
        self._writer: Any = None
        self._at_close = ExitStack()
        self._written = 0
        self._track: list[np.ndarray] = []
        if self._path.suffix not in _CODES:
            raise ValueError(f"a film is .mp4 or .avi, got {path}")

    def add(self, front_end: FrontEnd, image: np.ndarray) -> None:
        """The moment after ``image`` (h, w)."""
        cv2 = opencv()
        picture = np.hstack((_seen(cv2, front_end, image), self._map(cv2, front_end, image.shape)))
        if self._writer is None:
            self._unfinished = self._at_close.enter_context(written_whole(self._path))
            code = cv2.VideoWriter_fourcc(*_CODES[self._path.suffix])
            self._writer = cv2.VideoWriter(str(self._unfinished), code, self._rate, picture.shape[1::-1])
            self._at_close.push(self._finish)
        self._writer.write(picture)
        self._written += 1

    def __enter__(self) -> "Film":
        return self

    def __exit__(self, *error: Any) -> None:
        self._at_close.__exit__(*error)

    def _finish(self, *error: Any) -> None:
        """Demand that each picture is in the file: OpenCV does not tell that it could not write one."""
        cv2 = opencv()
        self._writer.release()
        if any(error):
            return  # which `written_whole` sees too
        if cv2.VideoCapture(str(self._unfinished)).get(cv2.CAP_PROP_FRAME_COUNT) < self._written:
            raise OSError(f"{self._path} cannot be written as a video (is the disk full?)")

    def _map(self, cv2: Any, front_end: FrontEnd, shape: tuple[int, ...]) -> np.ndarray:
        """X to the right and Z downwards, as seen from above: features with their ellipses (2 sigma), and the path."""
        points, P = front_end.filter.points()
        self._track.append(front_end.filter.mean[:3])
        path, fiducials, points = (np.array(p)[:, [0, 2]] for p in (self._track, front_end.filter.fiducials, points))
        low, high = np.percentile(np.concatenate((points, fiducials, path)), [2, 98], axis=0)
        size = _SCALE * np.array(shape[::-1])
        scale = 0.8 * (size / np.maximum(high - low, 0.5)).min()
        path, fiducials, points = (scale * (p - 0.5 * (low + high)) + 0.5 * size for p in (path, fiducials, points))
        picture = np.full((*size[::-1], 3), 255, np.uint8)
        for k, point in enumerate(points):
            own = CAMERA_DIM + 3 * k + np.array((0, 2))
            _ellipse(cv2, picture, point, scale**2 * P[np.ix_(own, own)], 2.0, _FEATURE)
        for point in fiducials:
            cv2.circle(picture, tuple(np.rint(point).astype(int).tolist()), 3, (0, 0, 0), -1)
        cv2.polylines(picture, [np.rint(path).astype(np.int32)], False, _PATH, 2)
        return picture


def _seen(cv2: Any, front_end: FrontEnd, image: np.ndarray) -> np.ndarray:
    """The image with the ellipses (3 sigma) of the features that should be in view, and a point at each match."""
    picture = cv2.cvtColor(np.repeat(np.repeat(image, _SCALE, 0), _SCALE, 1), cv2.COLOR_GRAY2BGR)
    sight, found = front_end.filter.sight(), front_end.candidates
    matched = found[found["match"] != REJECTED]
    for a, (id, z) in enumerate(zip(sight.thing["id"], sight.thing["z_hat"])):
        S = sight.S[2 * a : 2 * a + 2, 2 * a : 2 * a + 2]
        colour = _MATCHED if id in matched["match"] else _MISSED
        _ellipse(cv2, picture, _SCALE * z, _SCALE**2 * S, 3.0, colour)
    for pixel in matched["pixel"]:
        cv2.circle(picture, tuple(np.rint(_SCALE * pixel).astype(int).tolist()), 2, _MATCHED, -1)
    return picture


def _ellipse(cv2: Any, picture: np.ndarray, middle: np.ndarray, covariance: np.ndarray, sigmas: float, colour: Any):
    """The contour of a Gaussian, unless it is larger than the picture."""
    squares, axes = np.linalg.eigh(covariance)
    if np.isfinite(middle).all() and 0.0 < squares[0] and squares[1] < max(picture.shape) ** 2:
        angle, sides = float(np.degrees(np.arctan2(axes[1, 1], axes[0, 1]))), 2.0 * sigmas * np.sqrt(squares[::-1])
        cv2.ellipse(picture, (tuple(middle.tolist()), tuple(sides.tolist()), angle), colour, 1)
