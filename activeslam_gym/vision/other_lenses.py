"""Calibrations of other programs: OpenCV, ROS, Kalibr and COLMAP.

OpenCV's radial-tangential lens has 4, 5 or 8 coefficients, and its fisheye (Kannala and Brandt 2006) 4. What is
filtered is equation 1, so that is fitted to the lens, and each image is mapped from the one to the other. The residual
of the fit is therefore no error of the pixels; it is how far they are moved.
"""

import re
import reprlib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import least_squares

from activeslam_gym.files import text_of
from activeslam_gym.vision.calibration import Calibration, calibration_from, read_calibration
from activeslam_gym.vision.opencv import opencv
from activeslam_gym.vision.sources import Frame

RADIAL = ("pinhole", "radtan", "radial_tangential", "plumb_bob", "rational_polynomial", "brown", "opencv", "0")
FISHEYE = ("fisheye", "equidistant", "kannala_brandt", "kannala_brandt4", "opencv_fisheye", "1")
"""Words for the two models in YAML."""
_MODEL_FIELDS = ("camera_model", "distortion_model", "fisheye_model", "model_type", "model")
_MATRICES = ("camera_matrix", "Camera_Matrix", "K")
COLMAP = {
    "SIMPLE_PINHOLE": "f cx cy", "PINHOLE": "fx fy cx cy", "SIMPLE_RADIAL": "f cx cy k1", "RADIAL": "f cx cy k1 k2",
    "OPENCV": "fx fy cx cy k1 k2 p1 p2", "OPENCV_FISHEYE": "fx fy cx cy k1 k2 k3 k4",
    "FULL_OPENCV": "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6",
}  # fmt: skip
"""COLMAP's models and their parameters."""
_ANGLES, _AROUND = np.linspace(0.005, 1.4, 280), 48
"""Rays that are compared: their angles from the axis [rad], and how many there are about it."""
_LEAST = 400  # of them must be in the image
_WORST = 0.02  # a fit with a residual over this share of the image's width is refused
Straighten = Callable[[Frame], Frame]  # maps an image of a lens to that of equation 1, at the same time


class Lens(NamedTuple):
    """A lens of OpenCV's; pixel (0, 0) is the centre of the first pixel."""

    size: tuple[int, int]  # width and height [px]
    fisheye: bool
    matrix: np.ndarray  # (3, 3)
    coefficients: np.ndarray  # (4,), (5,) or (8,); of a fisheye (4,)


def fitted(lens: Lens, where: str) -> tuple[Calibration, float, float]:
    """The calibration nearest to the ``lens``, and the residual over the image: root mean square and greatest [px].

    Raises:
        ValueError: none is near it; the message names its origin ``where``.
        ModuleNotFoundError: OpenCV is not installed.
    """
    (width, height), centre = lens.size, lens.matrix[:2, 2]
    angle, around = np.meshgrid(_ANGLES, np.linspace(0.0, 2.0 * np.pi, _AROUND, endpoint=False), indexing="ij")
    rays = np.tan(angle)[..., None] * np.stack((np.cos(around), np.sin(around)), axis=-1)
    pixels = _projected(lens, rays)
    radius = np.linalg.norm(pixels - centre, axis=-1)
    unfolded = np.logical_and.accumulate(np.diff(radius, axis=0, prepend=0.0) > 0.0, axis=0)
    seen = unfolded & (np.abs(pixels - 0.5 * np.array((width - 1, height - 1))) <= 0.5 * np.array(lens.size)).all(-1)
    if seen.sum() < _LEAST:
        raise ValueError(f"{where}: no lens that shows a picture has such numbers")
    x, z, weight = rays[seen], pixels[seen], np.sqrt(radius[seen] / radius[seen].mean())  # alike for each pixel

    def residual(p: np.ndarray) -> np.ndarray:
        bent = 1.0 + p[3] * (x**2).sum(axis=1)  # K_d f^2, which has no unit
        return (weight[:, None] * (p[1:3] + p[0] * x / np.sqrt(np.maximum(bent, 1e-6))[:, None] - z)).ravel()

    first = np.array((0.5 * (lens.matrix[0, 0] + lens.matrix[1, 1]), *centre, 0.0))
    found = least_squares(residual, first, x_scale=(100.0, 10.0, 10.0, 0.1))
    f, u0, v0, bend = found.x.tolist()
    fields = dict(zip(Calibration._fields, (width, height, f, u0, v0, bend / f**2)))
    weighed = np.hypot(*found.fun.reshape(-1, 2).T)
    typical, greatest = float(np.sqrt(np.mean(weighed**2))), float(np.max(weighed / weight))
    if typical > _WORST * width:
        raise ValueError(f"{where}: this is no lens that shows a picture, equation 1 is off by {typical:.1f} px (rms)")
    return calibration_from(fields, where), typical, greatest


def _projected(lens: Lens, rays: np.ndarray) -> np.ndarray:
    """Pixels (..., 2) of points at ``rays`` (..., 2) before the camera, x right and y down, at depth 1."""
    there = np.concatenate((rays, np.ones((*rays.shape[:-1], 1))), axis=-1).reshape(-1, 1, 3)
    project = opencv().fisheye.projectPoints if lens.fisheye else opencv().projectPoints
    return project(there, np.zeros(3), np.zeros(3), lens.matrix, lens.coefficients)[0].reshape(rays.shape)


def straightening(lens: Lens, calibration: Calibration) -> Straighten:
    """What maps images of the ``lens`` to those of equation 1 with ``calibration``; black where there are none."""
    width, height, f, u0, v0, distortion = calibration
    bent = np.stack(np.meshgrid(np.arange(width) - u0, np.arange(height) - v0), axis=-1)
    rays = bent / (f * np.sqrt(1.0 - distortion * (bent**2).sum(axis=-1, keepdims=True)))
    cv2 = opencv()
    tables = cv2.convertMaps(_projected(lens, rays).astype(np.float32), None, cv2.CV_16SC2)

    def straighten(frame: Frame) -> Frame:
        calibration.check_image(frame[1])
        return frame[0], cv2.remap(frame[1], *tables, cv2.INTER_LINEAR)

    return straighten


def lens_from(path: str | Path) -> tuple[Calibration, Straighten]:
    """The calibration in a file: ours in JSON (see `read_calibration`), or the nearest to another program's, with what
    maps its images to it.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it is damaged, or no lens has its numbers.
        ModuleNotFoundError: it is another program's, and OpenCV is not installed.
    """
    if Path(path).suffix.lower() == ".json":
        return read_calibration(path), lambda frame: frame
    lens = read_lens(path)
    calibration, typical, greatest = fitted(lens, str(path))
    kind = "fisheye" if lens.fisheye else "radial-tangential"
    moved = (
        f"each image is mapped from its {kind} lens to equation 1, by {typical:.2f} px (rms), {greatest:.2f} at most"
    )
    print(f"{path}: {moved}", file=sys.stderr, flush=True)
    return calibration, straightening(lens, calibration)


def read_lens(path: str | Path) -> Lens:
    """The lens in OpenCV's or ROS's YAML, Kalibr's YAML (its first camera) or COLMAP's cameras.txt (its first).

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: nothing that is known is in it, or a number is missing.
    """
    text = text_of(path)
    rows = (line.split() for line in text.splitlines())
    first = next((row for row in rows if row and not row[0].startswith("#")), [])
    try:
        return _of_colmap(first) if len(first) > 3 and first[0].isdigit() else _of_yaml(text)
    except (ValueError, IndexError, TypeError, OverflowError) as error:
        raise ValueError(f"{path} holds no lens of OpenCV, ROS, Kalibr or COLMAP: {error}") from None


def _of_colmap(row: list[str]) -> Lens:
    """A line of cameras.txt: id, model, width, height, parameters; its first pixel's centre is (0.5, 0.5)."""
    if row[1] not in COLMAP:
        raise ValueError(f"COLMAP's model {reprlib.repr(row[1])} is not known; known are {', '.join(COLMAP)}")
    names = COLMAP[row[1]].split()
    if len(row) != 4 + len(names):
        raise ValueError(f"{row[1]} has {len(names)} parameters ({', '.join(names)}), got {len(row) - 4}")
    values = dict(zip(names, map(float, row[4:])))
    fx, fy = values.get("fx", values.get("f", 0.0)), values.get("fy", values.get("f", 0.0))
    fisheye = row[1] == "OPENCV_FISHEYE"
    order = ("k1", "k2", "k3", "k4") if fisheye else ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
    return _checked(
        row[2:4], fisheye, (fx, fy, values["cx"] - 0.5, values["cy"] - 0.5), [values.get(k, 0.0) for k in order]
    )


def _of_yaml(text: str) -> Lens:
    """The numbers after the names that these programs use, of the first camera."""
    camera = _first_camera(text)
    words = [str(camera[name]).lower().replace("-", "_") for name in _MODEL_FIELDS if name in camera]
    words += ["xi"] if "xi" in camera else []  # OpenCV's omnidirectional lens has no word, but this number
    if unknown := [word for word in words if word not in RADIAL + FISHEYE]:
        raise ValueError(f"the model {reprlib.repr(unknown[0])} is not known; known are {', '.join(RADIAL + FISHEYE)}")
    fisheye = any(word in FISHEYE for word in words)
    if "intrinsics" in camera:  # Kalibr
        resolution, intrinsics = _list(camera, "resolution"), _list(camera, "intrinsics")
        return _checked(resolution, fisheye, intrinsics, _list(camera, "distortion_coeffs"))
    K = _list(camera, *_MATRICES)
    if len(K) != 9:
        raise ValueError(f"camera_matrix needs 9 numbers, got {len(K)}")
    if abs(K[1]) > 1e-3 or (K[3], *K[6:]) != (0.0, 0.0, 0.0, 1.0):
        raise ValueError(f"camera_matrix must be fx 0 cx, 0 fy cy, 0 0 1, without skew, got {K}")
    size = [_list(camera, f"image_{side}", f"image_{side.title()}")[0] for side in ("width", "height")]
    coefficients = _list(camera, "distortion_coefficients", "Distortion_Coefficients", "D")
    return _checked(size, fisheye, (K[0], K[4], K[2], K[5]), coefficients)


def _first_camera(text: str) -> dict[str, Any]:
    """The fields of the first camera in YAML, all as text: of `cam0`, of the file, or of the first part with a lens."""
    import yaml

    try:
        whole = yaml.load(re.sub(r"^%.*", "", text), yaml.BaseLoader)
    except (yaml.YAMLError, RecursionError) as error:
        raise ValueError(f"it is no YAML: {' '.join(str(error).split())[:200]}") from None
    fields = whole if isinstance(whole, dict) else {}
    for part in (fields.get("cam0"), fields, *fields.values()):
        if isinstance(part, dict) and not part.keys().isdisjoint(("intrinsics", *_MATRICES)):
            return fields | part  # some name the model, or the size, outside
    raise ValueError("camera_matrix is missing")


def _list(camera: dict[str, Any], *names: str) -> list[float]:
    """The number, or the numbers, of the first of these names, as they are or in its field `data`."""
    found: Any = next((camera[name] for name in names if name in camera), None)
    if found is None:
        raise ValueError(f"{names[0]} is missing")
    return np.ravel(np.array(found.get("data") if isinstance(found, dict) else found, float)).tolist()


def _checked(size: Any, fisheye: bool, intrinsics: Any, coefficients: list[float]) -> Lens:
    """The lens of these numbers; a ValueError where there are not as many as there should be."""
    if len(size) != 2 or len(intrinsics) != 4:
        raise ValueError("it needs two numbers for the size and four for focal lengths and principal point")
    if len(coefficients) not in ((4,) if fisheye else (4, 5, 8)):
        raise ValueError(f"{len(coefficients)} coefficients; known are 4, 5 and 8, and 4 of a fisheye")
    fx, fy, cx, cy = map(float, intrinsics)
    matrix = np.array(((fx, 0.0, cx), (0.0, fy, cy), (0.0, 0.0, 1.0)))
    numbers = np.array((*matrix.ravel(), *coefficients))
    if not np.isfinite(numbers).all() or min(fx, fy) <= 0.0:
        raise ValueError("its numbers must be finite, and its focal lengths positive")
    return Lens((int(float(size[0])), int(float(size[1]))), fisheye, matrix, np.array(coefficients))
