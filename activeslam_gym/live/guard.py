"""Which requests the live page's server answers.

A browser sends the address that it asks (`Host`) and, where a page asks, the origin of that page (`Origin`). A page of
another site has another origin; after DNS rebinding, which leads its name to this machine, that name is the host.
The guard refuses both, for HTTP requests and websocket handshakes. Beyond loopback the path must begin with a token.
"""

import hmac
import ipaddress
import secrets
import socket
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from hashlib import sha256
from ssl import PROTOCOL_TLS_SERVER, PEM_cert_to_DER_cert, SSLContext
from typing import Any, Protocol

_LOOPBACK = ("localhost", "127.0.0.1", "[::1]")


def _addresses(host: str) -> list[Any]:
    """Of ``host``, none where it is unknown; of an empty one, as servers take it, those of every interface."""
    try:
        found = socket.getaddrinfo(host or None, 0, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    except OSError:
        return []
    return [ipaddress.ip_address(address[0]) for *_, address in found]


def is_loopback(host: str) -> bool:
    """Whether a server at ``host`` is reached from this machine alone."""
    return {address.is_loopback for address in _addresses(host)} == {True}


def _bracketed(host: str) -> str:
    """As it stands in addresses: ``::1`` is ``[::1]``."""
    return f"[{host}]" if ":" in host else host


@dataclass(frozen=True)
class Guard:
    """Judges the requests to a page."""

    names: frozenset[str]
    """Under which the page is reached, without ports and in lower case, beside the address of each connection."""
    token: str
    """That addresses must hold; empty: none."""
    scheme: str = "http"
    """Of addresses: http, or https."""

    @classmethod
    def of(cls, host: str) -> "Guard":
        """The guard of a page at ``host``; it has a new token where that is not loopback."""
        names, machine = {*_LOOPBACK, _bracketed(host.lower())}, socket.gethostname().lower()
        if is_loopback(host):
            return cls(frozenset(names), "")
        return cls(frozenset(names | {machine, f"{machine}.local"}), secrets.token_urlsafe(16))

    def encrypted(self) -> tuple["Guard", SSLContext, str]:
        """This guard for https, with a certificate made for its names, and the certificate's fingerprint (SHA-256).

        Browsers give their camera to https alone, and warn of a certificate without an authority; so a
        person can compare the fingerprint.

        Raises:
            ModuleNotFoundError: trustme is not installed.
        """
        try:
            import trustme
        except ModuleNotFoundError:
            raise ModuleNotFoundError("trustme is needed to encrypt the page: install the extra `live`") from None
        names = [name.strip("[]") for name in self.names if name not in ("", "0")]
        made = trustme.CA().issue_cert(
            *names, *sorted({str(one) for one in _addresses(socket.gethostname())} - {*names})
        )
        context = SSLContext(PROTOCOL_TLS_SERVER)
        made.configure_cert(context)
        digest = sha256(PEM_cert_to_DER_cert(made.cert_chain_pems[0].bytes().decode())).hexdigest().upper()
        return replace(self, scheme="https"), context, ":".join(map("".join, zip(digest[::2], digest[1::2])))

    @property
    def prefix(self) -> str:
        """The path of the page, but for its last slash."""
        return f"/{self.token}" if self.token else ""

    def address(self, host: str, port: int) -> str:
        """Where a page at ``host`` and ``port`` is opened, with its token."""
        if any(address.is_unspecified for address in _addresses(host)):
            host = socket.gethostname()
        name = "localhost" if host == "127.0.0.1" else _bracketed(host)
        return f"{self.scheme}://{name}:{port}{self.prefix and self.prefix + '/'}"

    def refusal(self, path: str, hosts: Sequence[str], origins: Sequence[str], local: Sequence[Any]) -> str | None:
        """Why a request is refused, or None.

        Args:
            path: That is asked for, without its query.
            hosts, origins: Every `Host` and every `Origin` of its headers.
            local: Address and port at which it arrived.
        """
        names, port = {*self.names, _bracketed(local[0])}, local[1]
        own = {f"{name}:{port}" for name in names} | (
            names if port == {"http": 80, "https": 443}[self.scheme] else set()
        )
        if not (self.token or ipaddress.ip_address(local[0]).is_loopback):
            return "This page is served to its own machine alone."
        if len(hosts) != 1 or hosts[0].lower() not in own:
            return "The Host of this request is not an address of this page."
        if origins and list(origins) != [f"{self.scheme}://{hosts[0].lower()}"]:
            return "A page of another site asked."
        given, rest = path[: len(self.prefix)], path[len(self.prefix) :]
        same = hmac.compare_digest(given.encode(errors="replace"), self.prefix.encode())
        if not same or (self.token and rest[:1] not in ("", "/")):
            return "The token is missing or wrong: open the whole address that the start printed."
        return None

    def inner(self, path: str) -> str:
        """``path`` without the token."""
        return path[len(self.prefix) :] or "/"


class Extra(Protocol):
    """Parts of the page beside viser's."""

    head: bytes
    """Goes to the head of the page."""

    @property
    def files(self) -> dict[str, tuple[str, bytes]]:
        """Types and contents by paths."""

    @property
    def sockets(self) -> dict[str, Callable[[Any], Any]]:
        """Handlers of websockets by paths."""


@contextmanager
def guarding(guard: Guard, extra: Extra | None = None, tls: SSLContext | None = None) -> Iterator[None]:
    """Servers that `websockets` makes in this block ask ``guard`` before anything else is asked about a request, and
    serve the ``extra`` parts of the page, encrypted where there is a ``tls``.

    viser takes no such function, but makes its server, of HTTP and of websockets, by this one.

    Raises:
        OSError: none was made, so that what was begun in the block is not guarded.
    """
    from websockets.asyncio import server

    plain, guarded = server.serve, []

    def serve(handler: Any, *args: Any, process_request: Any = None, **options: Any) -> Any:
        guarded.append(True)

        async def of_path(connection: Any) -> None:
            await sockets.get(guard.inner(connection.request.path), handler)(connection)

        sockets = extra.sockets if extra else {}
        answer = _with(extra, process_request) if extra else process_request
        return plain(of_path, *args, ssl=tls, process_request=_asking(guard, answer), **options)

    server.serve = serve  # type: ignore[assignment, misc]
    try:
        yield
    finally:
        server.serve = plain  # type: ignore[misc]
    if not guarded:
        raise OSError("this version of viser lets pages of other sites in; install another 1.x")


def _with(extra: Extra, answer: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    """``answer`` with the ``extra`` files, and with its head in the page's."""

    def first(connection: Any, request: Any) -> Any:
        upgrade = request.headers.get("Upgrade") == "websocket"
        if request.path in extra.files and not upgrade:
            kind, content = extra.files[request.path]
            response = connection.respond(200, "")
            del response.headers["Content-Type"]
            response.headers["Content-Type"], response.body = f"{kind}; charset=utf-8", content
        else:
            if request.path == "/":
                request.headers.pop("Accept-Encoding", None)
            response = answer(connection, request)
            if request.path != "/" or upgrade:
                return response
            response.body = response.body.replace(b"<head>", b"<head>" + extra.head, 1)
        del response.headers["Content-Length"]
        response.headers["Content-Length"] = str(len(response.body))
        return response

    return first


def _asking(guard: Guard, answer: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    """``answer``, a `process_request` of websockets, of what ``guard`` does not refuse.

    A query is left out: viser's page would take an address from it, and show, and run, all that comes from there.
    """

    def first(connection: Any, request: Any) -> Any:
        path, query, _ = request.path.partition("?")
        hosts, origins = (request.headers.get_all(name) for name in ("Host", "Origin"))
        trouble = guard.refusal(path, hosts, origins, connection.local_address)
        if trouble:
            return connection.respond(403, f"{trouble}\n")
        if query:
            response = connection.respond(302, "")
            response.headers["Location"] = f"{guard.prefix}/"
        else:
            response = answer(connection, replace(request, path=guard.inner(path)))
        if response is not None:
            response.headers["Content-Security-Policy"] = "frame-ancestors 'none'"  # no clicks through a frame
        return response

    return first
