"""A film of a track: the image with what was searched and found, beside the map from above."""

from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from activeslam_gym.files import written_whole
from activeslam_gym.motion import CAMERA_DIM
from activeslam_gym.slam.association import REJECTED
from activeslam_gym.vision.frontend import FrontEnd
from activeslam_gym.vision.opencv import opencv

_SCALE = 2
"""Pixels of the film for one of the image."""
_BELIEVED, _MISSED, _PATH, _GREY = (80, 200, 80), (60, 60, 230), (0, 94, 213), (150, 150, 150)
"""Blue, green, red: ellipses of what was matched and what was not, the camera's path, features."""


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
        kinds = {".mp4": "mp4v", ".avi": "MJPG"}
        if self._path.suffix not in kinds:
            raise ValueError(f"a film is .mp4 or .avi, got {path}")
        self._kind = kinds[self._path.suffix]

    def add(self, front_end: FrontEnd, image: np.ndarray) -> None:
        """The moment after ``image`` (h, w)."""
        cv2 = opencv()
        picture = np.hstack((_seen(cv2, front_end, image), self._map(cv2, front_end, image.shape)))
        if self._writer is None:
            self._unfinished = self._at_close.enter_context(written_whole(self._path))
            code = cv2.VideoWriter_fourcc(*self._kind)
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
        everything = np.concatenate((points, front_end.filter.fiducials, self._track))[:, [0, 2]]
        low, high = np.percentile(everything, [2, 98], axis=0)
        h, w = _SCALE * shape[0], _SCALE * shape[1]
        per_metre = 0.8 * min(w / max(high[0] - low[0], 0.5), h / max(high[1] - low[1], 0.5))
        picture, middle = np.full((h, w, 3), 255, np.uint8), 0.5 * (low + high)

        def at(point: np.ndarray) -> np.ndarray:
            return per_metre * (point[..., [0, 2]] - middle) + (0.5 * w, 0.5 * h)

        for k, point in enumerate(points):
            own = slice(CAMERA_DIM + 3 * k, CAMERA_DIM + 3 * k + 3)
            _ellipse(cv2, picture, at(point), per_metre**2 * P[own, own][np.ix_([0, 2], [0, 2])], 2.0, _GREY)
        for point in at(front_end.filter.fiducials):
            cv2.circle(picture, tuple(np.rint(point).astype(int).tolist()), 3, (0, 0, 0), -1)
        cv2.polylines(picture, [np.rint(at(np.array(self._track))).astype(np.int32)], False, _PATH, 2)
        return picture


def _seen(cv2: Any, front_end: FrontEnd, image: np.ndarray) -> np.ndarray:
    """The image with the ellipses (3 sigma) of what should be in view, and a point where a match was believed."""
    picture = cv2.cvtColor(np.repeat(np.repeat(image, _SCALE, 0), _SCALE, 1), cv2.COLOR_GRAY2BGR)
    sight, found = front_end.filter.sight(), front_end.candidates
    believed = found[found["match"] != REJECTED]
    for a, (id, z) in enumerate(zip(sight.thing["id"], sight.thing["z_hat"])):
        S = sight.S[2 * a : 2 * a + 2, 2 * a : 2 * a + 2]
        colour = _BELIEVED if id in believed["match"] else _MISSED
        _ellipse(cv2, picture, _SCALE * z, _SCALE**2 * S, 3.0, colour)
    for pixel in believed["pixel"]:
        cv2.circle(picture, tuple(np.rint(_SCALE * pixel).astype(int).tolist()), 2, _BELIEVED, -1)
    return picture


def _ellipse(cv2: Any, picture: np.ndarray, middle: np.ndarray, covariance: np.ndarray, sigmas: float, colour: Any):
    """The contour of a Gaussian, unless it is larger than the picture."""
    squares, axes = np.linalg.eigh(covariance)
    if not (np.isfinite(middle).all() and 0.0 < squares[0] and squares[1] < max(picture.shape) ** 2):
        return
    angle = float(np.degrees(np.arctan2(axes[1, 1], axes[0, 1])))
    half = tuple((sigmas * np.sqrt(squares[::-1])).tolist())
    cv2.ellipse(picture, (tuple(middle.tolist()), (2 * half[0], 2 * half[1]), angle), colour, 1)
