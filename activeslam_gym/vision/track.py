"""From a sequence of images to a trajectory, a map and a log: the command ``track``.

The trajectory is in TUM's format, ``t tx ty tz qx qy qz qw``: camera-to-world in the target's frame, with the camera's
axes as image files have them, x right, y down, z forward. The filter's camera has x left, y up: R_file = R diag(-1, -1,
1), a half turn about z.

Without a target the first camera is the world's origin, X to its right, Y up, Z towards the viewer, and the scale is
free: lengths are in a unit that only the prior of depth has chosen, and that may drift.
"""

import signal
from argparse import Namespace
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import ExitStack, closing
from functools import partial
from itertools import chain
from pathlib import Path
from threading import current_thread, main_thread
from time import thread_time
from typing import Any, NamedTuple, TypeVar

import numpy as np

from activeslam_gym.config import Scenario
from activeslam_gym.files import argument, demand_writable
from activeslam_gym.motion import CAMERA_DIM
from activeslam_gym.slam.belief import SPARE_FEATURES
from activeslam_gym.slam.filter import Filter
from activeslam_gym.vision.bundle import UNIT
from activeslam_gym.vision.calibration import Calibration
from activeslam_gym.vision.film import film_to, moment_of
from activeslam_gym.vision.first_sight import demand_agreement, fiducials_among, other_print, seen_corners, start_pose
from activeslam_gym.vision.frontend import FrameLog, FrontEnd, FrontEndSettings
from activeslam_gym.vision.lens_check import LensCheck
from activeslam_gym.vision.opencv import opencv
from activeslam_gym.vision.other_lenses import lens_from
from activeslam_gym.vision.report import FREE, TURNED, Agreement, Diagnosis, TrackFiles, blemish
from activeslam_gym.vision.settings import FEATURES, FEWEST, MOST, TRACK_FEATURES
from activeslam_gym.vision.sources import Frame, SourceError, images_of, read_times
from activeslam_gym.vision.start import is_narrow, steps_from_anywhere
from activeslam_gym.vision.target import FACING, Target, as_first_seen, drawn, read_target
from activeslam_gym.vision.views import reduced

HAND_HELD: dict[str, Any] = {
    "name": "track",
    "pixel_std": 1.0,
    "filter_acceleration_std": 2.0,  # 95 % of a hand's are under 1.2 m/s^2 ...
    "filter_angular_acceleration_std": 3.0,  # ... and under 3.5 rad/s^2
    "command_known": False,
    "linearity_threshold": 0.1,  # at 0.2 a map without a target drifts in scale
    "inverse_depth_mean": 0.75,  # a desk or a room: from 0.67 m on at one deviation
    "inverse_depth_std": 0.75,
}
"""Fields of the scenario of a camera in the hand."""
UNSCALED = {"inverse_depth_mean": UNIT, "inverse_depth_std": 0.75}
"""The same without a target: the mean only sets the unit. With a wider spread the scale drifts, and the map is lost."""
UNCERTAIN = "the start is uncertain, and with it all poses"
AT_REST = "the camera was at rest or only turned, or something moved before it"
SEVERAL = "several motions explain the images, or none: something moved before the camera, or it moved too little"
NARROW = "several motions explain the images, as always with a lens of less than 50 degrees"
DRIFTED = (
    "the turn since the start is not known to 1.5 degrees from {:.2f} s on, or the map contradicts the images: "
    "a narrow lens, a quick motion, a cut, or a map that was lost"
)
CONTRADICTED = (
    "the map contradicts the images from {:.2f} s on, or the turn is not known to 10 degrees, and poses may be wrong "
    "from some time before: something moved before the camera, the picture was changed (a cut, zoom, interlacing, "
    "letters in it), the hand was too quick, or it was too dark"
)
MISFIT = "the images fit {:.2f} times the focal length of the calibration (± {:.2f}): check it"
BENT = (
    "the images do not fit the lens of the calibration, in their corners by a factor of {:.2f} (± {:.2f}): check its "
    "model and distortion"
)
REPLACED = "the map was replaced {} times, where the target contradicted it: poses before may be wrong"
"""The words for a track whose motion the images do not tell, and for one that they contradict."""
Item = TypeVar("Item")
_CORNER_STD = 0.35  # of the target's corners in the first image: aliasing and the lens [px]
_SPEED_STD, _TURN_STD = 0.05, 0.05  # of the first velocity [m/s] and angular velocity [rad/s]: a hand at rest
_KNOWN = np.radians(10.0)  # deviation of the turn, from which a tracked pose is uncertain; at the start it has 3 to 6
_SURELY = 3.0  # deviations of its position by which a camera has moved for sure
_BEHIND = np.array((0.0, 0.0, -1.0))  # the target's normal, away from the camera


class Track(NamedTuple):
    """The result of tracking n images."""

    times: np.ndarray  # (n,) [s]
    cameras: np.ndarray  # (n, 13) means of the camera (filter axes)
    covariances: np.ndarray  # (n, 6, 6) of position and rotation
    logs: list[FrameLog]  # of all images but the first
    lost: np.ndarray  # (n,) bool: images in which too little was matched to tell the pose
    filter: Filter  # as it was after the last image
    trouble: str | None  # why it ended early, or None
    repeated: int = 0  # images that repeat the one before, and have its pose
    displaced: int = 0  # features that made room for others in a full map
    misfit: tuple[float, float] | None = None  # ratio of the focal length to the calibration's, deviation
    bent: tuple[float, float] | None = None  # the same of distances from the images' centre to the corners: distortion

    @property
    def start_certain(self) -> bool:
        """Whether there was a target, or one motion alone explained the start, and the map agrees with the images."""
        return self.logs[-1].start_certain if self.logs else self.metric

    @property
    def doubt(self) -> str:
        """Why the poses are not certain; or "" ."""
        lens = BENT.format(*self.bent) if self.bent else self.misfit and MISFIT.format(*self.misfit)
        return "; ".join(filter(None, (self._contradiction, lens)))

    @property
    def _contradiction(self) -> str:
        if restarts := self.filter.counts["restarts"]:
            return REPLACED.format(restarts)
        if self.start_certain:
            return ""
        last = max((k for k, log in enumerate(self.logs) if log.start_certain), default=-1)
        if self.metric or last >= 0:
            return (CONTRADICTED if self.metric else DRIFTED).format(self.times[last + 2])
        moved = NARROW if is_narrow(self.filter.camera) else SEVERAL
        return f"{UNCERTAIN}: {AT_REST if self.at_rest else moved}"

    @property
    def at_rest(self) -> bool:
        """Whether the camera has not moved for sure."""
        way, variance = np.ptp(self.cameras[:, :3], axis=0), np.trace(self.covariances[-1, :3, :3])
        return bool(way @ way < _SURELY**2 * variance)

    @property
    def metric(self) -> bool:
        """Whether a target gave the scale."""
        return len(self.filter.fiducials) > 0


def start(
    image: np.ndarray,
    calibration: Calibration,
    target: Target,
    scenario: Scenario,
    settings: FrontEndSettings | None = None,
    time_s: float = 0.0,
) -> FrontEnd:
    """A front end with the `scenario_of` a camera that stands before ``target`` and has seen the first ``image``, of
    ``time_s`` [s].

    Raises:
        ValueError: the image does not fit the calibration, or the target is not where it is said to be.
    """
    calibration.check_image(image)
    whole = calibration.camera
    try:
        points, corners = seen_corners(image, whole, target)
    except ValueError as error:
        raise ValueError(f"{error}{(spot := blemish(image)) and f'; the image {spot}'}") from None
    try:
        pose, covariance = start_pose(whole, points, corners, _CORNER_STD)
        missed = demand_agreement(whole, pose, points, corners)
    except ValueError as error:
        raise ValueError(f"{error}{other_print(image, target)}") from None
    fiducials = fiducials_among(points)
    mean, P = np.concatenate((pose, np.zeros(6))), np.diag(np.repeat((1.0, _SPEED_STD**2, _TURN_STD**2), (6, 3, 3)))
    P[:6, :6] = covariance * max(1.0, missed / _CORNER_STD) ** 2
    timed = (settings or FrontEndSettings()).timed(scenario.frame_time)
    front_end = FrontEnd(Filter(scenario, fiducials=fiducials, camera=mean, covariance=P), timed)
    camera = front_end.camera
    picture, pixels, bright = drawn(reduced(image, calibration.scale), camera, target, pose, fiducials)
    front_end.start(image, time_s, -1 - np.arange(len(pixels)), pixels, picture, _BEHIND)
    front_end.show(partial(as_first_seen, camera, target, pose, fiducials, bright), _BEHIND, pose)
    return front_end


def scenario_of(
    calibration: Calibration, metric: bool, rate: float, features: int = FEATURES, **fields: Any
) -> Scenario:
    """That of a camera in the hand of ``rate`` images a second [Hz], with room for so many ``features`` in the map and
    with a known scale if ``metric``; ``fields`` are others of it.

    Raises:
        ValueError: ``features`` is out of range.
    """
    if not (isinstance(features, int) and FEWEST <= features <= MOST):
        raise ValueError(f"features must be a whole number from {FEWEST} to {MOST}, got {features!r}")
    size = {"landmark_count": features - SPARE_FEATURES}
    unused = {"controller_frequency": min(5.8, 0.5 * rate), "rate_loop_time": max(0.1, 1.0 / rate)}  # but checked
    own = HAND_HELD | size | unused | ({} if metric else UNSCALED)
    return calibration.scenario(**own | fields, frame_time=1.0 / rate)


def follow(
    images: Iterable[Frame],
    calibration: Calibration,
    target: Target | None,
    rate: float,
    settings: FrontEndSettings | None = None,
    watch: Callable[[FrontEnd, Frame, FrameLog], None] = lambda front_end, frame, log: None,
    features: int = TRACK_FEATURES,
) -> Track:
    """Track ``images``; trouble with an image, or Ctrl-C, ends the track, and the part before it is kept.

    Without a ``target`` the scale is free, see the module, and the images until the start is certain are reported late
    (`vision.start`). ``watch`` is called after each image. ``features``: of the map, at most.

    Raises:
        SourceError, ValueError: the first image is missing, of the wrong size or without the target; or ``features``.
    """
    source, scenario = _of_size(images, calibration), scenario_of(calibration, target is not None, rate, features)
    if target is None:
        home = np.concatenate((np.zeros(3), FACING, np.zeros(6)))
        timed = (settings or FrontEndSettings()).timed(scenario.frame_time)
        front_end = FrontEnd(Filter(scenario, camera=home), timed)
        steps = steps_from_anywhere(source, calibration, front_end)
    else:
        first, began = next(source), thread_time()
        front_end = start(first[1], calibration, target, scenario, settings, first[0])
        agreement = Agreement(frame_time=1.0 / rate)

        def judged(frame: Frame) -> tuple[Frame, FrameLog]:
            log = agreement.judged(front_end.step(frame[1], frame[0]), front_end.strayed)
            known = log.lost or np.trace(front_end.filter.camera_covariance[3:6, 3:6]) < _KNOWN**2
            return frame, log._replace(start_certain=bool(log.start_certain and known))

        steps = chain([(first, front_end.first_log(1e3 * (thread_time() - began)))], map(judged, source))
    filter, trouble, rows = front_end.filter, None, list[tuple[float, np.ndarray, np.ndarray, FrameLog]]()
    lens = LensCheck(front_end.camera)
    try:
        for frame, log in steps:
            rows.append((frame[0], filter.mean, filter.camera_covariance[:6, :6], log))
            watch(front_end, frame, log)
            if not (log.lost or is_narrow(front_end.camera)):
                lens.add(filter.mean, front_end.candidates)
    except (ValueError, KeyboardInterrupt) as error:
        if not rows:
            raise
        trouble = str(error) if isinstance(error, ValueError) else "interrupted"
    times, cameras, covariances, logs = zip(*rows)
    lost = np.array([log.lost for log in logs])
    stacked = np.array(times), np.array(cameras), np.array(covariances)
    counts = front_end.repeated, front_end.displaced
    return Track(*stacked, [*logs[1:]], lost, filter, trouble, *counts, lens.focal, lens.distortion)


def track(args: Namespace) -> tuple[Track, str]:
    """Run the command: `follow` the images ``args.images`` and write `TrackFiles` into the folder ``args.out``, and
    with ``args.film`` the images with their ellipses beside the map, film.mp4. The track, and advice on what was lost.

    Raises:
        OSError: a file is missing or cannot be written.
        ValueError: a file is not as it should be, or the first image does not show the target.
        ModuleNotFoundError: OpenCV is not installed.
    """
    opencv()
    from tqdm import tqdm

    folder, diagnosis = Path(args.out), Diagnosis()
    with argument("calibration"):
        lens, straighten = lens_from(args.calibration, args.camera)
    with argument("target"):
        known = None if args.target is None else read_target(args.target, straighten.pixels)
    with argument("times"):
        if args.times is not None:
            read_times(args.times)
    with argument("images", SourceError):
        turned = None if args.readout else lens[:2]  # rows of a turned picture are no rows of the sensor
        source = images_of(args.images, args.rate, args.times, turned)
    with argument("readout"):
        if not abs(args.readout) < 1.0 / source.rate:
            raise ValueError(f"must be less than the {1.0 / source.rate:.3f} s between images, got {args.readout:g}")
    with argument("out"):
        demand_writable(folder)
        folder.mkdir(parents=True, exist_ok=True)
    files, film, tracked = None, None, 0

    def keep(front_end: FrontEnd, frame: Frame, log: FrameLog) -> None:
        nonlocal files, film, tracked
        if files is None:  # the first image shows the target
            film = at_close.enter_context(film_to(folder / "film.mp4", source.rate)) if args.film else None
            opened = TrackFiles(folder, known is not None, args.keep_lost, args.belief is not None)
            files = at_close.enter_context(closing(opened))
        filter, dated = front_end.filter, log._replace(time=source.origin + log.time)
        files.add(source.origin + frame[0], filter.mean, dated, filter.camera_covariance[:6, :6])
        if log.lost:
            diagnosis.add(frame[1], log, filter.estimate().mapped, tracked)
        tracked += not log.lost
        if film is not None:
            film(moment_of(front_end, frame[1]))

    with ExitStack() as at_close:
        bar = tqdm(map(straighten, source.frames), "track", source.total, unit=" images", disable=None)  # in a terminal
        whole = at_close.enter_context(closing(interruptible(bar)))
        settings = FrontEndSettings(readout=args.readout)
        done = follow(whole, lens, known, source.rate, settings, watch=keep, features=args.features)
        if files is not None:
            points, P = done.filter.points()
            files.save(done.filter.ids, points, np.sqrt(np.diag(P)[CAMERA_DIM:]).reshape(-1, 3))
    return done, diagnosis.advice(done.metric)


def interruptible(steps: Iterable[Item]) -> Generator[Item, None, None]:
    """The same; SIGINT, SIGTERM and SIGHUP of the main thread are raised as KeyboardInterrupt before the next step.

    Within a kernel, or in OpenCV, such an exception can end the process. A second signal does not wait. `nohup` holds.
    """
    noted: list[int] = []

    def note(number: int, _: object) -> None:
        if noted:
            raise KeyboardInterrupt
        noted.append(number)

    main = current_thread() is main_thread()
    hangup = getattr(signal, "SIGHUP", signal.SIGTERM)  # not on Windows
    ending = {signal.SIGINT, signal.SIGTERM} | ({hangup} if signal.getsignal(hangup) != signal.SIG_IGN else set())
    before = {number: signal.signal(number, note) for number in ending if main}
    try:
        for step in steps:
            yield step
            if noted:
                raise KeyboardInterrupt
    finally:
        for number, handler in before.items():
            signal.signal(number, handler or signal.SIG_DFL)


def _of_size(frames: Iterable[Frame], calibration: Calibration) -> Iterator[Frame]:
    """The same; a ValueError at the first that does not fit the calibration, or where there is none."""
    frame = None
    for frame in frames:
        calibration.check_image(frame[1])
        yield frame
    if frame is None:
        raise SourceError("images: there is none; allowed: one or more of (time, grey image)")


def summary(done: Track) -> str:
    """A line on the track."""
    matched, searched = (sum(getattr(log, name) for log in done.logs) for name in ("matched", "searched"))
    line = f"{len(done.times)} images; {matched / max(searched, 1):.0%} of the searched features found"
    if done.lost.any():
        line += f"; lost in {done.lost.sum()} images, first at {done.times[done.lost.argmax()]:.2f} s"
    if again := sum(log.relocalised for log in done.logs):
        line += f"; found again {again} times"
    if done.repeated:
        line += f"; {done.repeated} repeat the image before and have its pose"
    if done.displaced > done.filter.capacity:
        line += f"; {done.displaced} features made room for others: with more --features, places seen before are known"
    free = [] if done.metric else [FREE, *([TURNED] if done.at_rest else [])]
    return "; ".join([line, *free, *filter(None, [done.doubt])])
