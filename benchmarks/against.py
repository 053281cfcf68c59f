"""The start of fresh processes, and `python -m benchmarks --against COMMIT`: another commit and this checkout in turn.

As a script it measures the packages that are imported, by what every commit offers to users, and answers with a JSON
object.
"""

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from timeit import repeat
from typing import Any

ROOT = Path(__file__).parents[1]
PAIRS = 5
IMPORT = "processor time of the import [s]"
FIRST = (
    "processor time to the first step [s]",
    "then to the first decision of mi-fisher [s]",
    "then to the first image [s]",
)
"""Figures of the first run alone, with nothing compiled."""
STARTS = (IMPORT, *FIRST)
Figures = dict[str, float]


def compare(commit: str, pairs: int = PAIRS) -> str:
    """A table of this checkout's figures over those of a ``commit``: medians of ``pairs`` runs, each of both in turn,
    and the median, least and greatest of their ratios.

    Raises:
        ValueError: there is no such commit.
    """
    with tempfile.TemporaryDirectory() as folder:
        other = Path(folder, "checkout")
        added = subprocess.run(
            ["git", "-C", str(ROOT), "worktree", "add", "--detach", str(other), commit], capture_output=True, text=True
        )
        if added.returncode:
            raise ValueError(f"--against must name a commit, got {commit!r}: {added.stderr.strip()}")
        try:
            runs = [(run_in(other, Path(folder, "other")), run_in(ROOT, Path(folder, "this"))) for _ in range(pairs)]
        finally:
            subprocess.run(["git", "-C", str(ROOT), "worktree", "remove", "--force", str(other)], check=True)
    from agents.tools.sections import table

    rows = []
    for name in runs[0][0]:
        found = [(other[name], this[name]) for other, this in (runs[:1] if name in FIRST else runs)]
        ratios = sorted(this / other for other, this in found)
        others, these = (statistics.median(one) for one in zip(*found, strict=True))
        spread = f"{ratios[0]:.2f}, {ratios[-1]:.2f}" if len(ratios) > 1 else ""
        rows.append([name, f"{others:.4g}", f"{these:.4g}", f"{statistics.median(ratios):.2f}", spread])
    return table(["", commit, "this", "ratio", "least, most"], rows)


def run_in(checkout: Path, kernels: Path) -> Figures:
    """The figures of a ``checkout``, in a process that keeps its ``kernels`` in a folder of its own."""
    taken = {"OPENBLAS_CORETYPE", "OPENBLAS_L2_SIZE"}  # they slow BLAS down
    environment = {name: value for name, value in os.environ.items() if name not in taken}
    environment |= {"PYTHONPATH": str(checkout), "NUMBA_CACHE_DIR": str(kernels)}
    command = [sys.executable, str(Path(__file__))]
    done = subprocess.run(command, cwd=checkout, env=environment, check=True, stdout=subprocess.PIPE, text=True)
    figures: Figures = json.loads(done.stdout.splitlines()[-1])
    return figures


def start(quick: bool) -> tuple[list[dict[str, Any]], str]:
    """The first run, with nothing compiled, and the next one; nothing if ``quick``."""
    with tempfile.TemporaryDirectory() as folder:
        runs = [run_in(ROOT, Path(folder)) for _ in range(0 if quick else 2)]
    rows = [{"what": name, **dict(zip(("first run", "next run"), (run[name] for run in runs)))} for name in STARTS]
    return rows if runs else [], "Fresh processes; the first one has an empty folder of kernels."


def measure() -> Figures:
    """The figures of the packages that are imported; the first are those of an empty cache, if it is."""
    begin = time.process_time()
    import gymnasium as gym
    import numpy as np

    import activeslam_gym  # noqa: F401 (registers the environments)
    import baselines

    figures, seen = {IMPORT: time.process_time() - begin}, [begin]

    def first(name: str) -> None:
        figures[name], seen[0] = time.process_time() - seen[0], time.process_time()

    env: Any = gym.make("ActiveSLAM-v0", scenario="paper")
    observation, _ = env.reset(seed=1)
    env.step(np.array((1, 1)))
    first(FIRST[0])
    policy = baselines.make("mi-fisher", env)
    policy.predict(observation)
    first(FIRST[1])
    images: Any = gym.make("ActiveSLAMPixels-v0", scenario="pixels")
    images.reset(seed=1)
    images.step(np.array((1, 1)))
    first(FIRST[2])

    batch: Any = gym.make_vec("ActiveSLAM-v0", num_envs=64, scenario="paper", num_threads=1)
    batch.reset(seed=1)
    rng = np.random.default_rng(1)

    def stepped(world: Any, shape: tuple[int, ...] = ()) -> Callable[[], Any]:
        return lambda: world.step(np.stack((rng.integers(0, 7, shape), rng.integers(0, 3, shape)), axis=-1))

    for name, call, count in (
        ("a step of one environment [ms]", stepped(env), 30),
        ("a step of 64 environments, one thread [ms]", stepped(batch, (64,)), 20),
        ("a decision of mi-fisher [ms]", lambda: policy.predict(observation), 30),
        ("a step with images [ms]", stepped(images), 10),
    ):
        figures[name] = 1e3 * statistics.median(repeat(call, number=1, repeat=count))
    return figures


if __name__ == "__main__":
    print(json.dumps(measure()))
