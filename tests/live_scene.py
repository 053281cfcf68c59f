"""A state of a live run without a run, and a page with visitors (viser, of the extra `live`)."""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from activeslam_gym.live.page import Page
from activeslam_gym.live.source import ROOM
from activeslam_gym.live.state import Standing, State
from activeslam_gym.motion import Motion
from activeslam_gym.vision.frontend import Searched

ROOT = Path(__file__).resolve().parents[1]
BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
SWITCHES = """--no-sandbox --disable-gpu --use-gl=angle --use-angle=swiftshader --enable-unsafe-swiftshader
    --disable-quic
    --no-first-run --disable-background-networking --disable-component-update --disable-sync""".split()
PATIENCE = 240.0
"""Software GL on a busy machine is slow [s]."""
SOURCE: Any = SimpleNamespace(name="a <test>", scenario=ROOM, person=object())


def a_state(frame: int = 1, n: int = 12) -> State:
    rng = np.random.default_rng(frame)
    return State(
        frame=frame, time=frame / 15, image=rng.integers(0, 255, (240, 320)).astype(np.uint8),
        standing=Standing.TRACKING, words="Tracking.", camera=np.eye(1, 13, 3)[0], camera_covariance=1e-4 * np.eye(3),
        ids=np.arange(1, n + 1), points=rng.normal(0, 1, (n, 3)), covariances=np.tile(1e-3 * np.eye(3), (n, 1, 1)),
        mapped=np.arange(n) % 2 == 0, fiducials=np.zeros((4, 3)),
        searched=Searched(np.arange(1, n + 1), rng.uniform(20, 220, (n, 2)), np.tile(9.0 * np.eye(2), (n, 1, 1)),
                          np.arange(n) % 3),
        command=Motion.UP, scores=np.arange(7.0), advised=np.arange(7), log2_dets=np.array((-100.0, -200.0, -310.0)),
        landmarks=n, milliseconds=8.0, follows=True,
    )  # fmt: skip


@contextmanager
def serving(source: Any = SOURCE, host: str = "127.0.0.1") -> Iterator[Page]:
    made = Page(source, host, 0)
    try:
        yield made
    finally:
        made.close()


@contextmanager
def served(*options: str) -> Iterator[str]:
    """The address of a page that the command serves with these ``options``."""
    line = [sys.executable, "-m", "activeslam_gym", "live", "--port", "0", *options]
    process = subprocess.Popen(line, env={**os.environ, "PYTHONPATH": str(ROOT)}, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        yield process.stdout.readline().split()[1]
    finally:
        process.terminate()
        process.wait(30)


def visitor(address: str, **how: Any) -> Any:
    """A client that connects as viser's own does."""
    import viser
    from websockets.sync.client import connect

    url = address.replace("http", "ws").replace("localhost", "127.0.0.1").removesuffix("/")
    return connect(url, subprotocols=[f"viser-v{viser.__version__}"], max_size=None, compression=None, **how)
