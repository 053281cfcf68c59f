"""The start without a target: which motion of the camera explains the first images, or that there are several.

Corners are tracked through the images (Lucas and Kanade, forwards and backwards) until most of them have moved as no
turn of the camera moves them. Then hypotheses of the motion are refined by bundle adjustment of some of the images: by
the essential matrix, by the homography, by a flat scene that is nearly at rest, and the best one turned inside out
(near becomes far, and a slide becomes a turn the other way: with a narrow lens both look nearly alike). One that is
far more likely than all others, and whose covariance is small, is the start; else more images are waited for.

Where few corners move against many, something moves before a camera that does not: that is no start.
"""

from collections.abc import Iterator
from time import thread_time
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from activeslam_gym.kernels import Record
from activeslam_gym.motion import ANGULAR_VELOCITY, CAMERA_DIM, CAMERA_SIZE, POSITION, QUATERNION, VELOCITY
from activeslam_gym.slam.belief import angles_of
from activeslam_gym.slam.filter import is_covariance
from activeslam_gym.vision.bundle import UNIT, Bundle, Geometry, inverse_depths, tangents
from activeslam_gym.vision.calibration import Calibration
from activeslam_gym.vision.frontend import FrameLog, FrontEnd
from activeslam_gym.vision.opencv import opencv
from activeslam_gym.vision.report import Agreement
from activeslam_gym.vision.settings import RATE, weight_of_image
from activeslam_gym.vision.sources import Frame
from activeslam_gym.vision.tracked import FEWEST, MOST_TURNED, SHARED, VELOCITY_IMAGES, Corners

_LATER = 1.25  # growth of the number of images between two attempts
_FEWEST_IMAGES = 5  # of an adjustment: three can agree by chance on a wrong motion
_FIRST, _ROUNDS = 20, 40  # iterations of each hypothesis, and of those that are near the best
_NEAR = 10.0  # times the least cost
_LEAST = 0.2  # deviation of the residuals that counts at least, as a share of PIXEL_STD
_CLEAR = 10.0  # logarithm of the likelihood ratio of the best and the next hypothesis
_ALIKE = 0.02, 0.2  # two hypotheses are one where their turns [rad] and their ways, as a share, differ by less
_POSE = 5  # points that tell a pose
_KEPT = 0.75  # share of the corners that must fit the start
_LEVEL = 0.2  # cosine of the angle from the axis of a corner for the two-view models
_RANSAC = 2e-3  # their tolerance [rad]
_TURNED = np.diag(np.repeat((0.02, 0.02), 3) ** 2)  # covariance of a pose that is told by turns alone
_LEAST_VARIANCE = 1e-8  # added to all covariances
_SHARP = 0.15, 0.25  # deviation of the way, and of the median inverse depth, as shares of them
_ASTRAY = 3.0  # deviations of its mean residual, from which a corner is left out
_CORRELATED = 9.0  # growth of the covariance: residuals of a corner are alike in neighbouring images
_PACE = 3.0  # acceleration's deviation over the speed [1/s]
_SHARE = 1.0 / 30.0  # of an image in the running mean
_LEAST_STEP = 0.8 / RATE  # between two images in which corners are tracked; poses between are interpolated [s]
_ACCELERATIONS = 0.3, 2.0  # the least and the greatest, in the free unit
KNOWN = np.radians(1.5)  # deviation of the turn since the start, from which the track is uncertain
_NARROW = np.radians(50.0)
"""Field of view under which no start is certain: with 39 degrees, one of two that seemed so was wrong by 3 degrees."""
_HELD = 1e9  # images are told without a start, if they have more [bytes]


class Opening(NamedTuple):
    """What the images up to the last one tell of the cameras and of N points, in the filter's world."""

    images: np.ndarray  # (K,) the numbers of the adjusted images, from 0; the last is the present one
    geometry: Geometry
    covariance: np.ndarray  # of its tangent
    corners: np.ndarray  # (N,) the numbers of the points' corners
    certain: bool  # no other motion explains the images nearly as well, and the covariance is small


def steps_from_anywhere(
    source: Iterator[Frame], calibration: Calibration, front_end: FrontEnd
) -> Iterator[tuple[Frame, FrameLog]]:
    """Track the images of ``source`` without a target by a ``front_end`` that has seen nothing: each image, and what
    was seen in it. The images until the start is certain are buffered, and reported then.

    If the start is never certain, or the images are too many to be held, the logs say so. An exception of the source
    comes in its turn.
    """
    filter, held = front_end.filter, list[tuple[Frame, FrameLog]]()
    search, reported = Start(calibration, front_end.longest_step, front_end.settings.readout), 0
    certain, ending, motion = False, None, filter.models.motion
    wide = not is_narrow(front_end.camera)
    while not certain and ending is None:
        try:
            frame = next(source)
            held.append((frame, search.add(*frame)))
        except (StopIteration, ValueError, KeyboardInterrupt) as error:
            if not reported + len(held):
                raise
            ending = error
        if search.best is not None and search.best.certain:
            certain, room = True, min(filter.capacity, front_end.settings.visible)
            stds = motion.filter_acceleration_std, motion.filter_angular_acceleration_std
            camera, points, covariance, pixels = search.belief(search.best, stds, room)
            ids = filter.resume(camera, points, covariance)
            front_end.start(frame[1], frame[0], ids, (pixels + 0.5) / calibration.scale - 0.5)
        if certain or ending is not None or len(held) * held[0][0][1].nbytes > _HELD:
            belief = filter.snapshot()
            unreported = (column[reported:] for column in search.cameras())
            for (frame, log), camera, P, sure, known in zip(held, *unreported):
                filter.place_camera(camera, np.pad(P, ((0, 6), (0, 6))))
                yield frame, log._replace(start_certain=bool(sure and wide), lost=log.lost or not known)
                reported += 1
            filter.restore(belief)
            held = []
    if ending is None:
        share = _SHARE * weight_of_image(float(motion.dt))
        square, agreement = np.sum(filter.mean[VELOCITY] ** 2), Agreement(False, float(motion.dt))
        for frame in source:
            motion.filter_acceleration_std = np.clip(_PACE * np.sqrt(square), *_ACCELERATIONS)
            log = agreement.judged(front_end.step(frame[1], frame[0]), front_end.strayed)
            square += share * (np.sum(filter.mean[VELOCITY] ** 2) - square)
            known = log.start_certain and np.trace(filter.camera_covariance[3:6, 3:6]) < KNOWN**2
            yield frame, log._replace(start_certain=bool(known and wide))
    elif not isinstance(ending, StopIteration):
        raise ending


def is_narrow(camera: Record) -> bool:
    """Whether a ``camera``, a CAMERA, has a field of view in which no start is certain."""
    return bool(2.0 * np.arctan(0.5 * max(camera.width, camera.height) / camera.focal) < _NARROW)


class Start:
    """Looks for the start, image by image; from the later of two that cannot be joined, or lie farther apart than the
    ``longest_step`` [s]."""

    def __init__(self, calibration: Calibration, longest_step: float = np.inf, readout: float = 0.0) -> None:
        self.corners, self._longest_step = Corners(calibration, readout), longest_step
        self._next, self._certain, self._logs = 0, list[Opening](), list[FrameLog]()
        self.best: Opening | None = None
        """The likeliest so far; the one that is certain is the start."""

    def add(self, time: float, image: np.ndarray) -> FrameLog:
        """Go on to the ``image`` (h, w) uint8 of ``time`` [s]: what was seen in it, or in the one that it follows too
        soon to be tracked."""
        began = thread_time()
        corners, k, before = self.corners, len(self.corners.seen), int(self.corners.live.sum())
        last, latest = (corners.seen[-1].time, self._logs[-1].time) if k else (-np.inf, -np.inf)
        if time <= latest:
            raise ValueError(f"times of images must grow, got {time:g} s after {latest:g} s")
        if time - last < _LEAST_STEP:
            self._logs.append(self._logs[-1]._replace(time=time, initialised=0, deletions=0, milliseconds=0.0))
            return self._logs[-1]
        lost = not corners.add(time, image, time - last <= self._longest_step)
        if k == corners.since:
            self.best, self._next, self._certain = None, 0, []
        elif k >= self._next and corners.show_parallax():
            self._next = corners.since + int(_LATER * (k - corners.since)) + 1
            self.best = self._confirmed(_adjusted(corners)) or self.best
        seen, initialised = int(corners.live.sum()), corners.initialised
        counts = (seen, before, seen - initialised, seen - initialised, 0, initialised, before + initialised - seen)
        spent = 1e3 * (thread_time() - began)
        self._logs.append(FrameLog(time, *counts, not lost, lost, False, False, spent, False))
        return self._logs[-1]

    def _confirmed(self, opening: Opening | None) -> Opening | None:
        """The same, certain only if one of at most half as many images was so and had the same motion: few can err."""
        if opening is None or not opening.certain:
            return opening
        x, first, half = opening.geometry, int(opening.images[0]), 0.5 * (opening.images[0] + opening.images[-1])
        R_WC, place = _poses(self.corners, opening)
        certain = False
        for images, earlier, *_ in self._certain:
            i, j = images[0] - first, images[-1] - first
            if i >= 0 and images[-1] <= half:
                R, p = R_WC[i].T @ R_WC[j], R_WC[i].T @ (place[j] - place[i])
                way = np.linalg.norm(earlier.p[-1]) / max(float(np.linalg.norm(p)), 1e-9)
                ends = np.stack((earlier.R_WC[0], earlier.R_WC[0] @ R)), np.stack((place[0], way * earlier.R_WC[0] @ p))
                certain |= _alike(Geometry(*ends, x.d, x.rho), earlier)
        self._certain.append(opening)
        return opening._replace(certain=certain)

    def cameras(self) -> tuple[np.ndarray, ...]:
        """Of the n images the cameras (n, 13), at rest, the covariances (n, 6, 6) of position and rotation, whether
        they are certain (n,), and whether they are known (n,): by the best opening, or before it, as long as the camera
        has only turned."""
        best, R_WC = self.best, np.array([one.R_WC for one in self.corners.seen])
        n = len(R_WC)
        cameras, covariances, certain = np.zeros((n, CAMERA_SIZE)), np.tile(_TURNED, (n, 1, 1)), np.zeros(n, bool)
        known = np.array([one.turned for one in self.corners.seen]) & (np.arange(n) >= self.corners.since)
        if best is not None:
            first = int(best.images[0])
            R_WC[first:], cameras[first:, POSITION] = _poses(self.corners, best)
            own = np.zeros((len(best.images), 6, 6))
            for k in range(1, len(own)):
                own[k] = best.covariance[6 * k - 6 : 6 * k, 6 * k - 6 : 6 * k]
            for i, j in np.ndindex(6, 6):
                covariances[first:, i, j] = np.interp(np.arange(first, n), best.images, own[:, i, j])
            covariances[first:] += _LEAST_VARIANCE * np.eye(6)
            certain[first:], known[first:] = best.certain, True
            known[:first] &= bool(self.corners.seen[first].turned)
        cameras[:, QUATERNION] = np.roll(Rotation.from_matrix(R_WC).as_quat(), 1, axis=1)
        at = np.interp([log.time for log in self._logs], [one.time for one in self.corners.seen], np.arange(n))
        before, after, share = at.astype(int), np.ceil(at).astype(int), (at % 1.0)[:, None]
        x, y = cameras[before], cameras[after]  # of the tracked images, between which each image is
        y[:, QUATERNION] *= np.sign((x * y)[:, QUATERNION].sum(axis=1, keepdims=True))
        x += share * (y - x)
        x[:, QUATERNION] /= np.where(share > 0.0, np.linalg.norm(x[:, QUATERNION], axis=1, keepdims=True), 1.0)
        return x, covariances[before], certain[before], known[before] & known[after]

    def belief(self, best: Opening, acceleration_stds: tuple[float, float], most: int) -> tuple[np.ndarray, ...]:
        """Of the last image and the ``best`` opening, which ends there, the camera (13,), ``most`` points or fewer by
        azimuth, elevation and inverse depth (n, 3), the joint covariance (12 + 3 n)^2 and the points' pixels (n, 2).

        ``acceleration_stds``: of the accelerations during the images that tell the velocity [m/s^2, rad/s^2].
        """
        x, images, P = best.geometry, best.images, best.covariance
        before, cameras = int(np.searchsorted(images, images[-1] - VELOCITY_IMAGES)), 6 * (len(images) - 1)
        span = self.corners.seen[images[-1]].time - self.corners.seen[images[before]].time
        chosen = self.corners.apart(best.corners, most)
        camera, points = np.zeros(CAMERA_SIZE), np.zeros((len(chosen), 3))
        camera[POSITION] = x.p[-1]
        camera[QUATERNION] = np.roll(Rotation.from_matrix(x.R_WC[-1]).as_quat(), 1)
        camera[VELOCITY] = (x.p[-1] - x.p[before]) / span
        camera[ANGULAR_VELOCITY] = Rotation.from_matrix(x.R_WC[-1] @ x.R_WC[before].T).as_rotvec() / span
        J = np.zeros((CAMERA_DIM + 3 * len(chosen), len(P)))
        J[:6, cameras - 6 : cameras] = np.eye(6)
        J[6:12, cameras - 6 : cameras] = np.eye(6) / span
        if before > 0:
            J[6:12, 6 * before - 6 : 6 * before] = -np.eye(6) / span
        for row, k in enumerate(chosen):
            by_direction, at, of = np.empty((2, 3)), CAMERA_DIM + 3 * row, cameras + 3 * k
            points[row] = *angles_of(x.d[k], by_direction), x.rho[k]
            J[at : at + 2, of : of + 2] = by_direction @ tangents(x.d[k])
            J[at + 2, of + 2] = 1.0
        covariance = J @ P @ J.T + _LEAST_VARIANCE * np.eye(len(J))
        slowing = span**2 / 3.0 * np.repeat(np.square(acceleration_stds), 3)
        covariance[6:12, 6:12] += np.diag(slowing)
        pixels = self.corners.level * (self.corners.pixels[best.corners[chosen]] + 0.5) - 0.5
        return camera, points, covariance, pixels


def _poses(corners: Corners, opening: Opening) -> tuple[np.ndarray, np.ndarray]:
    """R_WC (n, 3, 3) and positions (n, 3) of the images from the opening's first on, each by its points."""
    x, numbers = opening.geometry, range(int(opening.images[0]), len(corners.seen))
    R_WC, place = np.tile(x.R_WC[0], (len(numbers), 1, 1)), np.zeros((len(numbers), 3))
    for row, k in enumerate(numbers[1:], 1):
        R_WC[row], place[row] = R_WC[row - 1], place[row - 1]
        adjusted = np.flatnonzero(opening.images == k)
        if len(adjusted):
            R_WC[row], place[row] = x.R_WC[adjusted[0]], x.p[adjusted[0]]
            continue
        seen = corners.seen[k]
        _, point, place_in = np.intersect1d(opening.corners, seen.number, return_indices=True)
        z, std = np.full((2, len(x.d), 3), np.nan), np.ones((2, len(x.d)))
        z[1, point], std[1, point] = seen.bearing[place_in], seen.std[place_in]
        if len(point) >= _POSE:
            R_WC[row], place[row] = Bundle(z, std).second_camera(x, R_WC[row], place[row])
    return R_WC, place


def _adjusted(corners: Corners) -> Opening | None:
    """The likeliest motion through some of the images; None, where there is too little to tell one."""
    images = corners.chosen()
    used, z, std = corners.observed(images)
    if len(images) < _FEWEST_IMAGES or len(used) < FEWEST:
        return None
    bundle = Bundle(z, std)
    tried = _distinct([bundle.fit(x, _FIRST) for x in _hypotheses(corners, images, z)], _NEAR)
    squares = bundle.squares(tried[0][0])[bundle.seen]
    std = std * max(_LEAST, float(np.sqrt(np.median(squares) / (2.0 * np.log(2.0)))))  # by the median of chi-square
    bundle = Bundle(z, std)
    tried = _distinct([bundle.fit(x, _ROUNDS) for x, _ in tried])
    tried = _distinct([*tried, bundle.fit(_inside_out(tried[0][0], z), _ROUNDS)])
    (x, cost), others = tried[0], [cost for _, cost in tried[1:]]
    clear = (min(others, default=np.inf) - cost) / (2.0 * _CORRELATED)
    residual = np.sqrt(bundle.squares(x).sum(axis=0) / np.maximum(bundle.seen.sum(axis=0), 1))
    kept = (residual < _ASTRAY) & (x.rho > 0.0)
    if kept.sum() < FEWEST:
        return None
    share, used, bundle = kept.mean(), used[kept], Bundle(z[:, kept], std[:, kept])
    x, cost = bundle.fit(x._replace(d=x.d[kept], rho=x.rho[kept]), _ROUNDS)
    try:
        P = _CORRELATED * np.linalg.inv(bundle.normal_equations(x)[0])
        if not is_covariance(P):  # the normal equations are nearly singular
            return None
    except np.linalg.LinAlgError:
        return None
    cameras = 6 * (len(images) - 1)
    way = np.sqrt(np.diag(P)[cameras - 6 : cameras - 3].sum()) / max(float(np.linalg.norm(x.p[-1])), 1e-9)
    depth = np.median(np.sqrt(np.diag(P)[cameras + 2 :: 3]) / x.rho)
    certain = bool(clear > _CLEAR and share > _KEPT and way < _SHARP[0] and depth < _SHARP[1] and x.rho.min() > 0.0)
    return Opening(images, x, P, used, certain)


def _distinct(tried: list[tuple[Geometry, float]], most: float = np.inf) -> list[tuple[Geometry, float]]:
    """The best first, of those that are alike only the best, and none that costs ``most`` times as much as the best."""
    out: list[tuple[Geometry, float]] = []
    for x, cost in sorted(tried, key=lambda one: one[1]):
        if out and cost > most * out[0][1]:
            break
        if not any(_alike(x, other) for other, _ in out):
            out.append((x, cost))
    return out


def _alike(x: Geometry, y: Geometry) -> bool:
    """Whether two geometries end at nearly the same pose."""
    turn = np.trace(x.R_WC[-1].T @ y.R_WC[-1]) > 1.0 + 2.0 * np.cos(_ALIKE[0])
    return bool(turn and np.linalg.norm(x.p[-1] - y.p[-1]) < _ALIKE[1] * np.linalg.norm(x.p[-1]))


def _hypotheses(corners: Corners, images: np.ndarray, z: np.ndarray) -> list[Geometry]:
    """Geometries to begin with: a flat scene at rest, and what two views tell."""
    turns, seen = np.array([corners.seen[k].R_WC for k in images]), np.isfinite(z[..., 0])
    shared = (seen & seen[-1]).sum(axis=1)
    pair = int(np.flatnonzero(shared >= min(SHARED * seen[-1].sum(), shared[:-1].max()))[0])
    both = seen[pair] & seen[-1]
    way = np.array([corners.seen[k].way for k in images])
    share = np.clip((way - way[pair]) / max(way[-1] - way[pair], 1e-9), 0.0, 1.0)[:, None]
    first, last, columns = seen.argmax(axis=0), len(z) - 1 - seen[::-1].argmax(axis=0), np.arange(z.shape[1])
    out = []
    for R, p in [(turns[pair].T @ turns[-1], np.zeros(3)), *_two_view_motions(z[pair, both], z[-1, both])]:
        more = Rotation.from_matrix(turns[pair] @ R @ turns[-1].T)
        if more.magnitude() > MOST_TURNED:
            continue
        R_WC, place = (Rotation.from_rotvec(share * more.as_rotvec()).as_matrix() @ turns), share * (turns[pair] @ p)
        a, b = (np.einsum("nij,nj->ni", R_WC[k], z[k, columns]) for k in (first, last))
        rho = np.full(len(a), UNIT)
        if p.any():
            rho = inverse_depths(a, b, place[last] - place[first])
            middle = float(np.median(rho))
            place, rho = np.sign(middle) * place, np.clip(rho / (middle or 1.0), 0.05, 5.0)
        out.append(Geometry(R_WC, place, a, rho))
    return out


def _two_view_motions(a: np.ndarray, b: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Poses (R, p) of a camera that sees bearings ``b`` (n, 3) from one that sees ``a`` (n, 3), p or -p."""
    cv2, front = opencv(), (a[:, 2] > _LEVEL) & (b[:, 2] > _LEVEL)
    if front.sum() < FEWEST:
        return []
    x, y = (z[front, :2] / z[front, 2:] for z in (a, b))
    out = []
    E, _ = cv2.findEssentialMat(x, y, np.eye(3), method=cv2.USAC_MAGSAC, prob=0.999, threshold=_RANSAC)
    for k in range(0, 0 if E is None else len(E) - 2, 3):
        one, other, t = cv2.decomposeEssentialMat(E[k : k + 3])
        out += [(R, t.ravel()) for R in (one, other)]
    H, _ = cv2.findHomography(x, y, cv2.USAC_MAGSAC, _RANSAC)
    if H is not None:
        _, turns, ways, _ = cv2.decomposeHomographyMat(H, np.eye(3))
        out += [(R, t.ravel()) for R, t in zip(turns[::2], ways[::2])]  # those between go the other way
    return [(R.T, -R.T @ t) for R, t in out]


def _inside_out(x: Geometry, z: np.ndarray) -> Geometry:
    """The geometry that looks the same to first order: rho' = 2 mean(rho) - rho, p' = -p."""
    rho, p, R_WC = 2.0 * UNIT - x.rho, -x.p, x.R_WC.copy()
    for k in range(1, len(p)):
        seen = np.isfinite(z[k, :, 0])
        R_WC[k] = Rotation.align_vectors(x.d[seen] - rho[seen, None] * p[k], z[k, seen])[0].as_matrix()
    return Geometry(R_WC, p, x.d, rho)
