"""Compile the kernels before they are needed: independent ones at the same time, each in a process of its own."""

import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed

import numpy as np

from activeslam_gym.envs.active_slam import ActiveSLAMEnv, ActiveSLAMPixelsEnv
from activeslam_gym.envs.planning import net_of_runs, score_runs
from activeslam_gym.motion import Gaze, Motion
from activeslam_gym.threads import available_cores


def steps() -> None:
    """Those of an episode."""
    _play(ActiveSLAMEnv())


def scores() -> None:
    """Those of greedy policies: of no run, or those of a reset would be compiled too."""
    env, no_run = ActiveSLAMEnv(), (0, 0)
    plans, out = env._motion_plans, np.zeros((2, 1, len(env._motion_plans)))
    score_runs(env._runs, plans, env.gaze_period, 0, env._open_loops, out[0], *no_run)
    net_of_runs(env._runs, plans, env.gaze_period, out, *no_run)


def images() -> None:
    """Those of an episode on images."""
    _play(ActiveSLAMPixelsEnv())


def _play(env: ActiveSLAMEnv) -> None:
    env.reset(seed=0)
    env.step((Motion.STAY, Gaze.STAY))


def compile_all(kernels: Sequence[Callable[[], None]]) -> None:
    """Compile ``kernels`` in processes, as many at a time as there are cores, and report each that is ready.

    Raises:
        RuntimeError: a process failed; its messages.
    """
    began, done = time.monotonic(), list[str]()

    def run(kernel: Callable[[], None]) -> str:
        command = f"from {__name__} import {kernel.__name__}; {kernel.__name__}()"
        ran = subprocess.run([sys.executable, "-c", command], capture_output=True, text=True, check=False)
        if ran.returncode:
            raise RuntimeError(f"the kernels of {kernel.__name__} could not be compiled: {ran.stderr}")
        return kernel.__name__

    with ThreadPoolExecutor(available_cores()) as pool:
        for one in as_completed([pool.submit(run, kernel) for kernel in kernels]):
            done.append(one.result())
            bar = "#" * len(done) + "." * (len(kernels) - len(done))
            line = f"activeslam_gym: kernels [{bar}] {', '.join(done)}: {time.monotonic() - began:.0f} s"
            print(line, file=sys.stderr, flush=True)


_ON_POINTS = (steps, scores)
_ON_IMAGES = (*_ON_POINTS, images)


def warm_up(images: bool = False) -> None:
    """Compile the kernels of steps and scores, or load them, for programs that fork, or that must not wait later.

    Independent ones are compiled at the same time, as many as there are cores. ``images``: those of
    ``ActiveSLAMPixels-v0`` too, which needs OpenCV.

    Raises:
        RuntimeError: kernels cannot be compiled; the message has the cause.
    """
    kernels = _ON_IMAGES if images else _ON_POINTS
    compile_all(kernels)
    for kernel in kernels:
        kernel()
