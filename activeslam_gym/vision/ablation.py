"""The same sequence with parts of the front end left out, side by side: the effect of each part."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from activeslam_gym.files import text_of
from activeslam_gym.vision.frontend import FrontEndSettings
from activeslam_gym.vision.other_lenses import lens_from
from activeslam_gym.vision.sources import open_images
from activeslam_gym.vision.target import read_target
from activeslam_gym.vision.track import Track, follow

VARIANTS: dict[str, dict[str, Any]] = {
    "full": {},
    "no warp": {"warp": False},
    "no sub-pixel": {"subpixel": False},
    "no appearance": {"appearance": False},
    "no recovery": {"recover": False},
}
"""Fields of `FrontEndSettings` for each variant."""
_LONGEST = 2**26  # characters of a reference: hours of poses


def ablate(
    images: str | Path,
    calibration: str | Path,
    target: str | Path,
    rate: float,
    reference: str | Path | None,
    every: int,
) -> Iterator[str]:
    """Track ``images`` once for each variant, of which every ``every``-th image is used: a line of a table for each.

    ``reference``: a trajectory in TUM's format, camera-to-world, or None.

    Raises:
        SourceError, ValueError, OSError: as `track.follow` and the readers of files do.
    """
    if every < 1:
        raise ValueError(f"every must be a whole number of 1 or more, got {every!r}")
    (lens, straighten), known = lens_from(calibration), read_target(target)
    truth = None if reference is None else _positions(Path(reference))
    for variant, without in VARIANTS.items():
        chosen = map(straighten, islice(open_images(images, rate), 0, None, every))
        done = follow(chosen, lens, known, rate / every, replace(FrontEndSettings(), **without))
        yield _line(variant, done, truth)


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


def _line(variant: str, done: Track, reference: np.ndarray | None) -> str:
    """Of one variant: RMSE of the positions at the times of the ``reference``, share and number of the searched
    features that were matched, and the time of an image."""
    numbers = [(log.searched, log.matched, log.milliseconds) for log in done.logs]
    searched, matched, times = np.array(numbers, float).reshape(-1, 3).T
    error, count = "-", 0
    if reference is not None:
        nearest = np.abs(reference[:, :1] - done.times).argmin(axis=1)
        there = np.abs(reference[:, 0] - done.times[nearest]) < 1e-3
        count = int(there.sum())
    if reference is not None and count:
        rmse = aligned_rmse(done.cameras[nearest[there], :3], reference[there, 1:]) if count >= 3 else np.nan
        error = f"{100 * rmse:6.2f} cm over {count}"
    return (
        f"{variant:14} {error:22} matched {matched.sum() / max(searched.sum(), 1):4.0%} of {searched.mean():4.1f} an "
        f"image, 99th percentile {np.percentile(times, 99):5.1f} ms"
    )


def aligned_rmse(positions: np.ndarray, reference: np.ndarray) -> float:
    """RMSE [m] of ``positions`` (n, 3) from the ``reference`` (n, 3) after the best rotation and shift, no scale."""
    a, b = positions - positions.mean(axis=0), reference - reference.mean(axis=0)
    return float(Rotation.align_vectors(b, a)[1] / np.sqrt(len(a)))
