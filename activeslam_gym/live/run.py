"""`python -m activeslam_gym live`: a session in real time, on a page, until Ctrl-C."""

import math
import time
from argparse import Namespace
from collections import deque
from contextlib import closing
from itertools import repeat, takewhile
from queue import Empty

from activeslam_gym.live.device import BROWSER, Device
from activeslam_gym.live.page import Page
from activeslam_gym.live.session import PAUSE, Session, Source
from activeslam_gym.live.source import FOLLOW, NEVER, RecordedImages, RenderedRoom
from activeslam_gym.live.state import Standing
from activeslam_gym.vision.track import interruptible

_NAP = 0.02
"""Time between two looks for requests while nothing moves [s]."""
_RATE_IMAGES = 15
"""Images over which the rate is measured."""
_ENCRYPTED = " It is encrypted by a certificate that no authority has signed, so that browsers warn of it."


def source_of(args: Namespace) -> Source:
    """The source that the arguments of the command name.

    Raises:
        ValueError, OSError: a file, folder or number is bad.
        ModuleNotFoundError: OpenCV is not installed.
    """
    if args.film and args.record is None:
        raise ValueError("--film is written into the folder of --record: give both")
    if args.calibrate is not None and (args.source != BROWSER or args.calibration is not None):
        raise ValueError("--calibrate is for --source browser without --calibration")
    given = [f"--{name}" for name in ("calibration", "camera", "target") if getattr(args, name) is not None]
    if args.source == "rendered":
        if given:
            raise ValueError(f"{given[0]} is for a source that is not rendered: give --source")
        if args.seed < 0:
            raise ValueError(f"--seed must be 0 or more, got {args.seed}")
        return RenderedRoom(args.seed, args.follow)
    if args.source == BROWSER and (args.calibrate or args.calibration):
        return Device(args.calibration, args.target, args.rate, args.calibrate, args.camera, args.record)
    missing = [f"--{name}" for name in ("calibration", "target") if getattr(args, name) is None]
    if missing:
        needed = "--calibration or --calibrate" if args.source == BROWSER else " and ".join(missing)
        raise ValueError(f"--source {args.source} needs {needed}")
    return RecordedImages(args.source, args.calibration, args.target, args.rate, args.camera)


def live(args: Namespace) -> str | None:
    """Run the command, until Ctrl-C or for ``args.seconds``; the reason of an early end, or None.

    Raises:
        ValueError, OSError: an argument, a file or the port is bad.
        ModuleNotFoundError: OpenCV or viser is not installed.
    """
    if args.seconds is not None and not 0.0 < args.seconds < float("inf"):
        raise ValueError(f"--seconds must be a positive number, got {args.seconds}")
    if not 0 <= args.port <= 65535:
        raise ValueError(f"--port must be in 0 to 65535, got {args.port}")
    source = source_of(args)
    session = Session(source, args.seed, args.record, args.film)
    trouble: str | None = None
    with closing(session), closing(Page(source, args.host, args.port)) as page:
        warned = _ENCRYPTED if page.access.encrypted else ""
        print(f"Open {page.address} in a browser; this whole address is needed.{warned} Ctrl-C ends.", flush=True)
        try:
            _run(session, page, args.seconds or float("inf"))
        except KeyboardInterrupt:
            pass
        except ValueError as error:
            trouble = str(error)
    if session.recorded:
        print(f"Recorded in {args.record}")
    return trouble


def _run(session: Session, page: Page, seconds: float) -> None:
    """Step after step, for ``seconds``."""
    source, end = session.source, time.monotonic() + seconds
    clock, paused, over = Clock(source), False, False
    for _ in interruptible(takewhile(lambda _: time.monotonic() < end, repeat(None))):
        try:
            name, value = page.requests.get_nowait()
        except Empty:
            name, value = None, None
        if name == "pause":
            paused = value
        elif name == "restart":
            page.show(session.restart())
            over = False
        elif name == "save":
            page.notify(value, session.save())
        elif name == "follow" and source.person is not None:
            source.person.habit = FOLLOW if value else NEVER
        if paused or over:
            time.sleep(_NAP)
            clock = Clock(source)
        elif not isinstance(source, Device) or source.wait(_NAP):
            state = session.step(clock.tick())
            over = state.standing == Standing.OVER
            clock.wait(state.time)
            page.show(state)


class Clock:
    """Real time: the images of a ``source`` come at their times; those of a live camera do so by themselves.

    On a slow machine no image is left out, and a delay is not caught up. A pause takes no longer than `PAUSE`.
    """

    def __init__(self, source: Source) -> None:
        self._longest, self._is_camera = max(PAUSE, source.scenario.frame_time), source.is_camera
        self._due, self._last = time.monotonic(), math.inf
        self._ticks: deque[float] = deque(maxlen=_RATE_IMAGES + 1)

    def tick(self) -> float:
        """Count an image; the present rate [Hz]."""
        self._ticks.append(time.monotonic())
        passed = self._ticks[-1] - self._ticks[0]
        return (len(self._ticks) - 1) / passed if passed > 0.0 else 0.0

    def wait(self, at: float) -> None:
        """Wait until a state of the time ``at`` [s] is due."""
        if not self._is_camera:
            step, self._last = min(max(at - self._last, 0.0), self._longest), at
            self._due = max(self._due + step, time.monotonic() - step)
            time.sleep(max(0.0, self._due - time.monotonic()))
