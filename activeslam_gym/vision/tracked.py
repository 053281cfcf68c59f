"""Corners tracked through images (Lucas and Kanade, forwards and backwards), and the turn that explains the most."""

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from activeslam_gym.camera import ray_from_pixel
from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.vision.calibration import Calibration
from activeslam_gym.vision.corners import new_corners
from activeslam_gym.vision.opencv import opencv
from activeslam_gym.vision.settings import FrontEndSettings
from activeslam_gym.vision.target import FACING
from activeslam_gym.vision.templates import TEMPLATE_SIDE
from activeslam_gym.vision.views import reduced, row_times

TRACKS, FEWEST = 60, 12  # corners that are tracked, and with how few the camera is lost
_JOINED = 0.7  # share of the corners that joins two images: right starts keep 0.78, and 276 cuts left at most 0.68
PIXEL_STD = 0.5  # of a tracked corner [px]
_CLOSED = 0.5  # a corner that is tracked back must be so near to where it was [px]
_WINDOW = 21, 21  # of the tracking, in each level
_LEVELS = 4, 1  # above the image; those that are lost then, fewer, since a fine pattern has none in small images
_MOVED = 1.5  # deviations by which a corner has moved as no turn moves it
_REST = 0.3, 0.25  # corners that moved less [px], and the part of the image with them at which the camera is at rest
_IMAGES, _MORE = 8, 4  # in a bundle adjustment, and where few corners are in all of them
_PARALLAX = 0.6  # part of the image where corners must have moved so
MOST_TURNED = 1.0  # of the camera, at most, between the images of a bundle adjustment [rad]
_TRIALS = 100  # turns by two corners, of which the best is taken
_PARTS = 5  # of the image, along each side
_MISSING = 0.3  # share of the corners, from which new ones are sought
_ROUND = 0.1  # ratio of a corner's two strengths, at least: on an edge it would slide
VELOCITY_IMAGES = 3  # over which the velocity is taken
SHARED = 0.6  # of the corners of the last image, in the other one of a pair


class Seen(NamedTuple):
    """One image, and what it shows of the corners."""

    time: float  # [s]
    number: np.ndarray  # (m,) of the corners
    bearing: np.ndarray  # (m, 3) in the camera's axes
    std: np.ndarray  # (m,) [rad]
    R_WC: np.ndarray  # (3, 3) if the camera only turned
    way: float  # median way of the corners from the first image on, image by image [px]
    turned: bool  # whether the camera had only turned so far, since too few corners were seen


class Corners:
    """Corners tracked through images, with the turn of the camera that explains the most of them."""

    def __init__(self, calibration: Calibration, readout: float = 0.0) -> None:
        self.level = max(0.5 * calibration.scale, 1.0)
        """Pixels of an image, along a side, to one of the level of its pyramid in which corners are tracked."""
        self._camera = calibration.reduced(self.level).camera
        self._radius = TEMPLATE_SIDE * max(calibration.scale / self.level, 1.0)
        self._image, self._readout = np.zeros((0, 0), np.uint8), readout
        self._velocity = np.zeros(2)  # median of the corners' [px/s]
        self._delay = np.zeros((0, 2))  # how far corners have moved since the middle row was read
        self._first, self._d = np.zeros((0, 2)), np.zeros((0, 3))  # pixels and directions at first sight
        self._born, self._moved = np.zeros(0, np.int64), np.zeros(0, bool)
        self.pixels = np.zeros((0, 2))
        """(N, 2) of all corners in the last image, at that level; NaN of those that are lost."""
        self.seen: list[Seen] = []
        self.initialised = 0
        """Corners that are new in the last image."""
        self.since = 0
        """Number of the first image since the images before could not be joined to it."""

    @property
    def live(self) -> np.ndarray:
        """(N,) which are seen in the last image."""
        return np.isfinite(self.pixels[:, 0])

    def add(self, time: float, image: np.ndarray, joined: bool = True) -> bool:
        """Go on to the ``image`` (h, w) uint8 of ``time`` [s]; whether it shows enough corners of the one before to be
        ``joined`` to it, if it may be."""
        before, image, last = self.pixels, reduced(image, self.level), self.seen[-1] if self.seen else None
        fewest, R = max(FEWEST, _JOINED * self.live.sum()), last.R_WC if last else rotation_matrix(FACING)
        if last:
            self.pixels = self._tracked(self._image, image)
            velocity, height = (self.pixels - before) / (time - last.time), image.shape[0]
            self._delay = row_times(self.pixels, height, self._readout) * velocity
            if self._readout and len(self.seen) == 1:  # now that the first velocities are known
                bearing, std = self._rays(before - row_times(before, height, self._readout) * np.nan_to_num(velocity))
                self._d, self.seen[0] = bearing @ R.T, last._replace(bearing=bearing, std=std)
            self._velocity = np.median(velocity[self.live], axis=0) if self.live.any() else np.zeros(2)
        self._image, enough = image, joined and bool(self.live.sum() >= fewest)
        way = last.way if last else 0.0
        if enough:
            live = self.live
            R, residual = _turn(R, self._d[live], *self._rays((self.pixels - self._delay)[live]), self._parts(live))
            self._moved[live] = residual > _MOVED
            way += float(np.median(np.linalg.norm((self.pixels - before)[live], axis=1)))
        else:
            self.pixels, self.since = np.full(self.pixels.shape, np.nan), len(self.seen)
        self._grow(image, R)
        here = np.flatnonzero(self.live)
        turned = last is None or not enough or (last.turned and not self.show_parallax())
        self.seen.append(Seen(time, here, *self._rays((self.pixels - self._delay)[here]), R, way, turned))
        return enough or (last is None and self.initialised >= FEWEST)

    def _grow(self, image: np.ndarray, R: np.ndarray) -> None:
        """New corners, where many are missing."""
        count, self.initialised = TRACKS - int(self.live.sum()), 0
        if count < _MISSING * TRACKS:
            return
        border = int(self._radius / 2) + 2
        new = new_corners(image, self.pixels[self.live], count, self._radius, border, FrontEndSettings().least_corner)
        both = opencv().cornerEigenValsAndVecs(image, 7, 3)[..., :2]
        both = both[tuple(new.T[::-1].astype(int))] if len(new) else np.zeros((0, 2))
        new = new[both.min(axis=1) > _ROUND * both.max(axis=1)]
        self.pixels, self._first = np.vstack((self.pixels, new)), np.vstack((self._first, new))
        self.initialised = len(new)
        delay = row_times(new, image.shape[0], self._readout) * self._velocity
        self._delay = np.vstack((self._delay, delay))
        self._d = np.vstack((self._d, self._rays(new - delay)[0] @ R.T))
        self._born = np.append(self._born, np.full(len(new), len(self.seen)))
        self._moved = np.append(self._moved, np.zeros(len(new), bool))

    def _tracked(self, before: np.ndarray, image: np.ndarray) -> np.ndarray:
        """The pixels in ``image`` of the corners in the image ``before``."""
        cv2, (h, w), out = opencv(), image.shape, np.full(self.pixels.shape, np.nan)
        for levels in _LEVELS:
            here = np.flatnonzero(self.live & np.isnan(out[:, 0]))
            if not len(here):
                break
            start = self.pixels[here].astype(np.float32).reshape(-1, 1, 2)
            there, found, _ = cv2.calcOpticalFlowPyrLK(before, image, start, None, winSize=_WINDOW, maxLevel=levels)
            back, again, _ = cv2.calcOpticalFlowPyrLK(image, before, there, None, winSize=_WINDOW, maxLevel=levels)
            pixel = there.reshape(-1, 2).astype(float)
            inside = ((pixel > 4.0) & (pixel < (w - 5.0, h - 5.0))).all(axis=1)
            good = inside & (found & again).ravel().astype(bool) & (np.abs(back - start).max(axis=(1, 2)) < _CLOSED)
            out[here[good]] = pixel[good]
        return out

    def _rays(self, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(n, 3) bearings and (n,) their deviations: the root of the solid angle of a pixel, times `PIXEL_STD`."""
        out = np.empty((3, len(pixels), 3))
        for k, pixel in enumerate(pixels):
            for i, step in enumerate(((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))):
                out[i, k] = ray_from_pixel(self._camera, pixel + step)
        out /= np.linalg.norm(out, axis=-1, keepdims=True)
        area = np.linalg.norm(np.cross(out[1] - out[0], out[2] - out[0]), axis=-1)
        return out[0], PIXEL_STD * np.sqrt(area)

    def apart(self, numbers: np.ndarray, most: int) -> np.ndarray:
        """The places in ``numbers`` (n,) of at most so many corners that the last image shows well inside and apart."""
        (h, w), margin, chosen = self._image.shape, 0.75 * self._radius, list[int]()
        for k in np.flatnonzero(self.live[numbers]):
            pixel, taken = self.pixels[numbers[k]], self.pixels[numbers[chosen]]
            inside = ((pixel >= margin) & (pixel < (w - margin, h - margin))).all()
            if inside and np.abs(taken - pixel).max(axis=1).min(initial=np.inf) >= self._radius:
                chosen.append(int(k))
        return np.array(chosen[:most], np.int64)

    def show_parallax(self) -> bool:
        """Whether the camera has moved, and not something before it: where corners are seen for longest, they have
        moved otherwise than by a turn in most parts of the image, and in few they are where they were."""
        live = np.flatnonzero(self.live)
        old = live[self._born[live] <= np.median(self._born[live])]
        part = self._parts(old)
        rest = np.linalg.norm(self.pixels[old] - self._first[old], axis=1) < _REST[0]
        return bool(part[self._moved[old]].sum() >= _PARALLAX and part[rest].sum() < _REST[1])

    def _parts(self, corners: np.ndarray) -> np.ndarray:
        """The part of the image that each of the ``corners`` stands for, of those with corners: a cell's, shared."""
        cell = np.floor(_PARTS * self.pixels[corners] / self._image.shape[::-1]).astype(int) @ (1, _PARTS)
        part = 1.0 / np.bincount(cell)[cell]
        return part / part.sum()

    def observed(self, images: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(N,) the corners that two of the ``images`` (K,) show, or more, their bearings (K, N, 3) and stds (K, N)."""
        z, std = np.full((len(images), len(self.pixels), 3), np.nan), np.full((len(images), len(self.pixels)), np.nan)
        for row, k in enumerate(images):
            numbers, z_k, std_k = self.seen[k][1:4]
            z[row, numbers], std[row, numbers] = z_k, std_k
        use = np.flatnonzero(np.isfinite(z[..., 0]).sum(axis=0) >= 2)
        return use, z[:, use], std[:, use]

    def chosen(self) -> np.ndarray:
        """(K,) images for a bundle adjustment, evenly spaced by the way of the corners; the last is the present one."""
        last = len(self.seen) - 1
        angles = [np.trace(one.R_WC.T @ self.seen[-1].R_WC) for one in self.seen[self.since :]]
        far = np.flatnonzero(np.array(angles) < 1.0 + 2.0 * np.cos(MOST_TURNED))
        first = self.since + (int(far[-1]) + 1 if len(far) else 0)
        shared = np.intersect1d(self.seen[first].number, self.seen[-1].number)
        count = _IMAGES + (0 if len(shared) >= SHARED * self.live.sum() else _MORE)
        way = np.array([one.way for one in self.seen[first:]]) + 1e-3 * np.arange(last - first + 1)
        spaced = first + np.searchsorted(way, np.linspace(way[0], way[-1], count))
        return np.unique([first, *np.minimum(spaced, last), max(first, last - VELOCITY_IMAGES), last])


def _turn(
    R: np.ndarray, d: np.ndarray, z: np.ndarray, std: np.ndarray, part: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """R_WC (3, 3) near ``R`` that turns the bearings ``z`` (n, 3) to the directions ``d`` (n, 3), and the residuals
    (n,) over the ``std`` (n,); or one far from it that fits enough of the image, of which each is a ``part`` (n,)."""
    near = _refined(R, d, z, std)
    if part[near[1] < _MOVED].sum() > 1.0 - _PARALLAX:
        return near
    one, other = np.random.default_rng(0).integers(0, len(d), (2, _TRIALS))
    tried = np.swapaxes(_triads(z[one], z[other]), -1, -2)
    tried = _triads(d[one], d[other]) @ tried
    fit = np.linalg.norm(d - z @ np.swapaxes(tried, -1, -2), axis=-1) < _MOVED * std
    best = int((fit @ part).argmax())
    if fit[best] @ part <= 1.0 - _PARALLAX:
        return near
    return _refined(tried[best], d, z, std)


def _refined(R: np.ndarray, d: np.ndarray, z: np.ndarray, std: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A rotation and its residuals, as `_turn`, by least squares with weights that leave outliers out."""
    residual = np.linalg.norm(d - z @ R.T, axis=1) / std
    for _ in range(8):
        weight = 1.0 / (1.0 + (residual / max(_MOVED, float(np.median(residual)))) ** 2) ** 2
        R = Rotation.align_vectors(d, z, weights=weight)[0].as_matrix()
        residual = np.linalg.norm(d - z @ R.T, axis=1) / std
    return R, residual


def _triads(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(..., 3, 3) orthonormal columns: ``a`` (..., 3), across ``a`` and ``b``, and across both."""
    across = np.cross(a, b)
    across /= np.maximum(np.linalg.norm(across, axis=-1, keepdims=True), 1e-12)
    return np.stack((a, across, np.cross(a, across)), axis=-1)
