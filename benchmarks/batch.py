"""Many environments: the native batch by size and threads, Gymnasium's wrappers over the single one, CartPole."""

from collections.abc import Callable
from functools import partial
from itertools import product
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AsyncVectorEnv, SyncVectorEnv, VectorEnv

from .report import Bar, Section
from .setups import END, WARM_UP, sweep
from .timing import timed

PEER_BATCH, PROCESSES = 64, 8
"""Environments of the wrapped batch; of the one in processes, which would only queue for the cores if it had more."""


def run(quick: bool) -> Section:
    """Frames per second of everything, as a ratio to `SyncVectorEnv` too."""
    section = Section("Batches")
    sizes, threads = ((1, 16), (1,)) if quick else ((1, 16, 64, 256, 1024), (1, 2))
    peer = 16 if quick else PEER_BATCH
    for period in (0.25,) if quick else (0.25, 0.05):
        make = partial(gymnasium.make, "ActiveSLAM-v0", gaze_period=period)
        build: dict[tuple[str, int, Any], Callable[[], VectorEnv]] = {
            ("SyncVectorEnv", peer, ""): partial(SyncVectorEnv, [make] * peer)
        }
        if not quick:
            build["AsyncVectorEnv", PROCESSES, ""] = partial(AsyncVectorEnv, [make] * PROCESSES)
        for size, count in product(sizes, threads):
            native = partial(gymnasium.make_vec, "ActiveSLAM-v0", size, gaze_period=period, num_threads=count)
            build["native", size, count] = native
        rates = {key: frame_rate(one(), period) for key, one in build.items()}
        for (what, size, count), rate in rates.items():
            row = {"what": what, "environments": size, "gaze_period [s]": period, "threads": count}
            ratio = rate / rates["SyncVectorEnv", peer, ""]
            section.rows.append({**row, "frames/s": rate, "ratio to SyncVectorEnv": ratio})
        if period == 0.25 and ("native", 64, 2) in rates:
            bar = "64 environments, 2 threads, gaze_period 0.25"
            section.bars.append(Bar(bar, rates["native", 64, 2], 3e4, "frames/s", at_least=True))
    section.notes.append(f"From {WARM_UP} s to {END} s of `sweep`, median of the seconds. {_cartpole()}")
    return section


def frame_rate(env: VectorEnv, period: float) -> float:
    """Frames of all environments per second, after `WARM_UP` of sweep; median over the seconds from then on."""
    env.reset(seed=1)
    seconds = sweep(env, period, 0, END)[WARM_UP:]
    env.close()
    return env.num_envs * round(1.0 / period) * round(period / 0.05) / float(np.median(seconds))


def _cartpole() -> str:
    env = gymnasium.make_vec("CartPole-v1", num_envs=1024, vectorization_mode="vector_entry_point")
    env.reset(seed=0)
    actions = np.arange(1024) % 2

    def play() -> None:
        for _ in range(200):
            env.step(actions)

    rate = 200 * 1024 / np.median([timed(play) for _ in range(3)])
    return f"For scale: 1024 CartPole-v1 in Gymnasium's own batch, {rate:,.0f} steps/s."
