"""What a track leaves: its files of poses, images, map and belief, and why images were lost and what would help."""

import csv
from collections import Counter
from importlib import metadata
from io import StringIO
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from activeslam_gym.files import Lines, written_whole
from activeslam_gym.geometry import quaternion_product
from activeslam_gym.vision.corners import new_corners
from activeslam_gym.vision.frontend import FrameLog
from activeslam_gym.vision.settings import RATE, FrontEndSettings, weight_of_image
from activeslam_gym.vision.templates import TEMPLATE_HALF, TEMPLATE_SIDE

FREE = "no target: the scale is free, lengths are in a unit of their own and may drift"
"""The words for a track without a target."""
BELIEF = """\
#%FORMAT SQUARE/0.3
#%REPRESENTATION gaussian_se3
#%POSE_FRAME world
#%BODY_FRAME camera
#%GAUGE {}
#%TIMESTAMP_UNIT seconds
#%ALGORITHM activeslam_gym
#%ALGORITHM_VERSION {}
#%TANGENT_CONVENTION right_perturbation
#%TANGENT_ORDER translation_rotation
#%ROTATION_PARAM axis_angle
"""
"""The first lines of a belief as `smfeval` 0.4 reads it: T = T_file Exp(xi), and a row has xi's covariance.

Its NEES of poses follows this convention. Its scores of relative poses and its CRPS take xi's axes for the world's
(findings/smfeval_takes_body_axes_for_world_axes.sh), so they depend on the heading.
"""
_HALF_TURN = np.array((0.0, 0.0, 0.0, 1.0))  # quaternion of diag(-1, -1, 1)


class TrackFiles:
    """trajectory.tum and frames.csv in ``folder``, to which each image adds a line, and map.csv, written when asked.

    Poses are in TUM's format, see `vision.track`. Where the scale is not ``metric``, the first line says so. Lost
    images have a line in frames.csv only, unless ``keep_lost``. With ``belief`` there are covariances in belief.square.

    Raises:
        OSError: they cannot be written.
    """

    def __init__(self, folder: Path, metric: bool, keep_lost: bool = False, belief: bool = False) -> None:
        self._map, self._keep_lost = folder / "map.csv", keep_lost
        for name in ("map.csv", "film.mp4", "belief.square"):
            (folder / name).unlink(missing_ok=True)  # of a track before
        self._poses, self._frames = Lines(folder / "trajectory.tum"), Lines(folder / "frames.csv")
        self._rows = csv.writer(self._frames)
        self._rows.writerow(FrameLog._fields)
        if not metric:
            self._poses.write(f"# {FREE}\n")
        self._belief = Lines(folder / "belief.square") if belief else None
        if self._belief is not None:
            version = next((found.version for found in metadata.distributions(name="activeslam-gym")), "unknown")
            self._belief.write(BELIEF.format("se3" if metric else "sim3", version))

    def add(self, time: float, camera: np.ndarray, log: FrameLog | None, covariance: np.ndarray | None = None) -> None:
        """The pose of ``camera`` (>= 7,) at ``time`` [s], its ``covariance`` (6, 6), and the ``log``, if any."""
        w, x, y, z = quaternion_product(camera[3:7], _HALF_TURN)
        if log is None or not log.lost or self._keep_lost:
            self._poses.write(f"{time:.6f} {' '.join(f'{number:.7f}' for number in (*camera[:3], x, y, z, w))}\n")
            if self._belief is not None and covariance is not None:
                turn = np.kron(np.eye(2), Rotation.from_quat((x, y, z, w)).as_matrix())  # errors in the camera's axes
                entries = (turn.T @ covariance @ turn)[np.tril_indices(6)]
                row = " ".join(f"{number:.12g}" for number in (*camera[:3], x, y, z, w, *entries))
                self._belief.write(f"{time:.9f} {row}\n")
        if log is not None:
            self._rows.writerow(
                (f"{log.time:.6f}", *map(int, log[1:-2]), f"{log.milliseconds:.3f}", int(log.start_certain))
            )

    def save(self, ids: np.ndarray, points: np.ndarray, stds: np.ndarray) -> None:
        """Write the map, see `map_table`."""
        with written_whole(self._map) as unfinished, unfinished.open("w", newline="") as file:
            file.write(map_table(ids, points, stds))

    def close(self) -> None:
        """Nothing more is written."""
        for file in filter(None, (self._poses, self._frames, self._belief)):
            file.close()


def map_table(ids: np.ndarray, points: np.ndarray, stds: np.ndarray) -> str:
    """A map as CSV: ids (n,), positions (n, 3) and their standard deviations (n, 3) [m]."""
    table = StringIO()
    writer = csv.writer(table)
    writer.writerow(("id", "x", "y", "z", "std_x", "std_y", "std_z"))
    writer.writerows((id, *(f"{value:.6f}" for value in row)) for id, row in zip(ids, np.hstack((points, stds))))
    return table.getvalue()


_DARK = 40  # an image is dark where 99 % of its pixels are no brighter, of 255
_FEW_CORNERS = 8  # an image with fewer is blank
_LOOKED_AT = 60  # lost images whose reason is sought
_PROVEN = 30  # tracked images after which the lens is not to blame
_SHARE, _MOST_STRAYED = 1.0 / 30.0, 0.014  # of an image in running means; for each matched feature, `Agreement` [px]
_MOST_FREE = 1.1  # features deleted in an image, as a mean, from which a map without a target is wrong
_FALL, _BACK = 1.0 / 3.0, 0.82  # of the share that is matched, see `Agreement`
_CHANGED = 0.2  # share of the searched features, by which the map may change until it is seen again
_TURNING = 0.2  # share of the map with a known depth, under which the camera has moved sideways too little

DARK = f"is dark (99 % of its pixels have {_DARK} of 255 or less): more light, or a longer exposure, would help"
TURNED = "the camera had moved sideways by next to nothing, and turning gives no depth"
BLANK = "has no corners (a blank wall, or blur): keep textured objects in view"


def blemish(image: np.ndarray) -> str:
    """What keeps features from being found in the ``image`` (h, w) uint8, as ``DARK`` or ``BLANK``; or "" ."""
    if int(np.percentile(image, 99)) <= _DARK:
        return DARK
    s, edge = FrontEndSettings(), TEMPLATE_HALF + 8
    corners = new_corners(image, np.zeros((0, 2)), _FEW_CORNERS, TEMPLATE_SIDE, edge, s.least_corner)
    return BLANK if len(corners) < _FEW_CORNERS else ""


class Agreement:
    """Watches whether a map agrees with the images, of a camera before a target unless ``metric`` is false.

    Images are ``frame_time`` [s] apart; of more than 30 a second, each counts less.

    The features of a wrong map stray from their predicted pixels until they are deleted. Before a target, the residuals
    of the deleted for each matched feature, as running means, exceeded their limit in 2 of 46 right flights in rendered
    rooms, and in 30 of 54 wrong ones; the limit was chosen in other flights. Something that moves before the camera is
    mostly found, a zoom in 3 of 7. Features that noise hides are deleted too, and tell little of the map: only without
    a target, where more than `_MOST_FREE` in an image count. So 6 of 37 right flights are flagged there, and 7 of 10
    wrong ones; in other rooms none of 14, and 4 of 10.

    At a cut the share of the searched features that is matched falls at once: to less than a third of that in the image
    before. In 60 right flights it kept half, except in flashes and blur. There the map was soon seen again, with 0.85
    or more. No pose is certain until then, and none later if more than a fifth of it changed meanwhile: of the searched
    features at most 0.17 were new or deleted in those flights, and 0.59 or more after cuts to another place.
    """

    def __init__(self, metric: bool = True, frame_time: float = 1.0 / RATE) -> None:
        self._weight = weight_of_image(frame_time)
        self._metric, self._strayed, self._deleted, self._matched, self.holds = metric, 0.0, 0.0, 0.0, True
        self._share, self._seen, self._changes = 0.0, True, 0  # matched; in view; of the map since it is not

    def judged(self, log: FrameLog, strayed: float = 0.0) -> FrameLog:
        """The next ``log``, certain if the map still agrees with the images, and never contradicted the target.
        ``strayed``: residuals of the features that were deleted, see `FrontEnd` [px]."""
        self.holds &= log.start_certain
        if log.searched:
            gain = _SHARE * self._weight
            self._matched += gain * (log.matched - self._matched) if self._matched else log.matched
            self._strayed += gain * (strayed / self._weight - self._strayed)
            self._deleted += gain * (log.deletions / self._weight - self._deleted)
            share = log.matched / log.searched
            self._seen = share > _BACK or (self._seen and share >= _FALL * self._share)
            self._share = share
            self._changes = 0 if self._seen else self._changes + log.initialised + log.deletions
            self.holds &= self._strayed <= _MOST_STRAYED * max(self._matched, 1.0)
            self.holds &= self._metric or self._deleted <= _MOST_FREE
            self.holds &= self._changes <= _CHANGED * log.searched
        return log._replace(start_certain=self.holds and self._seen)


class Diagnosis:
    """Collects the reasons of lost images."""

    def __init__(self) -> None:
        self._reasons: Counter[str] = Counter()
        self._mapped = 1.0

    def add(self, image: np.ndarray, log: FrameLog, mapped: np.ndarray, tracked: int = 0) -> None:
        """A lost ``image`` (h, w), its ``log``, which features (n,) were ``mapped``, and images ``tracked`` before."""
        if self._reasons.total() >= _LOOKED_AT:
            return
        if not self._reasons:
            self._mapped = float(mapped.mean()) if len(mapped) else 1.0
        if spot := blemish(image):
            reason = f"a lost image {spot}"
        elif log.found > 2 * max(log.matched, 3) and tracked < _PROVEN:
            reason = "the matches fit no motion of the camera: check that the calibration is of this lens"
        elif log.searched < 3:
            reason = (
                "the map was out of view, or the motion too quick: slower motion, or more images a second, would help"
            )
        else:
            reason = (
                "features were not found again (blur, or too quick a motion): slower motion, or more light, would help"
            )
        self._reasons[reason] += 1

    def advice(self, target: bool) -> str:
        """The commonest reason and what would help; ``target``: whether the track started from one."""
        if not self._reasons:
            return "nothing was lost"
        reason, advice = self._reasons.most_common(1)[0][0], []
        if not reason.startswith("a lost image"):
            if self._mapped < _TURNING:
                advice.append(TURNED)
            if not target:
                advice.append("a target in the first image may help")
        return "; ".join([reason, *advice])
