"""One environment, batches, images and scores, in the middle of a sweep."""

from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from itertools import product
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import SyncVectorEnv, VectorEnv

from .setups import END, WARM_UP, repeated, sweep, swept

PEER_BATCH = 64
"""Environments of the wrapped batch."""
Part = tuple[list[dict[str, Any]], str]


def single(quick: bool) -> Part:
    """`env.step` through `gymnasium.make`."""
    rows, repeats = [], 2 if quick else 7
    for gaze_period in (0.05, 0.25):
        seconds = np.array([step_time(gaze_period, 100 * seed) for seed in range(repeats)])
        time, frames = np.median(seconds), round(gaze_period / 0.05)
        rows.append({
            "gaze_period [s]": gaze_period,
            "step [µs]": 1e6 * time,
            "fastest … slowest [µs]": f"{1e6 * seconds.min():.0f} … {1e6 * seconds.max():.0f}",
            "frames/s": frames / time,
        })  # fmt: skip
    return rows, f"From {WARM_UP} s to {END} s of `sweep`, median of {repeats} seeds."


def step_time(gaze_period: float, seed: int) -> float:
    """One step's time, with its share of `info` [s]."""
    env = swept(seed, gaze_period)
    seconds = sweep(env, gaze_period, WARM_UP, END)
    env.close()
    return float(seconds.mean()) * gaze_period


def batches(quick: bool) -> Part:
    """Frames per second of the batch by size and threads, and as a ratio to Gymnasium's wrapper over the single one."""
    rows, peer = [], 16 if quick else PEER_BATCH
    sizes, threads = ((1, 16), (1,)) if quick else ((1, 16, 64, 256, 1024), (1, 2))
    for period in (0.25,) if quick else (0.25, 0.05):
        make = partial(gymnasium.make, "ActiveSLAM-v0", gaze_period=period)
        build: dict[tuple[str, int, Any], Callable[[], VectorEnv]] = {
            ("SyncVectorEnv", peer, ""): partial(SyncVectorEnv, [make] * peer)
        }
        for size, count in product(sizes, threads):
            native = partial(gymnasium.make_vec, "ActiveSLAM-v0", size, gaze_period=period, num_threads=count)
            build["native", size, count] = native
        rates = {key: frame_rate(one(), period) for key, one in build.items()}
        for (what, size, count), rate in rates.items():
            row = {"what": what, "environments": size, "gaze_period [s]": period, "threads": count}
            ratio = rate / rates["SyncVectorEnv", peer, ""]
            rows.append({**row, "frames/s": rate, "ratio to SyncVectorEnv": ratio})
    return rows, f"From {WARM_UP} s to {END} s of `sweep`, median of the seconds."


def frame_rate(env: VectorEnv, period: float) -> float:
    """Frames of all environments per second, after `WARM_UP` of sweep; median over the seconds from then on."""
    env.reset(seed=1)
    seconds = sweep(env, period, 0, END)[WARM_UP:]
    env.close()
    return env.num_envs * round(1.0 / period) * round(period / 0.05) / float(np.median(seconds))


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
    rows, env = [], swept(0)
    inner = env.unwrapped
    calls = {
        "7 motion scores": inner.motion_scores,
        "21 joint scores": inner.joint_scores,
        "3 gaze scores": inner.gaze_scores,
        "lookahead, 2 motions": inner.lookahead_scores,
    }
    for name, call in calls.items():
        times = 1e3 * repeated(call, 3 if quick else 9, 0.02 if quick else 0.2)
        rows.append({"scores": name, "time [ms]": np.median(times), "fastest [ms]": times.min()})
    note = f"After 20 s of `sweep`, {len(inner.belief.ids)} features; called from Python, default criteria."
    env.close()
    return rows, note
