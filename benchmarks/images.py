"""``ActiveSLAMPixels-v0``: one environment, and a batch, in the first seconds of a sweep."""

from importlib.util import find_spec
from typing import Any

import gymnasium
import numpy as np

from .report import Bar, Section
from .setups import sweep

PERIOD = 0.25  # of the gaze [s]
BATCH = 8


def run(quick: bool) -> Section:
    """Frames per second, of one environment on one thread and of a batch on two."""
    section = Section("Images")
    if not find_spec("cv2"):
        section.notes.append("Images are skipped: OpenCV is not installed (`pip install -e '.[vision]'`).")
        return section
    begin, end = (1, 3) if quick else (2, 16)
    for count, threads, bar in ((1, 1, 350.0), (BATCH, 2, 480.0)):
        env: Any = gymnasium.make_vec("ActiveSLAMPixels-v0", count, gaze_period=PERIOD, num_threads=threads)
        env.reset(seed=1)
        seconds = sweep(env, PERIOD, 0, end)[begin:]
        frames = count / env.unwrapped.setting.scenario.frame_time / seconds
        env.close()
        rate = float(np.median(frames))
        slowest, fastest = frames.min(), frames.max()
        section.rows.append({
            "environments": count,
            "threads": threads,
            "frames/s": rate,
            "slowest … fastest": f"{slowest:.0f} … {fastest:.0f}",
        })  # fmt: skip
        what = f"images, {count} environment{'s' * (count > 1)}, {threads} thread{'s' * (threads > 1)}"
        section.bars.append(Bar(what, rate, bar, "frames/s", at_least=True))
    section.notes.append(f"`pixels` from {begin} s to {end} s of `sweep`, median of the seconds.")
    return section
