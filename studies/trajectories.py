"""Estimators along recorded motions of a hand-held camera, whose commands they do not know.

    python -m studies.trajectories room1.tum room2.tum --rooms 8

A file has a line a pose, ``t x y z qx qy qz qw``: camera-to-world, Y up, camera axes x right, y down, z forward. The
camera of `hand-held` flies it in a room of points that is drawn around it. Association is known. Prints a table.
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from activeslam_gym import Scenario, config
from activeslam_gym.metrics import LOST_POSITION_ERROR, camera_error, nees
from activeslam_gym.motion import CAMERA_SIZE
from activeslam_gym.sensors.points import PointModel
from activeslam_gym.slam.belief import start_of
from activeslam_gym.slam.estimator import ESTIMATORS, Measurements
from agents.tools.sections import table
from studies import run

POINTS, FIDUCIALS = 48, 6
MARGIN = np.array((1.5, 0.8, 1.5))  # points are at most so far outside the extent of the path [m]
HEADER = ("noise, px", "estimator", "position error, RMS, cm", "NEES of the pose", "NEES of landmarks", "lost")


class Flight(NamedTuple):
    """T frames."""

    errors: np.ndarray  # (T,) of the position [m]
    nees: np.ndarray
    """(T, 3) per degree of freedom, of position, orientation and landmarks (mean of the mapped, or NaN)."""


def read_path(path: Path, seconds: float) -> tuple[np.ndarray, float]:
    """True cameras (T, 13) of the first ``seconds``, and the time of a frame [s]."""
    rows = np.loadtxt(path, ndmin=2)
    dt = float(np.median(np.diff(rows[:, 0])))
    rows = rows[: round(seconds / dt) + 1]
    turns, cameras = Rotation.from_quat(rows[:, 4:8]), np.zeros((len(rows), CAMERA_SIZE))
    turns = turns * Rotation.from_matrix(np.diag((-1.0, -1.0, 1.0)))
    cameras[:, :3], cameras[:, 3:7] = rows[:, 1:4], np.roll(turns.as_quat(), 1, axis=1)
    cameras[1:, 7:10] = np.diff(cameras[:, :3], axis=0) / dt
    cameras[1:, 10:] = (turns[1:] * turns[:-1].inv()).as_rotvec() / dt
    cameras[0, 7:] = cameras[1, 7:]
    return cameras, dt


def fly(scenario: Scenario, name: str, cameras: np.ndarray, seed: int) -> Flight:
    """The path with the estimator ``name`` in a room and with noise of ``seed``."""
    rng, dt = np.random.default_rng(seed), scenario.frame_time
    low, high = cameras[:, :3].min(axis=0) - MARGIN, cameras[:, :3].max(axis=0) + MARGIN
    model, P = PointModel(scenario, np.zeros((0, 2, 3))), start_of(scenario)[1]
    drawn = rng.uniform(low, high, (20_000, 3))
    known = drawn[model.in_view(cameras[0], drawn)][:FIDUCIALS]
    points = np.concatenate((known, rng.uniform(low, high, (POINTS, 3))))
    prior = moved(cameras[0], rng.standard_normal(12) * np.sqrt(P.diagonal()))
    estimator = ESTIMATORS[name](replace(scenario, estimator=name), known, model)
    estimator.reset(prior, P)
    ids = np.concatenate((-1 - np.arange(len(known)), np.zeros(POINTS, int)))
    errors, ratios = [], []
    for camera in cameras[1:]:
        noise = rng.normal(0.0, scenario.pixel_std, (len(points), 2))
        seen = np.flatnonzero(model.in_view(camera, points))
        pixels = np.array([model.predict(camera, points[k])[0] for k in seen]).reshape(-1, 2) + noise[seen]
        estimator.predict(np.zeros(6), dt)
        used = estimator.update(Measurements(pixels, np.tile(model.noise, (len(seen), 1, 1)), ids[seen]))
        found = estimator.estimate()
        ids[seen] = np.where(used != 0, used, ids[seen])
        error, at = camera_error(camera, found.camera), {id: k for k, id in enumerate(found.ids.tolist())}
        pairs = [(points[k], at[id]) for k, id in enumerate(ids.tolist()) if id in at and found.mapped[at[id]]]
        own = [nees(y - found.points[k], found.covariance[12 + 3 * k : 15 + 3 * k, 12 + 3 * k : 15 + 3 * k]) / 3.0
               for y, k in pairs]  # fmt: skip
        parts = [nees(error[part], found.covariance[part, part]) / 3.0 for part in (slice(0, 3), slice(3, 6))]
        errors.append(float(np.linalg.norm(error[:3])))
        ratios.append((*parts, np.mean(own) if own else np.nan))
    return Flight(np.array(errors), np.array(ratios))


def moved(camera: np.ndarray, e: np.ndarray) -> np.ndarray:
    """The camera (13,) shifted by ``e`` (12,) in its tangent."""
    turn = Rotation.from_rotvec(e[3:6]) * Rotation.from_quat(np.roll(camera[3:7], -1))
    return np.concatenate((camera[:3] + e[:3], np.roll(turn.as_quat(), 1), camera[7:] + e[6:]))


def row_of(pixel_std: float, name: str, flights: Sequence[Flight]) -> list[str]:
    """A row of the table: errors without lost flights, and of the NEES the median in time, mean over flights."""
    lost = [bool((one.errors > LOST_POSITION_ERROR).any()) for one in flights]
    kept = [np.mean(one.errors**2) for one, gone in zip(flights, lost) if not gone]
    rms = 100.0 * np.sqrt(np.mean(kept)) if kept else np.nan
    position, orientation, landmarks = np.nanmean([np.nanmedian(one.nees, axis=0) for one in flights], axis=0)
    nees = f"{(position + orientation) / 2.0:.2f}", f"{landmarks:.2f}"
    return [f"{pixel_std:g}", f"`{name}`", f"{rms:.1f}", *nees, f"{sum(lost)} of {len(lost)}"]


def main(arguments: Sequence[str] | None = None) -> None:
    """Fly, and print the table."""
    made = argparse.ArgumentParser(prog="python -m studies.trajectories", description=__doc__)
    made.add_argument("paths", nargs="+", type=Path)
    made.add_argument("--rooms", type=int, default=4, help="for each path and noise")
    made.add_argument("--seed", type=int, default=config.TRAINING_SEED, help="of the first room")
    made.add_argument("--seconds", type=float, default=35.0)
    made.add_argument("--estimators", nargs="+", default=tuple(ESTIMATORS.own), choices=tuple(ESTIMATORS))
    args = made.parse_args(arguments)
    paths, rows = [read_path(path, args.seconds) for path in args.paths], []
    for pixel_std, name in product((1.0, 2.0), args.estimators):
        held = replace(config.SCENARIOS["hand-held"], pixel_std=pixel_std, association=config.KNOWN)
        seeds = range(args.seed, args.seed + args.rooms)
        flights = [fly(replace(held, frame_time=dt), name, path, seed) for path, dt in paths for seed in seeds]
        rows.append(row_of(pixel_std, name, flights))
    print(f"\n{len(paths)} paths, {args.seconds:g} s, rooms from {args.seed}\n\n{table(HEADER, rows)}")


if __name__ == "__main__":
    run(main)
