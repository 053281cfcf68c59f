"""Sources of images: a folder, a pattern, a video, a live camera. Each is an iterator of (time [s], grey image (h, w)
uint8)."""

import glob
import math
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from activeslam_gym.vision.opencv import opencv

Frame = tuple[float, np.ndarray]
"""Time [s] and grey image (h, w) uint8."""

PICTURES = (".png", ".pgm", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")
"""Endings of the pictures that a folder is searched for."""
CAMERA = "camera:"
"""What the name of a live camera begins with; its number follows."""


class SourceError(ValueError):
    """Images are missing or are not what they should be. What came before has been handed out and stays valid."""


def open_images(path: str | Path, rate: float) -> Iterator[Frame]:
    """The images that ``path`` means, ``rate`` [Hz] a second: a folder, a pattern (``shots/*.png``) or a video; or of
    the live camera ``camera:0``, in grey, with the times at which they came.

    Raises:
        SourceError: there is nothing there (said at once), or an image is unreadable, coloured or of another size than
            the first (said when it is reached).
        ValueError: ``rate`` is not positive and finite.
        ModuleNotFoundError: OpenCV is not installed.
    """
    if not 0.0 < rate < math.inf:
        raise ValueError(f"rate must be a positive number of images a second, got {rate!r}")
    if str(path).startswith(CAMERA):
        return _live(str(path))
    where = Path(path)
    if where.is_dir():
        files = sorted(file for file in where.iterdir() if file.suffix.lower() in PICTURES)
        return _checked(_pictures(files, f"the folder {path} holds no picture ({', '.join(PICTURES)})"), rate)
    if where.is_file():
        return _checked(_video(where), rate)
    if glob.has_magic(str(path)):
        files = sorted(Path(name) for name in glob.glob(str(path)))
        return _checked(_pictures(files, f"nothing matches the pattern {path}"), rate)
    raise SourceError(f"there is no {path}")


def image_count(path: str | Path) -> int | None:
    """How many images ``path`` means, or None where nobody knows: a live camera, some videos."""
    where = Path(path)
    if where.is_dir():
        return sum(file.suffix.lower() in PICTURES for file in where.iterdir())
    if where.is_file():
        cv2 = opencv()
        return int(cv2.VideoCapture(str(where)).get(cv2.CAP_PROP_FRAME_COUNT)) or None
    return len(glob.glob(str(path))) or None


def _checked(images: Iterator[tuple[str, np.ndarray]], rate: float) -> Iterator[Frame]:
    """The images with their times, each grey and of the first one's size. Opened at once, so errors come at once."""
    name, first = next(images)
    grey = _grey(first, name)

    def rest() -> Iterator[Frame]:
        yield 0.0, grey
        for k, (name, image) in enumerate(images, 1):
            now = _grey(image, name)
            if now.shape != grey.shape:
                raise SourceError(f"{name} is of {_size(now)} pixels, the first image of {_size(grey)}")
            yield k / rate, now

    return rest()


def _grey(image: np.ndarray, name: str) -> np.ndarray:
    """The image (h, w) uint8; three equal channels count as grey.

    Raises:
        SourceError: it has colours, or no 8 bits.
    """
    if image.dtype != np.uint8:
        raise SourceError(f"{name} has {image.dtype} pixels; 8-bit grey is needed")
    if image.ndim == 2:
        return image
    one = image[:, :, 0]
    if any(not np.array_equal(one, image[:, :, channel]) for channel in range(1, min(image.shape[2], 3))):
        raise SourceError(f"{name} is in colour; grey images are needed (convert them first)")
    return np.ascontiguousarray(one)


def _size(image: np.ndarray) -> str:
    return f"{image.shape[1]} x {image.shape[0]}"


def _pictures(files: list[Path], nothing: str) -> Iterator[tuple[str, np.ndarray]]:
    if not files:
        raise SourceError(nothing)
    cv2 = opencv()
    for file in files:
        try:
            image = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
        except cv2.error:  # it has more pixels than OpenCV reads
            image = None
        if image is None:
            raise SourceError(f"{file} cannot be read as a picture")
        yield file.name, image


def _video(path: Path) -> Iterator[tuple[str, np.ndarray]]:
    cv2 = opencv()
    capture = cv2.VideoCapture(str(path))
    try:
        if not capture.isOpened():
            raise SourceError(f"{path} cannot be read as a video")
        count = 0
        while True:
            there, image = capture.read()
            if not there:
                break
            yield f"image {count} of {path.name}", image
            count += 1
        if count == 0:
            raise SourceError(f"{path} holds no image that can be read")
        if 0 < count < int(capture.get(cv2.CAP_PROP_FRAME_COUNT)):
            raise SourceError(f"{path} breaks off after {count} images")
    finally:
        capture.release()


def _live(name: str) -> Iterator[Frame]:
    """The images of a live camera, until it stops; opened at once, so that errors come at once."""
    cv2, number = opencv(), name.removeprefix(CAMERA)
    if not number.isdecimal():
        raise SourceError(f"a camera is camera:0, camera:1 and so on, got {name}")
    capture = cv2.VideoCapture(int(number))
    if not capture.isOpened():
        raise SourceError(f"{name} is not there or cannot be opened")

    def frames() -> Iterator[Frame]:
        began = time.monotonic()
        try:
            while True:
                there, image = capture.read()
                if not there:
                    raise SourceError(f"{name} has stopped")
                grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
                yield time.monotonic() - began, grey
        finally:
            capture.release()

    return frames()
