"""How the cost grows with the map: predict + update with as many features seen, entropy apart."""

from functools import partial

import numpy as np

from activeslam_gym.linalg import log2_det

from .filtering import PointFilter
from .report import Bar, Section
from .setups import SEEN
from .timing import repeated, slope

SIZES = [30, 100, 300]


def run(quick: bool) -> Section:
    """Time by landmarks, and fitted exponents."""
    section = Section("Growth with the map")
    steps, entropies = [], []
    frames, repeats, at_least = (5, 3, 0.01) if quick else (20, 9, 0.2)
    for landmarks in SIZES:
        points = PointFilter(landmarks)
        steps.append(repeated(partial(points.run, frames), repeats, at_least).seconds / frames)
        dim = int(points.belief.state.dim)
        P = np.ascontiguousarray(points.belief.covariance[:dim, :dim])
        entropies.append(repeated(partial(log2_det, P), repeats, at_least).seconds)
        times = {"predict + update [µs]": 1e6 * steps[-1], "entropy [µs]": 1e6 * entropies[-1]}
        section.rows.append({"landmarks": landmarks, "n": dim, **times})
    of_steps, of_entropies = slope(SIZES, steps), slope(SIZES, entropies)
    section.bars.append(Bar("predict + update, exponent of growth from 30 to 300 landmarks", of_steps, 2.0, ""))
    section.notes.append(
        f"Fitted slope of log time on log landmarks: predict + update {of_steps:.2f}, entropy {of_entropies:.2f}. "
        f"Point features, {SEEN} seen, {frames} frames in one compiled loop; entropy is log2 |P| by Cholesky."
    )
    return section
