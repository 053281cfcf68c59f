"""`python -m activeslam_gym live`: a session in real time, on a page, until Ctrl-C."""

import sys
import time
from argparse import Namespace
from collections import deque
from contextlib import closing
from itertools import repeat, takewhile
from pathlib import Path

from activeslam_gym.live.advice import CandidateScores, MakeAdviser, adviser_named
from activeslam_gym.live.device import BROWSER, Device
from activeslam_gym.live.filming import Filming
from activeslam_gym.live.guard import is_loopback
from activeslam_gym.live.link import Link
from activeslam_gym.live.person import FOLLOW, NEVER
from activeslam_gym.live.recording import Recording, check_folder
from activeslam_gym.live.session import Session, Source
from activeslam_gym.live.source import RecordedImages, RenderedRoom
from activeslam_gym.live.state import About, Standing, State
from activeslam_gym.vision.track import interruptible

_NAP = 0.02
"""Time between two looks for requests while nothing moves [s]."""
_RATE_IMAGES = 15
"""Images over which the rate is measured."""
_HERE = "Only this machine can open it (see --host)."
_ENCRYPTED = """Every holder of this whole address can open it and press its buttons. It is encrypted by a certificate \
that was made for it; browsers warn of it, since no authority has signed it. Its fingerprint (SHA-256) is
{fingerprint}.
"""
_AFAR = "Every holder of this whole address can open it and press its buttons; it travels unencrypted."


class Live:
    """A session and, with a ``folder``, its recording, and with ``film`` a film; each restart has a folder of its own:
    2, 3, ..."""

    def __init__(
        self,
        source: Source,
        seed: int,
        folder: str | Path | None,
        film: bool = False,
        adviser: MakeAdviser = CandidateScores,
    ) -> None:
        self.session, self.is_camera = Session(source, seed, adviser), source.is_camera
        self._home = None if folder is None else Path(folder)
        self._folder, self._runs, self._film = self._home, 1, film
        self._recording: Recording | None = None  # made with the first image: a start that fails leaves nothing
        if self._folder is not None:
            check_folder(self._folder)

    @property
    def about(self) -> About:
        """Facts about the run; those of the lens change with a calibration."""
        source, scenario = self.session.source, self.session.source.scenario
        return About(
            name=source.name,
            image_size=(scenario.image_width, scenario.image_height),
            focal=scenario.focal_px,
            rate=1.0 / scenario.frame_time,
            room_size=scenario.room_size,
            person=source.person is not None,
        )

    def step(self) -> State:
        """The next state, recorded, but for those of a calibration."""
        state, source = self.session.step(), self.session.source
        if self._folder is not None and not (isinstance(source, Device) and source.calibrating):
            self._recording = self._recording or Recording(self._folder, self.about, self._film)
            self._recording.add(state, self.session.log)
        return state

    def wait(self, seconds: float) -> bool:
        """Whether an image comes within so many ``seconds``; only one from afar is waited for."""
        source = self.session.source
        return not isinstance(source, Device) or source.wait(seconds)

    def restart(self) -> None:
        """Finish the recording and start again."""
        self.close()
        self.session.restart()
        if self._home is not None:
            self._runs += 1
            self._recording, self._folder = None, self._home / str(self._runs)
            check_folder(self._folder)

    def follow(self, value: bool) -> None:
        """Set whether the simulated person follows the advice."""
        if self.session.source.person is not None:
            self.session.source.person.habit = FOLLOW if value else NEVER

    def save(self) -> str:
        """Write the map; the answer to the user."""
        if self._recording is None:
            return "Your browser has the map. To keep images and trajectory too, start with --record DIR."
        self._recording.save()
        return f"Saved in {self._recording.folder}."

    def close(self) -> None:
        """Finish the recording."""
        if self._recording is not None:
            self._recording.close()


def show_of(args: Namespace) -> Live:
    """The session that the arguments of the command name.

    Raises:
        ValueError, OSError: a file, folder or number is bad.
        ModuleNotFoundError: OpenCV is not installed.
    """
    if args.film and args.record is None:
        raise ValueError("--film is written into the folder of --record: give both")
    if args.calibrate is not None and (args.source != BROWSER or args.calibration is not None):
        raise ValueError("--calibrate is for --source browser without --calibration")
    adviser = adviser_named(args.adviser)
    if args.source == "rendered":
        if args.seed < 0:
            raise ValueError(f"--seed must be 0 or more, got {args.seed}")
        return Live(RenderedRoom(args.seed, args.follow), args.seed, args.record, args.film, adviser)
    if args.source == BROWSER and (args.calibrate or args.calibration):
        device = Device(args.calibration, args.target, args.rate, args.calibrate, adviser, args.camera)
        return Live(device, args.seed, args.record, args.film, adviser)
    missing = [f"--{name}" for name in ("calibration", "target") if getattr(args, name) is None]
    if missing:
        needed = "--calibration or --calibrate" if args.source == BROWSER else " and ".join(missing)
        raise ValueError(f"--source {args.source} needs {needed}")
    sequence = RecordedImages(args.source, args.calibration, args.target, args.rate, args.camera)
    return Live(sequence, args.seed, args.record, args.film, adviser)


def filming_of(show: Live, record: str | None) -> Filming | None:
    """What the page of the ``show`` needs to film, or None; ``record`` is the folder of a recording."""
    source = show.session.source
    if not isinstance(source, Device):
        return None
    kept = "They are not kept." if record is None else f"They are kept there, with the trajectory, in {record}."
    return Filming(source.images, kept, source.side, source.calibrating)


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
    with closing(show_of(args)) as show, closing(_link(show, args)) as link:
        access = _HERE if is_loopback(args.host) else _ENCRYPTED if link.fingerprint else _AFAR
        access = access.format(fingerprint=link.fingerprint)
        print(f"Open {link.address} in a browser. {access} Ctrl-C ends.", flush=True)
        try:
            _run(show, link, args.seconds or float("inf"))
        except KeyboardInterrupt:
            pass
        except ValueError as error:
            return str(error)
    return None


def _link(show: Live, args: Namespace) -> Link:
    return Link(show.about, args.host, args.port, filming_of(show, args.record))


def _run(show: Live, link: Link, seconds: float) -> None:
    """Step after step, for ``seconds``."""
    clock, end = Clock(1.0 / show.about.rate, show.is_camera), time.monotonic() + seconds
    paused = over = alone = False
    for _ in interruptible(takewhile(lambda _: time.monotonic() < end, repeat(None))):
        if not link.alive and not alone:
            alone = True
            print("The page has broken down; tracking goes on. Ctrl-C ends.", file=sys.stderr, flush=True)
        for name, value in link.requests():
            if name == "pause":
                paused = value
            elif name == "restart":
                show.restart()
                over = False
            elif name == "save":
                link.notify(show.save())
            elif name == "follow":
                show.follow(value)
        if paused or over:
            time.sleep(_NAP)
            clock = Clock(1.0 / show.about.rate, show.is_camera)
            continue
        if not show.wait(_NAP):
            continue
        about, state = show.about, show.step()
        if show.about != about:
            link.notify(show.about)
        over = state.standing == Standing.OVER
        state.rate = clock.tick()
        link.show(state)
        clock.wait()


class Clock:
    """Real time: a state every ``period`` [s]; a live camera has times of its own.

    On a slow machine no image is left out, and a delay is not caught up.
    """

    def __init__(self, period: float, is_camera: bool) -> None:
        self._period, self._is_camera = period, is_camera
        self._due = time.monotonic()
        self._ticks: deque[float] = deque(maxlen=_RATE_IMAGES + 1)

    def tick(self) -> float:
        """Count a state; the present rate [Hz]."""
        self._ticks.append(time.monotonic())
        passed = self._ticks[-1] - self._ticks[0]
        return (len(self._ticks) - 1) / passed if passed > 0.0 else 0.0

    def wait(self) -> None:
        """Wait until the next state is due."""
        if not self._is_camera:
            self._due = max(self._due + self._period, time.monotonic() - self._period)
            time.sleep(max(0.0, self._due - time.monotonic()))
