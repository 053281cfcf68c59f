"""Films of a track: the image with its searches, and the map from above. Pictures are RGB."""

import math
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from activeslam_gym.files import written_whole
from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.motion import CAMERA_DIM
from activeslam_gym.slam.estimate import taken_estimate
from activeslam_gym.vision.frontend import FrontEnd
from activeslam_gym.vision.opencv import opencv
from activeslam_gym.vision.search import DOUBTED, MATCHED, MISSED, Searched

# Okabe and Ito's colours, safe for colour-blind readers, as in `rendering.scene`.
BLUE, SKY, ORANGE, VERMILLION, GREEN, GREY = "#0072B2", "#56B4E9", "#E69F00", "#D55E00", "#009E73", "#9AA0A6"
PURPLE, YELLOW = "#CC79A7", "#F0E442"
OUTCOMES = {MATCHED: (GREEN, "found"), MISSED: (PURPLE, "missed"), DOUBTED: (YELLOW, "rejected")}
"""Colour and word for each outcome of a search; none is the target's or the camera's."""
_WIDTH = 640  # least width of the view [px]
_WAY = 2000  # most points of the way that is drawn
_SIGMAS_SEEN, _SIGMAS = 3.0, 2.0  # of the ellipses in the view and in the map


@dataclass(kw_only=True)
class Moment:
    """The estimate after an image, and where it was searched: n features and K fiducials, in metres and pixels."""

    image: np.ndarray  # (h, w) uint8
    searched: Searched
    camera: np.ndarray  # (13,) position, quaternion, velocity, angular velocity
    camera_covariance: np.ndarray  # (3, 3) of the position
    ids: np.ndarray  # (n,) of the features
    points: np.ndarray  # (n, 3)
    covariances: np.ndarray  # (n, 3, 3)
    mapped: np.ndarray  # (n,) bool, as in `slam.estimate.Estimate`
    fiducials: np.ndarray  # (K, 3) corners of the target

    @property
    def stds(self) -> np.ndarray:
        """(n, 3) standard deviations of the points [m]."""
        return np.sqrt(np.maximum(np.einsum("nii->ni", self.covariances), 0.0))


def moment_of(front_end: FrontEnd, image: np.ndarray) -> Moment:
    """The moment after ``image``."""
    estimate = taken_estimate(front_end.estimate())
    P = estimate.covariance
    rows = np.arange(CAMERA_DIM, len(P)).reshape(-1, 1, 3)
    return Moment(
        image=image,
        searched=front_end.searched,
        camera=estimate.camera,
        camera_covariance=P[:3, :3],
        ids=estimate.ids,
        points=estimate.points,
        covariances=P[np.swapaxes(rows, 1, 2), rows],
        mapped=estimate.mapped,
        fiducials=front_end.filter.fiducials,
    )


@contextmanager
def film_to(path: Path, rate: float, room: tuple[float, float, float] | None = None) -> Iterator[Callable[..., None]]:
    """A function that adds a `Moment` to the film ``path`` (.mp4), of ``rate`` [Hz], as its next picture or, if a time
    [s] is given, at that one; the `view` beside the map `from_above`. A context, at whose end the file is there, whole
    or not at all.

    Raises:
        ModuleNotFoundError: OpenCV is not installed.
        OSError: at the end, the film cannot be read again: the disk is full.
    """
    cv2, way, writer, unfinished = opencv(), list[np.ndarray](), None, path
    moments, count, last = 0, 0, np.zeros(0)
    with ExitStack() as at_close:

        def add(moment: Moment, time: float | None = None) -> None:
            nonlocal writer, unfinished, moments, count, last
            lengthen(way, moments, moment.camera[:7])
            moments += 1
            due = count if time is None else round(time * rate)
            if due < count:
                return
            picture = view(moment)
            picture = np.hstack((picture, from_above(moment, way, picture.shape, room)))
            if writer is None:
                unfinished = at_close.enter_context(written_whole(path))
                code = cv2.VideoWriter_fourcc(*"mp4v")
                writer = cv2.VideoWriter(str(unfinished), code, float(rate), picture.shape[1::-1])
            for _ in range(due - count):
                writer.write(last)
            last, count = cv2.cvtColor(picture, cv2.COLOR_RGB2BGR), due + 1
            writer.write(last)

        try:
            yield add
        finally:
            if writer is not None:
                writer.release()
        # OpenCV does not tell that it could not write a picture
        if way and cv2.VideoCapture(str(unfinished)).get(cv2.CAP_PROP_FRAME_COUNT) < count:
            raise OSError(f"{path} cannot be written as a video (is the disk full?)")


def lengthen(way: list[np.ndarray], count: int, pose: np.ndarray) -> None:
    """Add the ``pose`` (7,) after ``count`` others to the ``way``, which keeps at most `_WAY` of them, evenly, and the
    last."""
    every = 2 ** math.ceil(math.log2(max(count / _WAY, 1.0)))
    if every > 1 and count == every // 2 * _WAY + 1:
        way[:] = way[::2]
    way[math.ceil(count / every) :] = [pose]


def view(moment: Moment) -> np.ndarray:
    """(s h, s w, 3) the image, enlarged s times where it is small, with the searches' 3-sigma ellipses by outcome.

    Ellipses have a visible size; one that is not finite, or is larger than the picture, is left out.
    """
    cv2, (h, w) = opencv(), moment.image.shape
    scale = max(1, round(_WIDTH / w))
    picture = cv2.resize(moment.image, (scale * w, scale * h), interpolation=cv2.INTER_LINEAR)
    picture = cv2.cvtColor(picture, cv2.COLOR_GRAY2RGB)
    for _, pixel, S, outcome in zip(*moment.searched[:4]):
        at, colour = scale * (pixel + 0.5) - 0.5, OUTCOMES[int(outcome)][0]
        _ellipse(picture, at, (scale * _SIGMAS_SEEN) ** 2 * S, colour, least=10.0)
    return picture


def from_above(
    moment: Moment, way: list[np.ndarray], shape: tuple[int, ...], room: tuple[float, float, float] | None = None
) -> np.ndarray:
    """The map as a picture of ``shape``: features with their 2-sigma ellipses, the target's corners, and the ``way`` of
    poses (7,), of which the first looks upwards. The ``room`` about the origin gives the scale, if there is one.
    """
    cv2, picture = opencv(), np.full((*shape[:2], 3), 255, np.uint8)
    first, ahead = (rotation_matrix(way[k][3:])[[0, 2], 2] for k in (0, -1))
    up = -1.0 if first[1] > 0.0 else 1.0  # Z is downwards, or both axes are turned round
    path, fiducials, points = (up * np.array(p)[:, :3:2] for p in (way, moment.fiducials, moment.points))
    if room:
        high = 0.5 * np.array(room)[[0, 2]]
        low = -high
    else:
        low, high = np.percentile(np.concatenate((points, fiducials, path)), [2, 98], axis=0)
    size = np.array(shape[1::-1])
    scale = (0.9 if room else 0.8) * (size / np.maximum(high - low, 0.5)).min()

    def pixel(point: np.ndarray) -> np.ndarray:
        return scale * (point - 0.5 * (low + high)) + 0.5 * size

    def nearest(point: np.ndarray) -> np.ndarray:
        return np.rint(pixel(point)).astype(np.int32)

    if room:
        cv2.rectangle(picture, nearest(low), nearest(high), rgb(GREY), 1)
    for point, covariance, mapped in zip(points, moment.covariances, moment.mapped):
        plan = (scale * _SIGMAS) ** 2 * covariance[np.ix_((0, 2), (0, 2))]
        _ellipse(picture, pixel(point), plan, BLUE if mapped else SKY, least=4.0)
    for point in fiducials:
        cv2.circle(picture, nearest(point), 3, rgb(ORANGE), -1, cv2.LINE_AA)
    cv2.polylines(picture, [nearest(path)], False, rgb(VERMILLION), 2, cv2.LINE_AA)
    tip = np.rint(pixel(path[-1]) + 0.06 * size[0] * up * ahead).astype(np.int32)
    cv2.arrowedLine(picture, nearest(path[-1]), tip, rgb(VERMILLION), 3, cv2.LINE_AA, tipLength=0.4)
    return picture


def rgb(colour: str) -> tuple[int, int, int]:
    """``#RRGGBB`` as three numbers of 0 … 255."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


def _ellipse(picture: np.ndarray, middle: np.ndarray, squares: np.ndarray, colour: str, least: float) -> None:
    """The ellipse x' M^-1 x = 1 of ``squares`` M [px^2], axes of ``least`` [px] or more, if it is not too large."""
    if np.isfinite(middle).all() and np.isfinite(squares).all():
        lengths, axes = np.linalg.eigh(squares)
        if 0.0 < lengths[0] and lengths[1] < (3.0 * max(picture.shape)) ** 2:
            sides = np.maximum(2.0 * np.sqrt(lengths[::-1]), least)
            box = (tuple(middle.tolist()), tuple(sides.tolist()), math.degrees(math.atan2(axes[1, 1], axes[0, 1])))
            opencv().ellipse(picture, box, rgb(colour), 2, opencv().LINE_AA)
