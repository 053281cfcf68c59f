"""Whether images fit the calibration: bundle adjustment of some of what a track matched, with the lens free.

A wrong lens bends turns. The filter absorbs it in its map, and its residuals barely grow.
"""

import numpy as np

from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.kernels import Record
from activeslam_gym.motion import POSITION, QUATERNION
from activeslam_gym.slam.detection import NEW, REJECTED
from activeslam_gym.vision.bundle import Bundle, Geometry, inverse_depths
from activeslam_gym.vision.first_sight import rays_of

_EVERY, _APART = 3, 0.05  # images of which one may be adjusted, if features have moved by that share of the width
_IMAGES, _FEATURES, _ROUNDS = 8, 30, 30  # of an adjustment; rounds: a lens that is wrong by much needs 20 to 30
_FEWEST, _FEWEST_SEEN, _SIGHTS = 100, 6, 3  # pixels in all; features in an image; images with a feature
_PIXEL_STD = 0.1  # larger residuals count less [px]
_CORRELATED, _LEAST_STD = 3.0, 0.005  # growth of the deviation: residuals of a feature are alike; the least
_SURE = 0.02, 3.0  # the least misfit that is reported, and in deviations


class LensCheck:
    """Estimates focal length and distortion of a ``camera``, a CAMERA, from the features matched in its images.

    The first two adjustments follow one another, each later one begins when there are twice as many images.
    """

    def __init__(self, camera: Record) -> None:
        self._camera, self._images, self._next = camera, 0, 0
        self._window: list[tuple[np.ndarray, ...]] = []  # of each image the camera, ids, pixels and bearings
        self._estimates: list[tuple[np.ndarray, np.ndarray]] = []  # (2,) logarithms of both ratios, deviations
        self.focal: tuple[float, float] | None = None
        """Ratio of the focal length to the calibration's, and its deviation, since they differed for sure."""
        self.distortion: tuple[float, float] | None = None
        """The same of the distances to the image's corners from its centre, apart from the focal length."""

    def add(self, camera: np.ndarray, candidates: np.ndarray) -> None:
        """Go on to an image with these ``candidates`` (M,) DETECTION, and the filter's mean of the ``camera`` (13,)."""
        self._images += 1
        if self._images < self._next or self._images % _EVERY:
            return
        own = candidates[(candidates["match"] != NEW) & (candidates["match"] != REJECTED)]
        ids, pixels = own["match"], own["pixel"]
        if len(ids) < _FEWEST_SEEN:
            return
        if self._window:
            _, i, j = np.intersect1d(self._window[-1][1], ids, return_indices=True)
            moved = np.linalg.norm(self._window[-1][2][i] - pixels[j], axis=1)
            if len(i) >= _FEWEST_SEEN and np.median(moved) < _APART * self._camera.width:
                return
        bearings = np.column_stack((rays_of(self._camera, pixels), np.ones(len(ids))))
        self._window.append((camera, ids, pixels, bearings / np.linalg.norm(bearings, axis=1)[:, None]))
        if len(self._window) == _IMAGES:
            self._adjust()
            self._window, self._next = [], 2 * self._images if len(self._estimates) > 1 else 0

    def _adjust(self) -> None:
        """Estimate the lens from the window; the deviations of the means cover the estimates' scatter."""
        ids, counts = np.unique(np.concatenate([one[1] for one in self._window]), return_counts=True)
        ids = ids[np.argsort(-counts, kind="stable")][: min(_FEATURES, int((counts >= _SIGHTS).sum()))]
        z = np.full((_IMAGES, len(ids), 3), np.nan)
        for row, (_, seen_ids, _, bearings) in enumerate(self._window):
            _, i, j = np.intersect1d(ids, seen_ids, return_indices=True)
            z[row, i] = bearings[j]
        seen, n = np.isfinite(z[..., 0]), np.arange(len(ids))
        if seen.sum() < _FEWEST or seen.sum(axis=1).min() < _FEWEST_SEEN:
            return
        cameras = np.array([one[0] for one in self._window])
        q_WC = cameras[:, QUATERNION]
        p, R_WC = cameras[:, POSITION] - cameras[0, POSITION], np.array([rotation_matrix(q) for q in q_WC])
        first, last = seen.argmax(axis=0), _IMAGES - 1 - seen[::-1].argmax(axis=0)
        a, b = ((R_WC[k] @ z[k, n, :, None])[..., 0] for k in (first, last))
        rho = inverse_depths(a, b, p[last] - p[first])
        points = p[first] + a / np.clip(rho, *np.abs(np.median(rho)) * np.array((0.1, 10.0)))[:, None]
        distances = np.linalg.norm(points, axis=1)
        start = Geometry(R_WC, p, points / distances[:, None], 1.0 / distances, np.zeros(2))
        lens = self._camera
        corner = np.hypot(lens.width, lens.height) / (2.0 * lens.focal)
        bends = np.where(seen, (z[..., :2] ** 2).sum(axis=-1) / (corner * z[..., 2]) ** 2, 0.0)  # of equation 1, nearly
        stretches = np.stack((np.ones(seen.shape), bends), axis=-1)
        bundle = Bundle(z, np.full(seen.shape, _PIXEL_STD / lens.focal), stretches)
        try:
            x, _ = bundle.fit(start, _ROUNDS)
            P = bundle.lens_covariance(x)
        except np.linalg.LinAlgError:
            return
        shared = np.array((P[0, 1] / P[1, 1], 0.0))  # the focal length, as if the distortion were right
        std = _CORRELATED * np.sqrt(P.diagonal() - shared * P[0, 1])
        self._estimates.append((x.lens - shared * x.lens[1], np.hypot(std, _LEAST_STD)))
        logs, stds = np.swapaxes(self._estimates, 0, 1)
        mean, weight = np.average(logs, weights=stds**-2, axis=0), stds**-2
        scatter = (weight * (logs - mean) ** 2).sum(axis=0) / max(len(logs) - 1, 1)
        std = np.sqrt(np.maximum(1.0, scatter) / weight.sum(axis=0))
        sure = (len(logs) > 1) & (np.abs(mean) > np.maximum(_SURE[0], _SURE[1] * std))
        self.focal, self.distortion = (
            (float(ratio), float(deviation)) if certain else before
            for ratio, deviation, certain, before in zip(np.exp(mean), std, sure, (self.focal, self.distortion))
        )
