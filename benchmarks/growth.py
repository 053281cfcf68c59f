"""How the cost grows with the map: predict + update with as many features seen, entropy apart."""

from functools import partial

import numpy as np

from activeslam_gym.linalg import log2_det

from .report import Bar, Section
from .setups import SEEN, demand_matches, filter_frames, mapped_runs
from .timing import repeated

SIZES = [30, 100, 300]


def run(quick: bool) -> Section:
    """Time by landmarks, and fitted exponents."""
    section = Section("Growth with the map")
    frames, repeats, at_least = (5, 3, 0.01) if quick else (20, 9, 0.2)
    seconds = []
    for landmarks in SIZES:
        runs = mapped_runs(landmarks)
        filtering = repeated(partial(filter_frames, runs, frames), repeats, at_least) / frames
        demand_matches(runs, landmarks)
        dim = 12 + 3 * landmarks
        P = np.ascontiguousarray(runs.ekf.covariance[0, :dim, :dim])
        entropy = repeated(partial(log2_det, P), repeats, at_least)
        seconds.append([np.median(filtering), np.median(entropy)])
        times = dict(zip(("predict + update [µs]", "entropy [µs]"), 1e6 * np.array(seconds[-1])))
        section.rows.append({"landmarks": landmarks, "n": dim, **times})
    of_filter, of_entropy = np.polyfit(np.log(SIZES), np.log(seconds), 1)[0].tolist()
    section.bars.append(Bar("predict + update, exponent of growth from 30 to 300 landmarks", of_filter, 2.0, ""))
    section.notes.append(
        f"Fitted slope of log time on log landmarks: predict + update {of_filter:.2f}, entropy {of_entropy:.2f}. "
        f"Point features, {SEEN} seen, {frames} frames in one compiled loop; entropy is log2 |P| by Cholesky."
    )
    return section
