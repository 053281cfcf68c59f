"""`python -m activeslam_gym live`: a session or a recording in real time, on a page, until it is told to end."""

import sys
import time
from argparse import Namespace
from collections import deque
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from activeslam_gym.live.guard import is_loopback
from activeslam_gym.live.link import FOLLOW, MARK, PAUSE, RESTART, SAVE, STEP, About, Link
from activeslam_gym.live.person import FOLLOW as ALWAYS
from activeslam_gym.live.person import NEVER
from activeslam_gym.live.recording import Recording, check_folder, read_about, read_states
from activeslam_gym.live.session import Session
from activeslam_gym.live.source import RENDERED, RenderedRoom, Sequence, Source
from activeslam_gym.live.state import OVER, State
from activeslam_gym.slam.filter import Filter
from activeslam_gym.vision.frontend import FrameLog

_NAP = 0.02
"""Between two looks for wishes while nothing moves [s]."""
_LATELY = 15
"""Images over which the rate is told."""


class Live:
    """A session, with a recording where there is a folder for it; a restart has a folder of its own, 2, 3, ..."""

    def __init__(self, source: Source, seed: int, folder: str | Path | None) -> None:
        self.session, self.paced = Session(source, seed), source.paced
        scenario = source.scenario
        self.about = About(
            name=source.name,
            image_size=(scenario.image_width, scenario.image_height),
            focal=scenario.focal_px,
            rate=1.0 / scenario.frame_time,
            room_size=scenario.room_size,
            room_is_known=source.person is not None,
            person=source.person is not None,
            recorded=folder is not None,
        )
        self._home = self._folder = None if folder is None else Path(folder)
        self._recording: Recording | None = (
            None  # begun with the first image, so that a start that fails leaves nothing
        )
        self._runs = 1
        if self._folder is not None:
            check_folder(self._folder)

    @property
    def _filter(self) -> Filter | None:
        return None if self.session.front_end is None else self.session.front_end.filter

    def step(self) -> State:
        """The next state, recorded."""
        state = self.session.step()
        if self._folder is not None:
            if self._recording is None:
                self._recording = Recording(self._folder, self.about)
            self._recording.add(state, self._log)
        return state

    @property
    def _log(self) -> FrameLog | None:
        return self.session.log

    def restart(self) -> None:
        """Begin anew; what was recorded is finished."""
        self.close()
        self.session.restart()
        if self._home is not None:
            self._runs += 1
            self._recording, self._folder = None, self._home / str(self._runs)
            check_folder(self._folder)

    def follow(self, value: bool) -> None:
        """Whether the simulated person follows."""
        if self.session.source.person is not None:
            self.session.source.person.habit = ALWAYS if value else NEVER

    def mark(self, id: int) -> None:
        """Mark a feature, or none (0)."""
        self.session.marked = id

    def save(self) -> str:
        """Write the map; what to tell the user."""
        if self._recording is None:
            return "Your browser has the map. To keep images and trajectory too, start with --record DIR."
        self._recording.save(self._filter)
        return f"Saved in {self._recording.folder}."

    def close(self) -> None:
        """Finish the recording."""
        if self._recording is not None:
            self._recording.close(self._filter)


class Replay:
    """A recording, shown again."""

    paced = False

    def __init__(self, folder: str | Path) -> None:
        self._folder, self.about = folder, read_about(folder)
        self.restart()

    def restart(self) -> None:
        """From the beginning."""
        self._states: Iterator[State] = read_states(self._folder)
        self._last: State | None = None

    def step(self) -> State:
        """The next state; the last one over and over, as OVER.

        Raises:
            ValueError: it holds no state, or is damaged.
        """
        state = next(self._states, None)
        if state is None:
            if self._last is None:
                raise ValueError(f"{self._folder} holds no state")
            return replace(self._last, standing=OVER, words="The recording is over. Restart to see it again.")
        self._last = state
        return state

    def follow(self, value: bool) -> None:
        """Nobody is there."""

    def mark(self, id: int) -> None:
        """Nobody is there."""

    def save(self) -> str:
        """What to tell the user."""
        return "Your browser has the map of this moment."

    def close(self) -> None:
        """Nothing to finish."""


def show_of(args: Namespace) -> Live | Replay:
    """What the arguments of the command mean.

    Raises:
        ValueError, OSError: a file, folder or number is not what it should be.
        ModuleNotFoundError: OpenCV is not installed.
    """
    if args.replay is not None:
        if args.record is not None:
            raise ValueError("--replay shows a recording, --record makes one: give one of them")
        return Replay(args.replay)
    if args.source == RENDERED:
        if args.seed < 0:
            raise ValueError(f"--seed must be 0 or more, got {args.seed}")
        return Live(RenderedRoom(args.seed, args.follow), args.seed, args.record)
    missing = [f"--{name}" for name in ("calibration", "target") if getattr(args, name) is None]
    if missing:
        raise ValueError(f"--source {args.source} needs {' and '.join(missing)}")
    return Live(Sequence(args.source, args.calibration, args.target, args.rate), args.seed, args.record)


def live(args: Namespace) -> str | None:
    """Run the command, until Ctrl-C or for ``args.seconds``; why it ended early, or None.

    Raises:
        ValueError, OSError: an argument, a file or the port is not what it should be.
        ModuleNotFoundError: OpenCV or viser is not installed.
    """
    if args.seconds is not None and not 0.0 < args.seconds < float("inf"):
        raise ValueError(f"--seconds must be a positive number, got {args.seconds}")
    if not 0 <= args.port <= 65535:
        raise ValueError(f"--port must be in 0 to 65535, got {args.port}")
    show = show_of(args)
    try:
        link = Link(show.about, args.host, args.port)
        try:
            print(_welcome(link.address, args.host), flush=True)
            return _run(show, link, args.seconds)
        finally:
            link.close()
    finally:
        show.close()


def _welcome(address: str, host: str) -> str:
    if is_loopback(host):
        reach = "Only this machine can open it (--host says otherwise)."
    else:
        reach = "Whoever has this whole address can open it and press its buttons; it travels unencrypted."
    return f"Open {address} in a browser. {reach} Ctrl-C ends."


def _run(show: Live | Replay, link: Link, seconds: float | None) -> str | None:
    """Step after step; what ended it early, or None."""
    clock, end = Clock(1.0 / show.about.rate, show.paced), time.monotonic() + (seconds or float("inf"))
    paused = over = alone = False
    try:
        while time.monotonic() < end:
            if not link.alive and not alone:
                alone = True
                print("The page has broken down; tracking goes on. Ctrl-C ends.", file=sys.stderr, flush=True)
            one = False
            for name, value in link.wishes():
                if name == PAUSE:
                    paused = value
                elif name == STEP:
                    one = True
                else:
                    _grant(show, link, name, value)
                    over = over and name != RESTART
            if (paused or over) and not one:
                clock.rest()
                continue
            state = show.step()
            over = state.standing == OVER
            state.rate = clock.tick()
            link.show(state)
            clock.wait()
    except KeyboardInterrupt:
        return None
    except ValueError as error:
        return str(error)
    return None


def _grant(show: Live | Replay, link: Link, name: str, value: Any) -> None:
    if name == RESTART:
        show.restart()
    elif name == FOLLOW:
        show.follow(value)
    elif name == MARK:
        show.mark(value)
    elif name == SAVE:
        link.tell(show.save())


class Clock:
    """Real time: a state every ``period`` [s], unless they come at their own times. Where the machine is too slow,
    nothing is left out, and what was late is not caught up."""

    def __init__(self, period: float, paced: bool) -> None:
        self._period, self._paced = period, paced
        self._due = time.monotonic()
        self._ticks: deque[float] = deque(maxlen=_LATELY + 1)

    def tick(self) -> float:
        """A state is there; states a second, lately."""
        self._ticks.append(time.monotonic())
        passed = self._ticks[-1] - self._ticks[0]
        return (len(self._ticks) - 1) / passed if passed > 0.0 else 0.0

    def wait(self) -> None:
        """Until the next is due."""
        if not self._paced:
            self._due = max(self._due + self._period, time.monotonic() - self._period)
            time.sleep(max(0.0, self._due - time.monotonic()))

    def rest(self) -> None:
        """A moment in which nothing moves."""
        self._ticks.clear()
        time.sleep(_NAP)
        self._due = time.monotonic()
