"""Lenses of other programs, in the images of which equation 1 holds after a map.

Two models are known, each as OpenCV has it: the radial-tangential lens of 4, 5, 8, 12 or 14 coefficients, and the
fisheye (Kannala and Brandt 2006) of 4. What is filtered is equation 1, so that is fitted to the lens, and each image is
mapped from the one to the other. The residual of the fit is therefore no error of the pixels; it is how far they move.
"""

import math
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from activeslam_gym.files import text_of
from activeslam_gym.vision.calibration import Calibration, calibration_from, read_object
from activeslam_gym.vision.lens_files import Lens, read_lens
from activeslam_gym.vision.opencv import opencv
from activeslam_gym.vision.sources import Frame

_ANGLES, _AROUND = np.linspace(0.005, 1.4, 280), 48
"""Rays that are compared: their angles from the axis [rad], and how many there are about it."""
_LEAST = 400  # of them must be in the image
_WIDER = np.append(_ANGLES, np.linspace(1.405, 1.52, 24))  # angles at which a lens is searched for folds [rad]
_NARROW = 6.0  # focal length, in the image's longer side, over which the angles that are compared are smaller
_SQUARE = 0.05  # pixels that are longer by this share are not square
_BENT = 0.9  # greatest K_d r^2 of the picture's corners, where 1 is a right angle from the axis
_WORST = 0.02, 0.1  # a fit with a residual over this share of the image's width is refused; the same of a wide lens
_BINARY = {
    ".npz": ": write its arrays as camera_matrix and distortion_coefficients by cv2.FileStorage",
    ".bin": ": COLMAP's model_converter writes cameras.txt from it",
}
"""Advice on files that are no texts."""


class Straighten:
    """Maps images of a lens to those of equation 1; this one is of a lens that has equation 1."""

    def __call__(self, frame: Frame) -> Frame:
        """The ``frame`` through the lens of equation 1, at the same time."""
        return frame

    def pixels(self, pixels: np.ndarray) -> np.ndarray:
        """(n, 2) the ``pixels`` (n, 2) of an image of the lens, in that of equation 1 [px]."""
        return pixels


def _on_grid(lens: Lens, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rays (n, m, 2) at ``angles`` (n,) from the axis [rad], their pixels (n, m, 2), and whether these move outwards up
    to there (n, m): the lens can fold."""
    angle, around = np.meshgrid(angles, np.linspace(0.0, 2.0 * np.pi, _AROUND, endpoint=False), indexing="ij")
    rays = np.tan(angle)[..., None] * np.stack((np.cos(around), np.sin(around)), axis=-1)
    pixels = projected_by(lens, rays)
    radius = np.linalg.norm(pixels - lens.matrix[:2, 2], axis=-1)
    return rays, pixels, np.logical_and.accumulate(np.diff(radius, axis=0, prepend=0.0) > 0.0, axis=0)


def fitted(lens: Lens, where: str) -> tuple[Calibration, float, float]:
    """The calibration nearest to the ``lens``, and the residual over the image: root mean square and greatest [px].

    Raises:
        ValueError: none is near it; the message names its origin ``where``.
        ModuleNotFoundError: OpenCV is not installed.
    """
    (width, height), centre, (fx, fy) = lens.size, lens.matrix[:2, 2], lens.matrix.diagonal()[:2]
    rays, pixels, unfolded = _on_grid(lens, _ANGLES * min(1.0, _NARROW * max(lens.size) / min(fx, fy)))
    seen = unfolded & (np.abs(pixels - 0.5 * np.array((width - 1, height - 1))) <= 0.5 * np.array(lens.size)).all(-1)
    if seen.sum() < _LEAST:
        raise ValueError(f"{where}: no lens that shows a picture has such numbers")
    x, z, radius = rays[seen], pixels[seen], np.linalg.norm(pixels[seen] - centre, axis=-1)
    weight = np.sqrt(radius / radius.mean())  # alike for each pixel

    def residual(p: Sequence[float] | np.ndarray) -> np.ndarray:
        bent = 1.0 + p[3] * (x**2).sum(axis=1)  # K_d f^2, which has no unit
        return (weight[:, None] * (p[1:3] + p[0] * x / np.sqrt(np.maximum(bent, 1e-6))[:, None] - z)).ravel()

    first = np.array((0.5 * (fx + fy), *centre, 0.0))
    found = least_squares(residual, first, x_scale=(100.0, 10.0, 10.0, 0.1))
    most = _BENT / float((np.maximum(centre, (width - 1, height - 1) - centre) ** 2).sum())
    wide = bool(found.x[3] > most * found.x[0] ** 2)
    if wide:
        found = least_squares(lambda p: residual((*p, most * p[0] ** 2)), first[:3], x_scale=(100.0, 10.0, 10.0))
        found.x = np.append(found.x, most * found.x[0] ** 2)
    f, u0, v0, bend = found.x.tolist()
    fields = dict(zip(Calibration._fields, (width, height, f, u0, v0, bend / f**2)))
    weighed = np.hypot(*found.fun.reshape(-1, 2).T)
    typical, greatest = float(np.sqrt(np.mean(weighed**2))), float(np.max(weighed / weight))
    if typical > _WORST[wide] * width:
        if abs(fx / fy - 1.0) < _SQUARE:
            raise ValueError(
                f"{where}: this is no lens that shows a picture, equation 1 is off by {typical:.1f} px (rms)"
            )
        square = np.diag((1.0, fx / fy, 1.0)) @ lens.matrix  # whose pixels are not square is judged as if they were
        fitted(lens._replace(size=(width, round(height * fx / fy)), matrix=square), where)
    return calibration_from(fields, where), typical, greatest


def projected_by(lens: Lens, rays: np.ndarray) -> np.ndarray:
    """Pixels (..., 2) of points at ``rays`` (..., 2) before the camera, x right and y down, at depth 1."""
    there = np.concatenate((rays, np.ones((*rays.shape[:-1], 1))), axis=-1).reshape(-1, 1, 3)
    project = opencv().fisheye.projectPoints if lens.fisheye else opencv().projectPoints
    bent = project(there, np.zeros(3), np.zeros(3), np.eye(3), lens.coefficients)[0].reshape(rays.shape)
    return bent @ lens.matrix[:2, :2].T + lens.matrix[:2, 2]  # OpenCV's own product leaves out the skew


class Remap(Straighten):
    """Maps images of another ``lens`` to those of equation 1 with ``calibration``; black where there are none."""

    def __init__(self, lens: Lens, calibration: Calibration) -> None:
        rays = _rays(calibration)
        pixels, last = projected_by(lens, rays), np.array(lens.size) - 1.0
        inside = (np.abs(pixels - 0.5 * last) <= 0.5 * (last + 1.0)).all(-1) & (np.hypot(*rays.T).T <= _reach(lens))
        pixels = np.where(inside[..., None], np.clip(pixels, 0.0, last), -9.0)  # no edge is mixed with the black
        self._calibration, self._pixels = calibration, pixels.astype(np.float32)
        self._tables = opencv().convertMaps(self._pixels, None, opencv().CV_16SC2)

    def __call__(self, frame: Frame) -> Frame:
        self._calibration.check_image(frame[1])
        return frame[0], opencv().remap(frame[1], *self._tables, opencv().INTER_LINEAR)

    def pixels(self, pixels: np.ndarray) -> np.ndarray:
        """By the nearest pixel of the table: both images have nearly the same scale."""
        out = np.empty(pixels.shape)
        for k, pixel in enumerate(pixels):
            nearest = ((self._pixels - pixel) ** 2).sum(axis=-1).argmin()
            v, u = np.unravel_index(nearest, self._pixels.shape[:2])
            out[k] = (u, v) + pixel - self._pixels[v, u]
        return out


def _rays(calibration: Calibration) -> np.ndarray:
    """(H, W, 2) where the pixels' rays meet the plane at depth 1, x right and y down."""
    width, height, f, u0, v0, distortion = calibration
    bent = np.stack(np.meshgrid(np.arange(width) - u0, np.arange(height) - v0), axis=-1)
    return bent / (f * np.sqrt(1.0 - distortion * (bent**2).sum(axis=-1, keepdims=True)))


def _reach(lens: Lens) -> float:
    """The tangent of the angle from the axis at which the lens folds; infinite where it does not."""
    unfolded = _on_grid(lens, _WIDER)[2].all(axis=1)
    return math.inf if unfolded.all() else math.tan(_WIDER[max(int(unfolded.argmin()) - 1, 0)])


def lens_from(path: str | Path, camera: str | None = None) -> tuple[Calibration, Straighten]:
    """The calibration in a file: ours (a `Calibration` in JSON), or the nearest to another program's; and
    what maps images to it. Of several cameras it is the one that `read_lens` reads.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it is damaged, or no lens has its numbers, or it holds no such ``camera``.
        ModuleNotFoundError: it is another program's, and OpenCV is not installed.
    """
    suffix = Path(path).suffix.lower()
    try:
        is_json = suffix == ".json" or text_of(path).lstrip().startswith("{")
    except ValueError as error:
        raise ValueError(f"{error}{_BINARY.get(suffix, '')}") from None
    if is_json and "focal_px" in (fields := read_object(path)):
        if camera not in (None, "0"):
            raise ValueError(f"{path}: --camera {camera} is not there; it holds 0")
        return calibration_from(fields, str(path)), Straighten()
    lens = read_lens(path, camera)
    calibration, typical, greatest = fitted(lens, str(path))
    kind, reach = "fisheye" if lens.fisheye else "radial-tangential", _reach(lens)
    moved = f"is mapped from its {kind} lens to equation 1, by {typical:.2f} px (rms), {greatest:.2f} at most"
    if np.hypot(*_rays(calibration).T).max() > reach:
        moved += f", and black beyond {math.degrees(math.atan(reach)):.0f} degrees, where its numbers fold"
    print(f"{path}: {lens.note}each image {moved}", file=sys.stderr, flush=True)
    return calibration, Remap(lens, calibration)
