"""Cost of the live system: an image with the page open and without, the advice, the start, and the memory.

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
from multiprocessing import get_context
from pathlib import Path

from activeslam_gym.live.advice import CandidateScores
from activeslam_gym.live.link import Link
from activeslam_gym.live.run import Clock, Live
from activeslam_gym.live.source import ROOM, RenderedRoom
from activeslam_gym.motion import Motion

_WARM = 20  # first images, in which kernels are loaded


def run(seed: int, frames: int, link: Link | None) -> tuple[float, float, float, float]:
    """``frames`` images of a room at the source's rate, shown on ``link``.

    Processor time of an image in the tracker's process, threads included [ms]; images a second, by the clock (the
    source has 15); most memory of the tracker after a quarter of the run and at its end [MiB].
    """
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
    return 1e3 * spent / frames, frames / passed, quarter, memory()


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
    protocol = Subprotocol(f"viser-v{viser.__version__}")
    with connect(url, subprotocols=[protocol], max_size=None, compression=None) as client:
        for _ in client:
            pass


def advice(seed: int, seconds: float) -> tuple[float, int]:
    """Time [ms] of all seven candidates with the fullest map of a run, and the number of its features."""
    show, most, slowest = Live(RenderedRoom(seed), seed, None), 0, 0.0
    for _ in range(round(seconds / ROOM.frame_time)):
        state = show.step()
        if len(state.ids) >= most and state.frame > 1:
            most, adviser = len(state.ids), show.session.adviser
            assert isinstance(adviser, CandidateScores)
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
    alone, *_ = run(args.seed, frames, None)
    link = Link(Live(RenderedRoom(args.seed), args.seed, None).about, "127.0.0.1", 0)
    visitor = get_context("spawn").Process(target=visit, args=(link.address,), daemon=True)
    visitor.start()
    time.sleep(5.0)
    shown, rate, before, after = run(args.seed, frames, link)
    visitor.terminate()
    link.close()
    cost = (shown - alone) / (1e3 * ROOM.frame_time)
    print(f"an image: {alone:.1f} ms alone, {shown:.1f} ms with the page: {cost:+.1%} of one")
    print(f"images a second with the page open: {rate:.1f} of {1.0 / ROOM.frame_time:.0f}")
    print(f"memory of the tracker: {before:.1f} MiB after a quarter of {frames} images, {after:.1f} MiB at the end")
    took, most = advice(args.seed, args.seconds)
    print(f"seven candidates with {most} features: {took:.1f} ms, of {7e3 * ROOM.frame_time:.0f} ms in seven images")
    print(f"load of the machine after: {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
