"""What the live system costs: an image with the page open and without, the advice, the start, and the memory.

    python -m benchmarks.live --seconds 35 --seed 0

The visitor of the page reads everything and draws nothing: a browser with GL in software fills every core by itself.
Times are of the processor, so that other work on the machine counts little; the start and the images a second are by
the clock, and the load of the machine is told beside them.
"""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple

from activeslam_gym.live.link import Link
from activeslam_gym.live.run import Clock, Live
from activeslam_gym.live.source import ROOM, RenderedRoom
from activeslam_gym.motion import Motion

_WARM = 20
"""First images, in which kernels are loaded."""


class Run(NamedTuple):
    """What a run in real time came to."""

    milliseconds: float
    """Processor time of an image in the tracker's process, threads included."""
    rate: float
    """Images a second, by the clock; the source has 15."""
    memory: tuple[float, float]
    """Most memory of the tracker after a quarter of the run and at its end [MiB]."""


def run(seed: int, frames: int, link: Link | None) -> Run:
    """``frames`` images of a room at the source's rate, shown on ``link``."""
    show, clock = Live(RenderedRoom(seed), seed, None), Clock(ROOM.frame_time, False)
    took, quarter, began = 0.0, 0.0, 0.0
    for k in range(_WARM + frames):
        if k == _WARM:
            took, began = time.process_time(), time.monotonic()
        state = show.step()
        state.rate = clock.tick()
        if link is not None:
            link.show(state)
        clock.wait()
        if k == _WARM + frames // 4:
            quarter = memory()
    spent, passed = time.process_time() - took, time.monotonic() - began
    return Run(1e3 * spent / frames, frames / passed, (quarter, memory()))


def memory() -> float:
    """The most that this process ever had [MiB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def start(seed: int) -> float:
    """Time from the command to the first picture that the tracker has sent to its page [s], by the clock."""
    with tempfile.TemporaryDirectory() as home:
        states = Path(home, "run", "states.jsonl")
        line = [sys.executable, "-m", "activeslam_gym", "live", "--port", "0", "--seed", str(seed)]
        began = time.monotonic()
        with subprocess.Popen([*line, "--record", str(states.parent)], stdout=subprocess.DEVNULL) as process:
            while process.poll() is None and not (states.exists() and states.stat().st_size):
                time.sleep(0.01)
            passed = time.monotonic() - began
            process.terminate()
    return passed


def visit(address: str) -> None:
    """A client, in a process of its own, that reads and draws nothing."""
    import viser
    from websockets.sync.client import connect
    from websockets.typing import Subprotocol

    url = address.replace("http", "ws").replace("localhost", "127.0.0.1")
    with connect(
        url, subprotocols=[Subprotocol(f"viser-v{viser.__version__}")], max_size=None, compression=None
    ) as client:
        for _ in client:
            pass


@contextmanager
def visitor(link: Link) -> Iterator[None]:
    """While somebody has the page open."""
    process = get_context("spawn").Process(target=visit, args=(link.address,), daemon=True)
    process.start()
    time.sleep(5.0)
    yield
    process.terminate()


def advice(seed: int, seconds: float) -> tuple[float, int]:
    """Time [ms] of all seven candidates with the fullest map of a run, and how many features it had."""
    show, most, slowest = Live(RenderedRoom(seed), seed, None), 0, 0.0
    for _ in range(round(seconds / ROOM.frame_time)):
        state = show.step()
        if len(state.ids) >= most and state.frame > 1:
            most, adviser = len(state.ids), show.session.adviser
            assert adviser is not None
            began = time.process_time()
            for motion in Motion:
                adviser.score(motion)
            slowest = 1e3 * (time.process_time() - began)
    return slowest, most


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=35.0, help="of each run (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="the room (default: %(default)s)")
    args = parser.parse_args()
    frames = round(args.seconds / ROOM.frame_time)
    print(f"load of the machine before: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    start(args.seed)  # what has to be compiled is compiled here
    print(f"start to the first picture: {start(args.seed):.1f} s")
    alone = run(args.seed, frames, None)
    link = Link(Live(RenderedRoom(args.seed), args.seed, None).about, "127.0.0.1", 0)
    with visitor(link):
        shown = run(args.seed, frames, link)
    link.close()
    cost = (shown.milliseconds - alone.milliseconds) / (1e3 * ROOM.frame_time)
    print(f"an image: {alone.milliseconds:.1f} ms alone, {shown.milliseconds:.1f} ms with the page: {cost:+.1%} of one")
    print(f"images a second with the page open: {shown.rate:.1f} of {1.0 / ROOM.frame_time:.0f}")
    before, after = shown.memory
    print(f"memory of the tracker: {before:.1f} MiB after a quarter of {frames} images, {after:.1f} MiB at the end")
    took, most = advice(args.seed, args.seconds)
    print(f"seven candidates with {most} features: {took:.1f} ms, of {7e3 * ROOM.frame_time:.0f} ms in seven images")
    print(f"load of the machine after: {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
