"""From nothing to the first step: the import, the first run that compiles, and the next that need not."""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from .report import Bar, Section
from .timing import summary

_IMPORT = "import time; t = time.perf_counter(); import activeslam_gym; print(time.perf_counter() - t)"
_START = """
import json, time
t = [time.perf_counter()]
def lap(): t.append(time.perf_counter())
import gymnasium, activeslam_gym; lap()
env = gymnasium.make("ActiveSLAM-v0"); lap()
env.reset(seed=0); lap()
env.step(env.action_space.sample()); lap()
print(json.dumps([b - a for a, b in zip(t, t[1:])]))
"""


def run(quick: bool) -> Section:
    """Times of fresh processes; compiling is left out if ``quick``."""
    section = Section("Start")
    alone = summary([float(_fresh(_IMPORT)) for _ in range(3 if quick else 7)])
    section.rows.append(_row("import activeslam_gym", [alone.seconds]))
    if quick:
        section.notes.append("First-run compilation is skipped in a quick run.")
        return section
    with tempfile.TemporaryDirectory() as cache:
        first = json.loads(_fresh(_START, cache))
        kernels = len(list(Path(cache).rglob("*.nbc")))
        if kernels == 0:
            raise RuntimeError(f"nothing was compiled into the empty cache {cache}")
        cached = sorted((json.loads(_fresh(_START, cache)) for _ in range(5)), key=sum)[2]
        if len(list(Path(cache).rglob("*.nbc"))) != kernels:
            raise RuntimeError("a cached start compiled something")
    section.rows += [_row("first run, empty cache", first), _row("cached", cached)]
    section.bars += [
        Bar("first run, compilation included", sum(first), 30.0, "s"),
        Bar("cached start: import, make, reset, first step", sum(cached), 2.0, "s"),
    ]
    section.notes.append(
        f"Fresh processes, median of 5 (the first run: one). It filled an empty NUMBA_CACHE_DIR with {kernels} files "
        "of kernels; the cached starts added none."
    )
    return section


def _row(what: str, laps: list[float]) -> dict:
    names = ("import [s]", "make [s]", "reset [s]", "first step [s]")
    return {"what": what, **dict(zip(names, [*laps, "", "", ""])), "total [s]": float(sum(laps))}


def _fresh(code: str, cache: str | None = None) -> str:
    """What ``code`` prints last in a fresh process, with ``cache`` as Numba's."""
    environment = {**os.environ, **({"NUMBA_CACHE_DIR": cache} if cache else {})}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(done.stderr)
    return done.stdout.strip().splitlines()[-1]
