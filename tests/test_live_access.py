"""The live page's server refuses the pages of other sites, and from other machines it demands a token."""

import queue
import socket
import ssl
import struct
from collections.abc import Iterator
from hashlib import sha256
from typing import Any

import numpy as np
import pytest

cv2 = pytest.importorskip("cv2", reason="the extra `vision` is not installed")
viser = pytest.importorskip("viser", reason="the extra `live` is not installed")

from websockets.exceptions import ConnectionClosed, InvalidStatus  # noqa: E402
from websockets.sync.client import connect  # noqa: E402

from activeslam_gym.live.filming import Filming  # noqa: E402
from activeslam_gym.live.guard import Guard, guarding  # noqa: E402

from .live_scene import Page, Served, serving  # noqa: E402

HANDSHAKE = (
    "Upgrade: websocket", "Connection: Upgrade", "Sec-WebSocket-Version: 13",
    "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==", f"Sec-WebSocket-Protocol: viser-v{viser.__version__}",
)  # fmt: skip


@pytest.fixture
def page() -> Iterator[Served]:
    with serving() as made:
        yield made


def place_of(page: Page) -> tuple[str, int]:
    """Where another user of this machine reaches it."""
    return "127.0.0.1", page._server.get_port()


def answers(place: tuple[str, int], *headers: str, path: str = "/") -> tuple[int, int]:
    """The status of an HTTP request and of a websocket handshake with these ``headers``."""
    http, websocket = (said(place, *headers, *more, path=path) for more in ((), HANDSHAKE))
    return int(http.split()[1]), int(websocket.split()[1])


def said(place: tuple[str, int], *headers: str, path: str = "/") -> str:
    with socket.create_connection(place, timeout=30.0) as caller:
        caller.sendall("\r\n".join((f"GET {path} HTTP/1.1", *headers, "", "")).encode())
        return caller.recv(4096).decode(errors="replace")


def test_a_rebound_name_neither_reads_nor_steers_it_and_the_own_page_is_answered(page: Served) -> None:
    place = place_of(page[0])
    for name in ("localhost", "127.0.0.1", "[::1]", "LOCALHOST"):
        host = f"{name}:{place[1]}"
        assert answers(place, f"Host: {host}") == (200, 101)
        assert answers(place, f"Host: {host}", f"Origin: http://{host.lower()}") == (200, 101)
    hosts = ("evil.example", f"evil.example:{place[1]}", f"localhost.:{place[1]}", "localhost:1", "localhost", "")
    for host in hosts:
        assert answers(place, f"Host: {host}") == (403, 403), host
        assert answers(place, f"Host: {host}", f"Origin: http://{host}") == (403, 403), host
    own = f"Host: localhost:{place[1]}"
    assert answers(place) == answers(place, own, own) == answers(place, own, "Host: evil.example") == (403, 403)


def test_a_page_that_films_from_afar_is_encrypted_by_the_certificate_that_it_names() -> None:
    pytest.importorskip("trustme", reason="the extra `live` is not installed")
    trusting = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    trusting.check_hostname, trusting.verify_mode = False, ssl.CERT_NONE
    images: queue.Queue[Any] = queue.Queue(1)
    with serving("0.0.0.0", Filming(images, "kept <nowhere>")) as (served, _):
        place, (scheme, _, _, token, _) = place_of(served), served.address.split("/")
        own = f"127.0.0.1:{place[1]}"

        def get(path: str, *headers: str) -> str:
            with socket.create_connection(place, timeout=30.0) as plain, trusting.wrap_socket(plain) as caller:
                certificate = caller.getpeercert(binary_form=True)
                assert certificate and sha256(certificate).hexdigest() == served.fingerprint.replace(":", "").lower()
                caller.sendall("\r\n".join((f"GET {path} HTTP/1.1", f"Host: {own}", *headers, "", "")).encode())
                return b"".join(iter(lambda: caller.recv(65536), b"")).decode(errors="replace")

        assert scheme == "https:"
        page, script = get(f"/{token}/", f"Origin: https://{own}"), get(f"/{token}/device.js")
        assert page.startswith("HTTP/1.1 200") and 'data-kept="kept &lt;nowhere&gt;"' in page
        assert script.startswith("HTTP/1.1 200") and "getUserMedia" in script
        for path, origin in (("/", "https"), ("/device.js", "https"), (f"/{token}/", "http"), ("/device", "https")):
            assert get(path, f"Origin: {origin}://{own}").startswith("HTTP/1.1 403"), path
        with socket.create_connection(place, timeout=30.0) as plain:
            plain.sendall(f"GET /{token}/ HTTP/1.1\r\nHost: {own}\r\n\r\n".encode())
            assert b"200" not in plain.recv(4096), "nothing is told unencrypted"
        jpeg = cv2.imencode(".jpg", np.full((8, 16), 99, np.uint8))[1].tobytes()
        url = f"wss://{own}/{token}/device"
        with connect(url, ssl=trusting, origin=f"https://{own}") as device:
            times = []
            for seconds, sent in ((5.0, 1), (4.0, 0), (6.5, 1)):  # an image of the past is left out
                device.send(struct.pack("<d", seconds) + jpeg)
                assert device.recv(30) == "next" and images.qsize() == sent
                if sent:
                    at, image = images.get()
                    times.append(at)
                    assert image.shape == (8, 16)
            assert np.diff(times) == pytest.approx(1.5)
            device.send(b"nonsense, of some length")
            with pytest.raises(ConnectionClosed, match="no image"):
                device.recv(30)
        with pytest.raises(InvalidStatus, match="403"):
            connect(url, ssl=trusting, origin="https://evil.example")


def test_a_server_that_cannot_be_guarded_is_not_used() -> None:
    with pytest.raises(OSError, match="this version of viser"), guarding(Guard.of("127.0.0.1")):
        pass
