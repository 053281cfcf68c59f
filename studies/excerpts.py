"""`track` along recorded motions of a hand, through rendered rooms and three kinds of lens, where the truth is known.

    python -m studies.excerpts room1.tum room2.tum --excerpts 4

A file has a line a pose, as `trajectories` has it. Each excerpt starts at rest before the target of a room in which it
meets no wall, and is flown at half the speed. Its images are of 640 x 480 pixels, 30 a second. Errors are those of the
position after the best rotation and shift; NEES are of the pose in the target's frame. Prints a table.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import tyro
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from activeslam_gym import config
from activeslam_gym.metrics import camera_error, nees
from activeslam_gym.motion import CAMERA_SIZE
from activeslam_gym.vision.calibration import Calibration
from activeslam_gym.vision.lens_files import Lens
from activeslam_gym.vision.other_lenses import Remap, fitted
from activeslam_gym.vision.room.camera import RoomCamera
from activeslam_gym.vision.room.scene import TARGET_SIZE
from activeslam_gym.vision.sources import Frame
from activeslam_gym.vision.target import Rectangle
from activeslam_gym.vision.track import follow
from activeslam_gym.vision.views import projected
from agents.tools.sections import table
from studies import Page, run

SIZE, RATE = (640, 480), 30.0
_MATRIX = np.array(((400.0, 0.0, 325.0), (0.0, 402.0, 236.0), (0.0, 0.0, 1.0)))
OURS = Calibration(*SIZE, 400.0, 325.0, 236.0, 8e-7)
LENSES = {
    "equation 1": None,
    "radial-tangential": Lens(SIZE, False, _MATRIX, np.array((-0.12, 0.03, 0.001, -0.0005))),
    "fisheye": Lens(SIZE, True, _MATRIX, np.array((-0.02, 0.004, -0.002, 0.0))),
}
STRETCH = 2.0
REST = 0.5  # time before the hand moves, which then takes a second to its pace [s]
GENTLE = 6.0, 20.0
"""Greatest acceleration [m/s^2] and angular acceleration [rad/s^2]: beyond, the motion capture had dropped out."""
LOST = 0.05  # error over the path's length, from which an excerpt is lost
CLEARANCE = 0.25  # least distance of the path from walls and boxes [m]
_ROOM = replace(config.SCENARIOS["pixels"], room_size=(9.0, 5.0, 9.0), fiducial_distance=(1.0, 1.2), fiducial_count=4)
HEADER = ("lens", "excerpts", "lost", "error / path, median, %", "greatest, %", "NEES of position, orientation", "ms")


class Flown(NamedTuple):
    """An excerpt that was tracked."""

    lost: bool  # in half of its images, or its error is over 5 % of the path
    error: float  # root mean square of the position over the length of the path
    nees: tuple[float, float]  # of position and orientation, per degree of freedom: the mean over time
    spent: float  # 99th percentile of an image [ms]


def excerpts(path: Path, seconds: float) -> Iterator[np.ndarray]:
    """True cameras (T, 13) of the gentle excerpts of a file, each from the pose of unity on."""
    rows = np.loadtxt(path, ndmin=2)
    times = STRETCH * (rows[:, 0] - rows[0, 0])
    turns = Rotation.from_quat(rows[:, 4:8]) * Rotation.from_matrix(np.diag((-1.0, -1.0, 1.0)))
    place, way = CubicSpline(times, rows[:, 1:4]), RotationSpline(times, turns)
    for start in np.arange(0.0, times[-1] - seconds, seconds):
        pace = np.clip(np.arange(round(seconds * RATE) + 1) / RATE - REST, 0.0, 1.0)[:, None]
        at = start + np.cumsum(pace) / RATE
        bent = np.linalg.norm(place(at, 2), axis=1).max(), np.linalg.norm(way(at, 2), axis=1).max()
        if bent[0] > GENTLE[0] or bent[1] > GENTLE[1]:
            continue
        home, cameras = way(start).inv(), np.zeros((len(at), CAMERA_SIZE))
        cameras[:, :3], cameras[:, 7:10] = home.apply(place(at) - place(start)), pace * home.apply(place(at, 1))
        cameras[:, 3:7] = np.roll((home * way(at)).as_quat(canonical=True), 1, axis=1)
        cameras[:, 10:] = pace * home.apply(way(at).apply(way(at, 1)))
        yield cameras


def room_for(cameras: np.ndarray, calibration: Calibration, rays: np.ndarray | None, seed: int) -> RoomCamera | None:
    """A room in which the path meets nothing, the first of twenty; None: there is none."""
    if (np.abs(cameras[:, :3]) > 0.5 * np.array(_ROOM.room_size) - CLEARANCE).any():
        return None
    lens = calibration.camera
    for attempt in range(20):
        room = RoomCamera(_ROOM, lens, np.random.SeedSequence((seed, attempt)), rays)
        low, high = (room.scene.boxes[None, :, side] for side in (0, 1))
        beyond = np.maximum(np.maximum(low - cameras[:, None, :3], cameras[:, None, :3] - high), 0.0)
        if np.linalg.norm(beyond, axis=-1).min() > CLEARANCE:
            return room
    return None


def rays_of(lens: Lens) -> np.ndarray:
    """(H, W, 2) where the rays of a lens's pixels meet the plane at depth 1, x to the left, y up."""
    width, height = lens.size
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).reshape(-1, 1, 2).astype(float)
    precise = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-12)
    undistort: Any = cv2.fisheye.undistortPoints if lens.fisheye else cv2.undistortPoints
    rays = undistort(pixels, lens.matrix, lens.coefficients, criteria=precise)
    return -rays.reshape(height, width, 2)


def flown(cameras: np.ndarray, lens: Lens | None, seed: int) -> Flown | None:
    """The excerpt through a lens and a room of ``seed``; None: no room has it."""
    calibration, straighten, rays = OURS, None, None
    if lens is not None:
        calibration, rays = fitted(lens, "the study")[0], rays_of(lens)
        straighten = Remap(lens, calibration)
    room = room_for(cameras, calibration, rays, seed)
    if room is None:
        return None
    target = Rectangle(*TARGET_SIZE, np.zeros((4, 2)))
    middle = room.fiducials.mean(axis=0)
    turn, _ = Rotation.align_vectors(target.fiducials, room.fiducials - middle)  # from the room to the target's frame
    true = cameras.copy()
    for part in (slice(0, 3), slice(7, 10), slice(10, 13)):
        true[:, part] = turn.apply(cameras[:, part] - (middle if part.start == 0 else 0.0))
    true[:, 3:7] = np.roll((turn * Rotation.from_quat(np.roll(cameras[:, 3:7], -1, axis=1))).as_quat(), 1, axis=1)
    corners = projected(calibration.camera, true[0], target.fiducials)
    images: Iterator[Frame] = ((k / RATE, room.photograph(camera, k)) for k, camera in enumerate(cameras))
    images, target = map(straighten, images) if straighten else images, target._replace(corners_px=corners)
    done = follow(images, calibration, target, RATE)
    errors = [camera_error(a, b) for a, b in zip(true, done.cameras)]
    ratios = [[nees(e[p], P[p, p]) / 3.0 for p in (slice(0, 3), slice(3, 6))] for e, P in zip(errors, done.covariances)]
    length = np.linalg.norm(np.diff(true[:, :3], axis=0), axis=1).sum()
    found, known = (path - path.mean(axis=0) for path in (done.cameras[:, :3], true[: len(done.cameras), :3]))
    error = float(Rotation.align_vectors(known, found)[1] / np.sqrt(len(found)) / length)
    position, orientation = np.mean(ratios[1:], axis=0).tolist()
    spent = float(np.percentile([log.milliseconds for log in done.logs], 99))
    lost = len(done.lost) < len(true) or done.lost.mean() > 0.5 or error > LOST
    return Flown(bool(lost), error, (position, orientation), spent)


@dataclass(frozen=True, kw_only=True)
class Args(Page):
    """`track` along recorded motions of a hand, through rendered rooms and three kinds of lens."""

    section = "excerpts"
    paths: tyro.conf.Positional[tuple[Path, ...]]
    """Files of recorded motions."""
    seconds: float = 20.0
    """Duration of an excerpt."""
    excerpts: int = 6
    """Most excerpts of each file."""
    seed: int = config.TRAINING_SEED
    """Seed of the rooms."""


def main(args: Args) -> None:
    """Fly, and print the table."""
    rows = []
    for name, lens in LENSES.items():
        runs = []
        for path in args.paths:
            paths = enumerate(excerpts(path, args.seconds))
            tried = (flown(cameras, lens, args.seed + k) for k, cameras in paths)
            runs += list(islice(filter(None, tried), args.excerpts))
        print(name, *runs, sep="\n", flush=True)
        if not runs:
            raise ValueError("paths: no excerpt is gentle enough and has a room; allowed: files with one that has")
        errors = [100.0 * run.error for run in runs if not run.lost] or [np.nan]
        ratios = np.mean([run.nees for run in runs if not run.lost] or [(np.nan, np.nan)], axis=0)
        rows.append([
            *(name, str(len(runs)), str(sum(run.lost for run in runs))),
            *(f"{np.median(errors):.2f}", f"{max(errors):.2f}", ", ".join(f"{value:.2f}" for value in ratios)),
            f"{np.median([run.spent for run in runs]):.1f}",
        ])  # fmt: skip
    args.publish(f"{args.seconds:g} s of each, rooms from {args.seed}\n\n{table(HEADER, rows)}")


if __name__ == "__main__":
    run(Args, main)
