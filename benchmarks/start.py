"""From nothing to the first step: the import, the first run that compiles, and the next that need not."""

import json
import os
import subprocess
import sys
import tempfile
from typing import Any

import numpy as np

_IMPORT = "import time; t = time.perf_counter(); import activeslam_gym; print([time.perf_counter() - t])"
_START = """
import json, time
t = [time.perf_counter()]
def lap(): t.append(time.perf_counter())
import gymnasium, activeslam_gym; lap()
env = gymnasium.make("ActiveSLAM-v0", gaze_period=0.05); lap()
env.reset(seed=0); lap()
env.step(env.action_space.sample()); lap()
print(json.dumps([b - a for a, b in zip(t, t[1:])]))
"""
LAPS = ("import [s]", "make [s]", "reset [s]", "first step [s]")


def run(quick: bool) -> tuple[list[dict[str, Any]], str]:
    """Times of fresh processes; compiling is left out if ``quick``."""
    laps = {"import activeslam_gym": list(np.median([_fresh(_IMPORT) for _ in range(3 if quick else 7)], axis=0))}
    if not quick:
        with tempfile.TemporaryDirectory() as cache:
            laps["first run, empty cache"] = _fresh(_START, cache)
            laps["cached"] = sorted((_fresh(_START, cache) for _ in range(5)), key=sum)[2]
    rows = [
        {"what": what, **dict.fromkeys(LAPS, ""), **dict(zip(LAPS, times)), "total [s]": float(sum(times))}
        for what, times in laps.items()
    ]
    return rows, "Fresh processes, median of 5 (the first run: one)."


def _fresh(code: str, cache: str | None = None) -> list[float]:
    """The list that ``code`` prints last in a fresh process, with ``cache`` as Numba's."""
    environment = {**os.environ, **({"NUMBA_CACHE_DIR": cache} if cache else {})}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(done.stderr)
    return json.loads(done.stdout.strip().splitlines()[-1])
