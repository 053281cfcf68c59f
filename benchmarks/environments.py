"""Environments, images and scores, in the middle of a sweep."""

from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from itertools import product
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import SyncVectorEnv

from .setups import END, WARM_UP, repeated, sweep

PEER_BATCH = 64
"""Environments of the wrapped batch."""
Part = tuple[list[dict[str, Any]], str]


def batches(quick: bool) -> Part:
    """Frames per second of one environment and of the batch by size and threads, and as a ratio to Gymnasium's wrapper
    over single ones."""
    rows, peer = [], 16 if quick else PEER_BATCH
    sizes, threads = ((1, 16), (1,)) if quick else ((1, 16, 64, 256, 1024), (1, 2))
    for period in (0.25,) if quick else (0.25, 0.05):
        given: dict[str, Any] = {"id": "ActiveSLAM-v0", "gaze_period": period, "end_when_lost": False}
        make = partial(gymnasium.make, **given)
        build: dict[tuple[str, int, Any], Callable[[], Any]] = {
            ("SyncVectorEnv", peer, ""): partial(SyncVectorEnv, [make] * peer),
            ("gymnasium.make", 1, ""): make,
        }
        for size, count in product(sizes, threads):
            build["native", size, count] = partial(gymnasium.make_vec, num_envs=size, num_threads=count, **given)
        rates = {key: key[1] * frame_rate(one(), period) for key, one in build.items()}
        for (what, size, count), rate in rates.items():
            row = {"what": what, "environments": size, "gaze_period [s]": period, "threads": count}
            ratio = rate / rates["SyncVectorEnv", peer, ""]
            rows.append({**row, "frames/s": rate, "ratio to SyncVectorEnv": ratio})
    return rows, f"From {WARM_UP} s to {END} s of `sweep`, median of the seconds."


def frame_rate(env: Any, period: float) -> float:
    """Frames of each environment per second, after `WARM_UP` of sweep; median over the seconds from then on."""
    env.reset(seed=1)
    seconds = sweep(env, period, 0, END)[WARM_UP:]
    env.close()
    return round(1.0 / period) * round(period / 0.05) / float(np.median(seconds))


def images(quick: bool) -> Part:
    """Frames per second of `ActiveSLAMPixels-v0`, of one environment on one thread and of a batch on two."""
    rows: list[dict[str, Any]] = []
    if not find_spec("cv2"):
        return rows, "Images are skipped: OpenCV is not installed (`pip install -e '.[vision]'`)."
    begin, end = (1, 3) if quick else (2, 16)
    for count, threads in ((1, 1), (8, 2)):
        env: Any = gymnasium.make_vec("ActiveSLAMPixels-v0", count, gaze_period=0.25, num_threads=threads)
        env.reset(seed=1)
        frames = count / env.unwrapped.setting.scenario.frame_time / sweep(env, 0.25, 0, end)[begin:]
        env.close()
        spread = f"{frames.min():.0f} … {frames.max():.0f}"
        rate = float(np.median(frames))
        rows.append({"environments": count, "threads": threads, "frames/s": rate, "slowest … fastest": spread})
    return rows, f"`pixels` from {begin} s to {end} s of `sweep`, median of the seconds."


def scores(quick: bool) -> Part:
    """Each set of scores, called as a policy calls it."""
    rows, env = [], gymnasium.make("ActiveSLAM-v0", gaze_period=0.05, end_when_lost=False)
    env.reset(seed=0)
    sweep(env, 0.05, 0, WARM_UP)
    inner: Any = env.unwrapped
    calls = {
        "7 motion scores": inner.motion_scores,
        "21 joint scores": inner.joint_scores,
        "3 gaze scores": inner.gaze_scores,
        "lookahead, 2 motions": inner.lookahead_scores,
    }
    for name, call in calls.items():
        times = 1e3 * repeated(call, 3 if quick else 9, 0.02 if quick else 0.2)
        rows.append({"scores": name, "time [ms]": np.median(times), "fastest [ms]": times.min()})
    note = f"After {WARM_UP} s of `sweep`, {len(inner.belief.ids)} features; called from Python, default criteria."
    env.close()
    return rows, note
