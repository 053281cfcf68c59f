"""The same sequence with parts of the front end left out, side by side: what each of them gives."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from activeslam_gym.files import text_of
from activeslam_gym.vision.calibration import read_calibration
from activeslam_gym.vision.frontend import FrontEndSettings
from activeslam_gym.vision.sources import Frame, open_images
from activeslam_gym.vision.target import read_target
from activeslam_gym.vision.track import Track, follow

VARIANTS: dict[str, dict[str, Any]] = {
    "full": {},
    "no warp": {"warp": False},
    "no sub-pixel": {"subpixel": False},
    "no appearance": {"appearance": False},
    "no recovery": {"recover": False},
}
"""What each variant leaves out: fields of `FrontEndSettings`."""


_LONGEST = 2**26
"""Characters of a reference: hours of poses."""


class Outcome(NamedTuple):
    """One variant."""

    variant: str
    matched: float
    """Share of the searched features."""
    searched: float
    """Features an image, mean."""
    milliseconds: float
    """Of an image, 99th percentile."""
    error: float
    """RMSE of the positions after a rotation and a shift [m]: NaN without a reference."""
    images: int
    """Compared with the reference."""


def ablate(
    images: str | Path,
    calibration: str | Path,
    target: str | Path,
    rate: float,
    reference: str | Path | None,
    every: int,
) -> Iterator[Outcome]:
    """Track ``images`` once for each variant, of which every ``every``-th image is used.

    ``reference``: a trajectory in TUM's format, camera-to-world, or None.

    Raises:
        SourceError, ValueError, OSError: as `track.follow` and the readers of files do.
    """
    if every < 1:
        raise ValueError(f"every must be a whole number of 1 or more, got {every!r}")
    lens, rectangle = read_calibration(calibration), read_target(target)
    known = None if reference is None else _positions(Path(reference))
    for variant, without in VARIANTS.items():
        chosen = _every(open_images(images, rate), every)
        done = follow(chosen, lens, rectangle, rate / every, replace(FrontEndSettings(), **without))
        yield _outcome(variant, done, known)


def _every(frames: Iterator[Frame], every: int) -> Iterator[Frame]:
    """The first of them and every ``every``-th."""
    return (frame for k, frame in enumerate(frames) if k % every == 0)


def _positions(path: Path) -> np.ndarray:
    """(n, 4) times [s] and positions [m] of a file in TUM's format."""
    lines = text_of(path, _LONGEST).splitlines()
    try:
        rows = np.loadtxt(lines, ndmin=2)
    except ValueError as error:
        raise ValueError(f"{path} is no trajectory in TUM's format: {error}") from None
    if rows.shape[1] != 8 or len(rows) < 3:
        raise ValueError(f"{path} must have 3 lines or more of 8 numbers: t tx ty tz qx qy qz qw")
    return rows[:, :4]


def _outcome(variant: str, done: Track, reference: np.ndarray | None) -> Outcome:
    searched, matched = (np.array([getattr(log, name) for log in done.logs]) for name in ("searched", "matched"))
    slowest = float(np.percentile([log.milliseconds for log in done.logs], 99))
    error, count = np.nan, 0
    if reference is not None:
        nearest = np.abs(reference[:, :1] - done.times).argmin(axis=1)
        there = np.abs(reference[:, 0] - done.times[nearest]) < 1e-3
        count = int(there.sum())
        error = aligned_rmse(done.cameras[nearest[there], :3], reference[there, 1:]) if count >= 3 else np.nan
    return Outcome(variant, matched.sum() / max(searched.sum(), 1), float(searched.mean()), slowest, error, count)


def aligned_rmse(positions: np.ndarray, reference: np.ndarray) -> float:
    """RMSE [m] of ``positions`` (n, 3) from the ``reference`` (n, 3) after the best rotation and shift, no scale."""
    a, b = positions - positions.mean(axis=0), reference - reference.mean(axis=0)
    U, _, Vt = np.linalg.svd(a.T @ b)
    R = U @ np.diag((1.0, 1.0, np.linalg.det(U @ Vt))) @ Vt
    return float(np.sqrt(((a @ R - b) ** 2).sum(axis=1).mean()))


def line_of(outcome: Outcome) -> str:
    """A line of the table."""
    error = f"{100 * outcome.error:6.2f} cm over {outcome.images}" if outcome.images else "-"
    return (
        f"{outcome.variant:14} {error:22} matched {outcome.matched:4.0%} of {outcome.searched:4.1f} an image, "
        f"99th percentile {outcome.milliseconds:5.1f} ms"
    )
