"""Sources of images: a folder, a pattern, a video, a live camera. Each is an iterator of `Frame`."""

import glob
import math
import sys
import time
from collections.abc import Iterable, Iterator
from itertools import chain
from pathlib import Path

import numpy as np

from activeslam_gym.vision.opencv import opencv

Frame = tuple[float, np.ndarray]
"""Time [s] and grey image (h, w) uint8."""
PICTURES = (".png", ".pgm", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".ppm", ".pnm", ".jp2")
"""Endings of the pictures that a folder is searched for."""
CAMERA = "camera:"
"""The name of a live camera begins with it; its number follows."""


class SourceError(ValueError):
    """Images are missing or are not as they should be. Those before have been handed out and stay valid."""


def open_images(path: str | Path, rate: float) -> Iterator[Frame]:
    """The images of the source ``path``, ``rate`` [Hz] a second: a folder, a pattern (``shots/*.png``) or a video; or
    of the live camera ``camera:0``, in grey, with the times at which they came.

    Raises:
        SourceError: there is nothing there (said at once), or an image is unreadable or of another size than the
            first (said when it is reached).
        ValueError: ``rate`` is not positive and finite.
        ModuleNotFoundError: OpenCV is not installed.
    """
    if not 0.0 < rate < math.inf:
        raise ValueError(f"rate must be a positive number of images a second, got {rate!r}")
    frames = _live(str(path)) if str(path).startswith(CAMERA) else _timed(_stored(path), rate)
    return chain([next(frames)], frames)  # so that errors come at once


def _stored(path: str | Path) -> Iterator[tuple[str, np.ndarray]]:
    """The images of a folder, a pattern or a video with their names."""
    if Path(path).is_file():
        return _video(Path(path))
    files = _picture_files(path)
    if Path(path).is_dir():
        if files and (others := sorted({file.suffix for file in _shown(Path(path).iterdir()) if file not in files})):
            print(f"{path}: left out: files that end with {', '.join(others)}", file=sys.stderr)
        return _pictures(files, f"the folder {path} holds no picture ({', '.join(PICTURES)})")
    if glob.has_magic(str(path)):
        return _pictures(files, f"nothing matches the pattern {path}")
    raise SourceError(f"there is no {path}; allowed: a folder, a pattern, a video, or {CAMERA}0")


def image_count(path: str | Path) -> int | None:
    """How many images the source ``path`` has, or None where that is unknown: a live camera, some videos."""
    if not Path(path).is_file():
        return len(_picture_files(path)) or None
    cv2 = opencv()
    return max(int(cv2.VideoCapture(str(path)).get(cv2.CAP_PROP_FRAME_COUNT)), 0) or None


def _picture_files(path: str | Path) -> list[Path]:
    """The pictures in a folder, or those that match a pattern."""
    if Path(path).is_dir():
        return [file for file in _shown(Path(path).iterdir()) if file.suffix.lower() in PICTURES]
    return _shown(map(Path, glob.glob(str(path))))


def _shown(paths: Iterable[Path]) -> list[Path]:
    """The files among ``paths``, sorted, without the hidden ones."""
    return sorted(path for path in paths if not path.name.startswith(".") and not path.is_dir())


def _timed(images: Iterator[tuple[str, np.ndarray]], rate: float) -> Iterator[Frame]:
    """The images with their times, each grey and of the first one's size."""
    shape = None
    for k, (name, image) in enumerate(images):
        grey = _grey(image, name)
        shape = shape or grey.shape
        if grey.shape != shape:
            now, then = (f"{w} x {h}" for h, w in (grey.shape, shape))
            raise SourceError(f"{name} is of {now} pixels, the first image of {then}")
        yield k / rate, grey


def _grey(image: np.ndarray, name: str) -> np.ndarray:
    """The image (h, w) uint8: of colours the luminance, and of three equal channels exactly their value.

    Raises:
        SourceError: it has no 8 bits.
    """
    if image.dtype != np.uint8:
        raise SourceError(f"{name} has {image.dtype} pixels; 8-bit grey is needed")
    if image.ndim == 2:
        return image
    if (image[:, :, 1:3] == image[:, :, :1]).all():
        return np.ascontiguousarray(image[:, :, 0])
    cv2 = opencv()
    return cv2.cvtColor(np.ascontiguousarray(image[:, :, :3]), cv2.COLOR_BGR2GRAY)


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
    capture, count = cv2.VideoCapture(str(path)), 0
    try:
        if not capture.isOpened():
            why = "it is empty" if path.stat().st_size == 0 else "it is damaged, or its codec is unknown to OpenCV"
            raise SourceError(f"{path} cannot be read as a video: {why}")
        while (frame := capture.read())[0]:
            yield f"image {count} of {path.name}", frame[1]
            count += 1
        if count == 0:
            raise SourceError(f"{path} holds no image that can be read")
        if count < (announced := int(capture.get(cv2.CAP_PROP_FRAME_COUNT))):
            print(f"{path} announces {announced} images and holds {count}: is its end cut off?", file=sys.stderr)
    finally:
        capture.release()


def _live(name: str) -> Iterator[Frame]:
    """The images of a live camera, until it stops."""
    cv2, number = opencv(), name.removeprefix(CAMERA)
    if not number.isdecimal():
        raise SourceError(f"a camera is camera:0, camera:1 and so on, got {name}")
    capture = cv2.VideoCapture(int(number))
    if not capture.isOpened():
        raise SourceError(f"{name} is not there or cannot be opened")
    began = time.monotonic()
    try:
        while (frame := capture.read())[0]:
            image = frame[1]
            yield time.monotonic() - began, image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        raise SourceError(f"{name} has stopped")
    finally:
        capture.release()
