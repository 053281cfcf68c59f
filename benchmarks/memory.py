"""Bytes of an environment, and whether a long run keeps its size."""

import gc
import re
from pathlib import Path
from typing import Any

import gymnasium

from activeslam_gym import Scenario
from activeslam_gym.envs.simulation import empty_runs

from .report import Bar, Section

NUM_ENVS, FRAMES_PER_STEP = 64, 5


def run(quick: bool) -> Section:
    """Arrays of one environment; growth of the resident set over many frames with autoreset."""
    section = Section("Memory")
    size = _bytes(empty_runs(Scenario(), 1))
    section.rows.append({"what": "arrays of one environment", "value": size / 1024, "unit": "KiB"})
    frames = 50_000 if quick else 1_000_000
    if resident() is None:
        section.notes.append("Growth is skipped: this system has no /proc/self/status.")
        return section
    growth, episodes = _growth(frames)
    section.rows.append({"what": f"growth over {frames:,} frames, {episodes} resets", "value": growth, "unit": "MiB"})
    section.bars.append(Bar(f"growth over {frames:,} frames with autoreset", growth, 8.0, "MiB"))
    section.notes.append(
        f"{NUM_ENVS} environments in one batch, random actions; resident set after the whole less that after a tenth. "
        "8 MiB are allowed to the allocator: a leak of one number a frame would be as much over a million."
    )
    return section


def _bytes(tree: Any) -> int:
    return sum(_bytes(x) if isinstance(x, tuple) else x.nbytes for x in tree)


def resident() -> float | None:
    """Resident set of this process [MiB]."""
    status = Path("/proc/self/status")
    found = re.search(r"VmRSS:\s+(\d+) kB", status.read_text(encoding="utf-8")) if status.exists() else None
    return int(found[1]) / 1024 if found else None


def _growth(frames: int) -> tuple[float, int]:
    """Growth [MiB] over the last nine tenths of ``frames``, and the episodes that ended."""
    env = gymnasium.make_vec("ActiveSLAM-v0", num_envs=NUM_ENVS, gaze_period=0.05 * FRAMES_PER_STEP)
    env.reset(seed=0)
    env.action_space.seed(0)
    steps = frames // (NUM_ENVS * FRAMES_PER_STEP)
    begin, episodes = 0.0, 0
    for step in range(steps):
        if step == steps // 10:
            gc.collect()
            begin = resident() or 0.0
        _, _, terminated, truncated, _ = env.step(env.action_space.sample())
        episodes += int((terminated | truncated).sum())
    gc.collect()
    env.close()
    return (resident() or 0.0) - begin, episodes
