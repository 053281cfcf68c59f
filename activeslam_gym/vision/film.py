"""A film of a track: the image with the searches and matches, beside the map from above."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from activeslam_gym.files import written_whole
from activeslam_gym.motion import CAMERA_DIM
from activeslam_gym.slam.association import REJECTED
from activeslam_gym.vision.frontend import FrontEnd
from activeslam_gym.vision.opencv import opencv
from activeslam_gym.vision.views import reduced

_SCALE = 2  # pixels of the film for one of the image
_MATCHED, _MISSED, _PATH, _FEATURE = (80, 200, 80), (60, 60, 230), (0, 94, 213), (150, 150, 150)  # blue, green, red
_CODES = {".mp4": "mp4v", ".avi": "MJPG"}


@contextmanager
def film_to(path: Path, rate: float) -> Iterator[Callable[[FrontEnd, np.ndarray], None]]:
    """A function that adds the picture of the moment after an image (h, w) to the video ``path`` (.mp4 or .avi), of
    ``rate`` [Hz]: a context, at whose end the file is there, whole or not at all.

    Raises:
        ValueError: ``path`` ends otherwise.
        OSError: at the end, the video cannot be read again: the disk is full.
    """
    if path.suffix not in _CODES:
        raise ValueError(f"a film is .mp4 or .avi, got {path}")
    cv2, pictures = opencv(), 0
    writer, unfinished, track = None, path, list[np.ndarray]()
    with ExitStack() as at_close:

        def add(front_end: FrontEnd, image: np.ndarray) -> None:
            nonlocal writer, unfinished, pictures
            track.append(front_end.filter.mean[:3])
            image = reduced(image, image.shape[1] // int(front_end.camera.width))
            picture = np.hstack((_seen(cv2, front_end, image), _map(cv2, front_end, track, image.shape)))
            if writer is None:
                unfinished = at_close.enter_context(written_whole(path))
                code = cv2.VideoWriter_fourcc(*_CODES[path.suffix])
                writer = cv2.VideoWriter(str(unfinished), code, float(rate), picture.shape[1::-1])
            writer.write(picture)
            pictures += 1

        try:
            yield add
        finally:
            if writer is not None:
                writer.release()
        # OpenCV does not tell that it could not write a picture
        if pictures and cv2.VideoCapture(str(unfinished)).get(cv2.CAP_PROP_FRAME_COUNT) < pictures:
            raise OSError(f"{path} cannot be written as a video (is the disk full?)")


def _map(cv2: Any, front_end: FrontEnd, track: list[np.ndarray], shape: tuple[int, ...]) -> np.ndarray:
    """X to the right and Z downwards, as seen from above: features with their ellipses (2 sigma), and the path."""
    points, P = front_end.filter.points()
    path, fiducials, points = (np.array(p)[:, [0, 2]] for p in (track, front_end.filter.fiducials, points))
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
