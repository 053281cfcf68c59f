"""Who may open the live page: whoever knows its address, which holds a token that is new at each start.

Neither a page of another site nor another user of this machine knows it. Beyond this machine the page is encrypted,
since browsers give their camera to https alone.
"""

import hmac
import secrets
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from ssl import PROTOCOL_TLS_SERVER, SSLContext
from typing import Any

from activeslam_gym.live.device import Device

_LOOPBACK = ("127.0.0.1", "localhost", "::1")
_EVERY = ("0.0.0.0", "::")
"""Hosts that stand for every interface."""


class Access:
    """To a page at ``host``, which asks for the camera of a ``device`` if there is one.

    Raises:
        ModuleNotFoundError: trustme is not installed, and the page is to be encrypted.
    """

    def __init__(self, host: str, device: Device | None = None) -> None:
        self._host, self._device, self._prefix = host, device, f"/{secrets.token_urlsafe(16)}"
        self._tls = None if host in _LOOPBACK else _certificate()

    @property
    def encrypted(self) -> bool:
        """Whether the page has an https address."""
        return self._tls is not None

    def address(self, port: int) -> str:
        """The address of the page, with its token."""
        name = {**dict.fromkeys(_EVERY, socket.gethostname()), "127.0.0.1": "localhost"}.get(self._host, self._host)
        scheme = "https" if self.encrypted else "http"
        return f"{scheme}://{f'[{name}]' if ':' in name else name}:{port}{self._prefix}/"

    @contextmanager
    def guarding(self) -> Iterator[None]:
        """Servers that `websockets` makes in this block answer under the token alone, and serve the device's parts.

        viser takes no such function, but makes its server, of HTTP and of websockets, by this one.

        Raises:
            OSError: none was made, so that what was begun in the block is not guarded.
        """
        from websockets.asyncio import server

        plain, guarded = server.serve, []

        def serve(handler: Any, *args: Any, process_request: Any = None, **options: Any) -> Any:
            guarded.append(True)
            films = f"{self._prefix}/device"

            async def of_path(connection: Any) -> None:
                device = self._device if connection.request.path == films else None
                await (device.take if device else handler)(connection)

            answer = self._answering(process_request)
            return plain(of_path, *args, ssl=self._tls, process_request=answer, **options)

        server.serve = serve  # type: ignore[assignment, misc]
        try:
            yield
        finally:
            server.serve = plain  # type: ignore[misc]
        if not guarded:
            raise OSError("this version of viser lets anybody in; install another 1.x")

    def _answering(self, answer: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
        """``answer``, a `process_request` of websockets, of what is asked for under the token; and the device's files,
        and its head in the page's."""
        files = self._device.files if self._device else {}

        def first(connection: Any, request: Any) -> Any:
            token, path = request.path[: len(self._prefix)], request.path[len(self._prefix) :]
            same = hmac.compare_digest(token.encode(errors="replace"), self._prefix.encode())
            connects = request.headers.get("Upgrade") == "websocket"  # viser's page leaves the last slash out
            if not same or not (path.startswith("/") or (connects and not path)):
                return connection.respond(403, "The token is missing or wrong: open the whole address.\n")
            if connects:
                return None
            kind, content = files.get(path, ("", b""))
            if content:
                response = connection.respond(200, "")
                response.body = content
                _set(response, "Content-Type", kind)
            else:
                if self._device and path == "/":
                    request.headers.pop("Accept-Encoding", None)
                response = answer(connection, replace(request, path=path))
                if not self._device or path != "/":
                    return response
                response.body = response.body.replace(b"<head>", b"<head>" + self._device.head, 1)
            _set(response, "Content-Length", str(len(response.body)))
            return response

        return first


def check_address(host: str, port: int) -> None:
    """Demand that a page can be served there.

    Raises:
        OSError: the port is in use or not allowed, or the host is none of this machine.
    """
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        socket.create_server(address[:2], family=family).close()
    except OSError as error:
        raise OSError(f"no page can be served at --host {host} --port {port}: {error.strerror}") from None


def _certificate() -> SSLContext:
    """A certificate made for this machine, which no authority has signed, so that browsers warn of it."""
    try:
        import trustme
    except ModuleNotFoundError:
        raise ModuleNotFoundError("trustme is needed to encrypt the page: install the extra `live`") from None
    context, machine = SSLContext(PROTOCOL_TLS_SERVER), socket.gethostname()
    authority = trustme.CA()
    try:
        certificate = authority.issue_cert(machine, f"{machine}.local")
    except UnicodeError:  # the machine's name cannot be a host's, as my_pc
        certificate = authority.issue_cert("localhost")
    certificate.configure_cert(context)
    return context


def _set(response: Any, name: str, value: str) -> None:
    """Replace a header, which there may be once."""
    del response.headers[name]
    response.headers[name] = value
