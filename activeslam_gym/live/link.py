"""Between the tracker and the page: a process of its own, for which tracking never waits.

States go through a bounded queue that drops the oldest, and a thread that sends what is left; wishes come back. The
page's process is spawned, not forked: threads and kernels are not copied into it.
"""

import errno
import os
import signal
import socket
import threading
from collections import deque
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any

from activeslam_gym.live.state import State

PAUSE, STEP, RESTART, FOLLOW, MARK, SAVE = "pause", "step", "restart", "follow", "mark", "save"
"""What the page may wish: (name, value). Whether to pause; one image; begin anew; whether the simulated person follows;
the id of a feature, or 0; write what is known."""
WISHES = {PAUSE: bool, STEP: bool, RESTART: bool, FOLLOW: bool, MARK: int, SAVE: bool}
"""And the types of their values."""
NEWS = "news"
"""What the tracker may tell: (NEWS, a sentence)."""

_KEPT = 3
"""States that wait to be sent; of more, the oldest are dropped."""
_START = 60.0
"""The page is there after so long, or never [s]."""
_FAREWELL = 2.0
"""Time that the page's process has to end [s]."""


@dataclass(frozen=True)
class About:
    """What a page must know beforehand."""

    name: str
    """Of the source."""
    image_size: tuple[int, int]
    """Width and height [px]."""
    focal: float
    """[px]"""
    rate: float
    """Images a second that the source has [Hz]."""
    room_size: tuple[float, float, float]
    """[m]"""
    room_is_known: bool
    """Whether there is a room about the origin, or only a guess."""
    person: bool
    """Whether a simulated person holds the camera, who may be told to follow or not."""
    recorded: bool
    """Whether there is a folder to save to."""
    replay: bool = False
    """Whether this is a recording that is shown again."""


def check_address(host: str, port: int) -> None:
    """Demand that a page can be served there.

    Raises:
        OSError: the port is in use or not allowed, or the host is none of this machine; the message says which.
    """
    try:
        family, kind, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind) as trial:
            if os.name != "nt":
                trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            trial.bind(address)
    except socket.gaierror:
        raise OSError(f"host {host} is unknown") from None
    except OSError as error:
        causes = {
            errno.EADDRINUSE: f"port {port} is in use; choose another with --port (0: any free one)",
            errno.EACCES: f"port {port} is not allowed; choose one of 1024 or more",
            errno.EADDRNOTAVAIL: f"host {host} is no address of this machine",
        }
        raise OSError(causes.get(error.errno or 0, f"no page can be served at {host}:{port} ({error})")) from None


class Link:
    """The tracker's end: starts the page's process, shows it states, and hears its wishes.

    Raises:
        OSError: no page can be served there.
        ModuleNotFoundError: viser is not installed.
    """

    def __init__(self, about: About, host: str, port: int) -> None:
        check_address(host, port)
        spawn = get_context("spawn")
        self._states, theirs = spawn.Pipe(duplex=True)
        self._process = spawn.Process(target=_serve, args=(theirs, about, host, port), daemon=True)
        self._process.start()
        theirs.close()
        self._latest: deque[Any] = deque(maxlen=_KEPT)
        self._new, self._closed = threading.Event(), False
        self._sender: threading.Thread | None = None
        self.address = self._wait()
        """Where the page is."""
        self._sender = threading.Thread(target=self._send_all, daemon=True)
        self._sender.start()

    def _wait(self) -> str:
        """The address that the process says, once it serves."""
        said: Any = None
        if self._states.poll(_START):
            try:
                said = self._states.recv()
            except EOFError:
                pass
        if isinstance(said, str):
            return said
        self.close()
        raise said or OSError("the page's process ended before it served")

    @property
    def alive(self) -> bool:
        """Whether the page is still served."""
        return self._process.is_alive()

    def show(self, state: State) -> None:
        """Show a state; returns at once, and drops the oldest where the page is behind."""
        self._latest.append(state)
        self._new.set()

    def tell(self, news: str) -> None:
        """Show a sentence."""
        self._latest.append((NEWS, news))
        self._new.set()

    def wishes(self) -> list[tuple[str, Any]]:
        """What the page wished since the last call."""
        heard = []
        try:
            while self._states.poll(0):
                wish = self._states.recv()
                if wish[0] in WISHES:
                    heard.append((wish[0], WISHES[wish[0]](wish[1])))
        except (EOFError, OSError):
            pass
        return heard

    def close(self) -> None:
        """End the page's process."""
        self._closed = True
        self._new.set()
        self._process.terminate()
        self._process.join(_FAREWELL)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        if self._sender is not None:
            self._sender.join(_FAREWELL)  # with nobody to read, what it was sending has failed
        self._states.close()

    def _send_all(self) -> None:
        """In a thread of its own: send what is there; waits for a slow page, for which nobody else waits."""
        while not self._closed:
            self._new.wait()
            self._new.clear()
            while self._latest and not self._closed:
                try:
                    self._states.send(self._latest.popleft())
                except (OSError, ValueError, IndexError):
                    return


def _serve(link: Connection, about: About, host: str, port: int) -> None:
    """The page's process: says where it serves, and shows the newest state until the tracker is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the tracker's business
    one_at_a_time = threading.Lock()

    def wish(name: str, value: Any) -> None:
        with one_at_a_time:
            link.send((name, value))

    try:
        from activeslam_gym.live.page import Page

        page = Page(about, host, port, wish)
    except (ImportError, OSError) as error:
        link.send(error)
        return
    link.send(page.address)
    try:
        while True:
            state = None
            while state is None or link.poll(0):
                said = link.recv()
                if isinstance(said, State):
                    state = said
                else:
                    page.tell(said[1])
            page.show(state)
    except (EOFError, OSError):
        page.close()
