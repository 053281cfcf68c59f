"""Bytes of an environment, and whether a long run keeps its size."""

import gc
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import VectorEnv

from activeslam_gym import Scenario
from activeslam_gym.envs.simulation import empty_runs

from .report import Bar, Section

NUM_ENVS, FRAMES_PER_STEP = 64, 5


def run(quick: bool) -> Section:
    """Arrays of one environment; growth of the resident set over many frames with autoreset."""

    def size(tree: Any) -> int:
        return sum(size(x) if isinstance(x, tuple) else x.nbytes for x in tree)

    section, frames = Section("Memory"), 50_000 if quick else 1_000_000
    arrays = size(empty_runs(Scenario(), 1)) / 1024
    section.rows.append({"what": "arrays of one environment", "value": arrays, "unit": "KiB"})
    if resident() is None:
        section.notes.append("Growth is skipped: this system has no /proc/self/status.")
        return section
    env = gymnasium.make_vec("ActiveSLAM-v0", num_envs=NUM_ENVS, gaze_period=0.05 * FRAMES_PER_STEP)
    steps = frames // (NUM_ENVS * FRAMES_PER_STEP)
    env.reset(seed=0)
    env.action_space.seed(0)
    episodes, before = fly(env, steps // 10), resident() or 0.0
    episodes += fly(env, steps - steps // 10)
    env.close()
    growth = (resident() or 0.0) - before
    section.rows.append({"what": f"growth over {frames:,} frames, {episodes} resets", "value": growth, "unit": "MiB"})
    section.bars.append(Bar(f"growth over {frames:,} frames with autoreset", growth, 8.0, "MiB"))
    section.notes.append(
        f"{NUM_ENVS} environments in one batch, random actions; resident set after the whole less that after a tenth. "
        "8 MiB are allowed to the allocator: a leak of one number a frame would be as much over a million."
    )
    return section


def resident() -> float | None:
    """Resident set of this process [MiB] after a garbage collection; None where the system does not tell it."""
    gc.collect()
    status = Path("/proc/self/status")
    found = re.search(r"VmRSS:\s+(\d+) kB", status.read_text(encoding="utf-8")) if status.exists() else None
    return int(found[1]) / 1024 if found else None


def fly(env: VectorEnv, steps: int) -> int:
    """Take random actions; the episodes that ended. Raises ArithmeticError where a number is not finite."""
    episodes = 0
    for _ in range(steps):
        observation, reward, terminated, truncated, infos = env.step(env.action_space.sample())
        numbers = [("observation", observation), ("reward", reward), *_numbers(infos)]
        if broken := [name for name, value in numbers if not np.isfinite(value).all()]:
            raise ArithmeticError(f"not finite: {', '.join(broken)}")
        episodes += int((terminated | truncated).sum())
    return episodes


def _numbers(infos: dict[str, Any]) -> Iterator[tuple[str, np.ndarray]]:
    """Every array in infos by its name; an RMSE is inf until a landmark is mapped."""
    for name, value in infos.items():
        if isinstance(value, dict):
            yield from _numbers(value)
        else:
            yield name, np.where(np.isposinf(value), 0.0, value) if name == "landmark_rmse" else value
