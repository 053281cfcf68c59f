"""The tracker's end of the page, which has a process of its own, so that tracking never waits for it.

A thread sends the newest state and every message; the page sends requests back. The page's process is spawned, not
forked: threads and kernels are not copied into it.
"""

import errno
import os
import socket
import threading
from collections import deque
from multiprocessing import get_context
from typing import Any

from activeslam_gym.live.filming import Filming
from activeslam_gym.live.page import serve
from activeslam_gym.live.state import About, Request, State

_START = 60.0
"""Longest time that the page's process takes to start [s]."""
_FAREWELL = 2.0
"""Time that the page's process has to end [s]."""


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
    """Starts the page's process, sends it states and messages, and receives its requests.

    Raises:
        OSError: no page can be served there.
        ModuleNotFoundError: viser is not installed.
    """

    def __init__(self, about: About, host: str, port: int, filming: Filming | None = None) -> None:
        check_address(host, port)
        spawn = get_context("spawn")
        self._connection, theirs = spawn.Pipe()
        self._process = spawn.Process(target=serve, args=(theirs, about, host, port, filming), daemon=True)
        self._latest: deque[State] = deque(maxlen=1)
        self._messages: deque[str | About] = deque()
        self._new, self._closed = threading.Event(), False
        self._sender = threading.Thread(target=self._send_all, daemon=True)
        self._process.start()
        theirs.close()
        try:
            answer: Any = self._connection.recv() if self._connection.poll(_START) else None
        except EOFError:
            answer = None
        self._sender.start()
        if not isinstance(answer, tuple):
            self.close()
            raise answer or OSError("the page's process ended before it served")
        self.address, self.fingerprint = answer
        """Address of the page, with its token, and the fingerprint of its certificate, if it is encrypted."""

    @property
    def alive(self) -> bool:
        """Whether the page is still served."""
        return self._process.is_alive()

    def show(self, state: State) -> None:
        """Show a state; returns at once. It replaces a state that is not sent yet."""
        self._latest.append(state)
        self._new.set()

    def notify(self, message: str | About) -> None:
        """Show a message to every visitor, or take facts that have changed; returns at once. None is dropped."""
        self._messages.append(message)
        self._new.set()

    def requests(self) -> list[tuple[Request, Any]]:
        """Requests of the page since the last call."""
        received = []
        try:
            while self._connection.poll(0):
                received.append(self._connection.recv())
        except (EOFError, OSError):
            pass
        return received

    def close(self) -> None:
        """End the page's process."""
        self._closed = True
        self._new.set()
        self._process.terminate()
        self._process.join(_FAREWELL)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._sender.join(_FAREWELL)  # a blocked send fails once the reader is gone
        self._connection.close()

    def _send_all(self) -> None:
        """In a thread of its own: send messages, then the newest state; only this thread waits for a slow page."""
        while not self._closed:
            self._new.wait()
            self._new.clear()
            while (waiting := self._messages or self._latest) and not self._closed:
                try:
                    self._connection.send(waiting.popleft())
                except (OSError, ValueError):
                    return
