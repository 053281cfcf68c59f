"""The calibration of a real camera: equation 1's parameters in a small JSON file; and checked JSON files."""

import json
import math
import reprlib
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from activeslam_gym.camera import camera_of
from activeslam_gym.config import Scenario, is_number
from activeslam_gym.files import text_of
from activeslam_gym.kernels import Record
from activeslam_gym.vision.settings import FOCAL_PX, LEAST_SIDE


class Calibration(NamedTuple):
    """Equation 1: u = u0 - u_c / sqrt(1 + K_d (u_c^2 + v_c^2)). Pixel (0, 0) is the centre of the first pixel."""

    image_width: int  # [px]
    image_height: int  # [px]
    focal_px: float
    principal_x_px: float
    principal_y_px: float
    distortion: float  # K_d [1/px^2]

    @property
    def scale(self) -> float:
        """Pixels of an image, along a side, to one of the pyramid's level that is searched: a power of two.

        It brings the focal length nearest to FOCAL_PX, so that templates have the same angle in images of every size.
        The longer side keeps LEAST_SIDE pixels where the lens is narrow; a shorter one is enlarged, once.
        """
        side = max(self.image_width, self.image_height)
        halvings = min(max(0, round(math.log2(self.focal_px / FOCAL_PX))), math.floor(math.log2(side / LEAST_SIDE)))
        return 2.0 ** max(-1, halvings)

    def reduced(self, scale: float) -> "Calibration":
        """The same lens in pixels that are ``scale`` times as wide, see `views.reduced`."""
        width, height, focal, x, y, distortion = self
        middle = ((x + 0.5) / scale - 0.5, (y + 0.5) / scale - 0.5)
        return Calibration(int(width / scale), int(height / scale), focal / scale, *middle, distortion * scale**2)

    @property
    def camera(self) -> Record:
        """The lens as a CAMERA, at the size of the images."""
        return camera_of(Scenario(**self._asdict()))

    def scenario(self, **fields: Any) -> Scenario:
        """A scenario with this camera, at the level that is searched; ``fields`` are other fields of `Scenario`."""
        return Scenario(**{**self.reduced(self.scale)._asdict(), **fields})

    def check_image(self, image: np.ndarray) -> None:
        """A ValueError, unless it is a grey image (h, w) uint8 of the calibrated size, which the message states."""
        if image.ndim != 2 or image.dtype != np.uint8:
            raise ValueError(f"an image must be grey, (h, w) uint8, got {image.shape} {image.dtype}")
        (h, w), (width, height) = image.shape, self[:2]
        if (w, h) != (width, height):
            raise ValueError(f"the calibration is of images of {width} x {height} pixels, got {w} x {h}")


def calibration_from(fields: dict[str, Any], where: str = "the calibration") -> Calibration:
    """The calibration with these ``fields``; a ValueError names its origin ``where``, and the field that is wrong."""
    check_names(fields, set(Calibration._fields), where)
    for name, value in fields.items():
        if not is_number(value):
            raise ValueError(f"{where}: {name} must be a finite number, got {reprlib.repr(value)}")
    found = Calibration(**fields)
    try:
        Scenario(**fields)
    except ValueError as error:
        raise ValueError(f"{where}: {str(error).removeprefix('scenario.')}") from None
    radius = math.hypot(
        max(found.principal_x_px, found.image_width - 1 - found.principal_x_px),
        max(found.principal_y_px, found.image_height - 1 - found.principal_y_px),
    )
    if found.distortion * radius**2 >= 1.0:
        bent = f"distortion {found.distortion:g} bends the image's corners beyond infinity"
        raise ValueError(f"{where}: {bent}; with this principal point, less than {radius**-2:.3g} is allowed")
    return found


def unique(pairs: list[tuple[Any, Any]]) -> dict[Any, Any]:
    """The fields of these names and values; a ValueError: a name is there twice."""
    if len(fields := dict(pairs)) < len(pairs):
        names = [name for name, _ in pairs]
        raise ValueError(f"{next(name for k, name in enumerate(names) if name in names[:k])} is there twice")
    return fields


def read_object(path: str | Path) -> dict[str, Any]:
    """The JSON object in a file.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it holds no JSON object, or is too long.
    """
    text = text_of(path)
    try:
        value = json.loads(text, object_pairs_hook=unique)
    except json.JSONDecodeError as error:
        raise ValueError(f"{path} is no JSON: {error}") from None
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    except RecursionError:
        raise ValueError(f"{path} is nested too deeply") from None
    if not isinstance(value, dict):
        raise ValueError(f"{path} must hold a JSON object")
    return value


def check_names(fields: dict[str, Any], names: set[str], where: str) -> None:
    """A ValueError that names its origin ``where``, if ``fields`` has not exactly these ``names``."""
    if missing := sorted(names - set(fields)):
        raise ValueError(f"{where} lacks {', '.join(missing)}")
    if unknown := sorted(set(fields) - names):
        raise ValueError(f"{where} has no field {reprlib.repr(unknown[0])}; its fields are {', '.join(sorted(names))}")
