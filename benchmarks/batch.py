"""Many environments: the native batch by size and threads, Gymnasium's wrappers over the single one, CartPole."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AsyncVectorEnv, SyncVectorEnv, VectorEnv

from .report import Bar, Section
from .setups import WARM_UP, sweep_action
from .timing import summary, timed

PEER_BATCH, PROCESSES = 64, 8
"""Environments of the wrapped batch; of the one in processes, which would only queue for the cores if it had more."""


def run(quick: bool) -> Section:
    """Frames per second of everything, as a ratio to `SyncVectorEnv` too."""
    section = Section("Batches")
    sizes, threads = ((1, 16), (1,)) if quick else ((1, 16, 64, 256, 1024), (1, 2))
    periods = (0.25,) if quick else (0.25, 0.05)
    peer = 16 if quick else PEER_BATCH
    rates: dict[tuple[str, int, float, Any], float] = {}
    for period in periods:
        rates["SyncVectorEnv", peer, period, ""] = frame_rate(SyncVectorEnv([_single(period)] * peer), period)
        if not quick:
            make = [_single(period)] * PROCESSES
            rates["AsyncVectorEnv", PROCESSES, period, ""] = frame_rate(AsyncVectorEnv(make), period)
        for size in sizes:
            for count in threads:
                batch = gymnasium.make_vec("ActiveSLAM-v0", num_envs=size, gaze_period=period, num_threads=count)
                rates["native", size, period, count] = frame_rate(batch, period)
    for (what, size, period, count), rate in rates.items():
        section.rows.append(
            {
                "what": what,
                "environments": size,
                "gaze_period [s]": period,
                "threads": count,
                "frames/s": rate,
                "ratio to SyncVectorEnv": rate / rates["SyncVectorEnv", peer, period, ""],
            }
        )
    bar = rates.get(("native", 64, 0.25, 2))
    if bar is not None:
        section.bars.append(Bar("64 environments, 2 threads, gaze_period 0.25", bar, 3e4, "frames/s", at_least=True))
    section.notes.append(f"From 20 s to 34 s of `sweep`, median of the seconds. {_cartpole()}")
    return section


def _single(period: float) -> Callable[[], gymnasium.Env]:
    return lambda: gymnasium.make("ActiveSLAM-v0", gaze_period=period)


def frame_rate(env: VectorEnv, period: float) -> float:
    """Frames of all environments per second, after `WARM_UP` of sweep; median over the seconds from then on."""
    per_second = round(1.0 / period)
    env.reset(seed=1)

    def second(number: int) -> None:
        for step in range(number * per_second, (number + 1) * per_second):
            env.step(np.tile(sweep_action(step, per_second), (env.num_envs, 1)))

    warm = round(WARM_UP)
    for number in range(warm):
        second(number)
    times = summary([timed(lambda number=number: second(number)) for number in range(warm, 34)])  # type: ignore[misc]
    rate = env.num_envs * per_second * round(period / 0.05) / times.seconds
    env.close()
    return rate


def _cartpole() -> str:
    env = gymnasium.make_vec("CartPole-v1", num_envs=1024, vectorization_mode="vector_entry_point")
    env.reset(seed=0)
    actions = np.arange(1024) % 2

    def play() -> None:
        for _ in range(200):
            env.step(actions)

    rate = 200 * 1024 / summary([timed(play) for _ in range(3)]).seconds
    return f"For scale: 1024 CartPole-v1 in Gymnasium's own batch, {rate:,.0f} steps/s."
