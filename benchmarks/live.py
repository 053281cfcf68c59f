"""What the live system costs: an image with the page open and without, the advice, the start, and the memory.

    python -m benchmarks.live --seconds 35 --seed 0

The visitor of the page reads everything and draws nothing: a browser with GL in software fills every core by itself.
Times are of the processor, so that other work on the machine counts little; the start is by the clock.
"""

import argparse
import resource
import time
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import get_context

import numpy as np

from activeslam_gym.live.link import Link
from activeslam_gym.live.run import Live
from activeslam_gym.live.source import ROOM, RenderedRoom
from activeslam_gym.motion import Motion

_WARM = 20
"""First images, in which kernels are loaded."""


def milliseconds(seed: int, frames: int, link: Link | None) -> np.ndarray:
    """(frames,) time [ms] of an image in the tracker's process, threads included, shown on ``link`` in real time."""
    show, took = Live(RenderedRoom(seed), seed, None), []
    for _ in range(frames):
        began, due = time.process_time(), time.monotonic() + ROOM.frame_time
        state = show.step()
        if link is not None:
            link.show(state)
        time.sleep(max(0.0, due - time.monotonic()))
        took.append(1e3 * (time.process_time() - began))
    return np.array(took[_WARM:])


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
    began = time.monotonic()
    first = Live(RenderedRoom(args.seed), args.seed, None)
    link = Link(first.about, "127.0.0.1", 0)
    link.show(first.step())
    start = time.monotonic() - began
    alone = milliseconds(args.seed, frames, None)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with visitor(link):
        shown = milliseconds(args.seed, frames, link)
        more = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - memory
        share = (shown.mean() - alone.mean()) / (1e3 * ROOM.frame_time)
    share = (shown.mean() - alone.mean()) / (1e3 * ROOM.frame_time)
    print(f"start to the first state on a served page: {start:.1f} s")
    print(f"an image: {alone.mean():.1f} ms alone, {shown.mean():.1f} ms with the page: {share:+.1%} of a frame")
    link.close()
    took, most = advice(args.seed, args.seconds)
    print(
        f"seven candidates with {most} features: {took:.1f} ms, of {1e3 * ROOM.frame_time * 7:.0f} ms in seven images"
    )
    print(f"memory of the tracker, the second run over the first: {more / 1024:.1f} MiB")


if __name__ == "__main__":
    main()
