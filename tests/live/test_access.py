"""The live page's server answers under its token alone, and from other machines encrypted."""

import asyncio
import ssl
import struct
import urllib.error
import urllib.request
from pathlib import Path
from typing import Any

import numpy as np
import pytest

cv2 = pytest.importorskip("cv2", reason="the extra `vision` is not installed")
pytest.importorskip("viser", reason="the extra `live` is not installed")
pytest.importorskip("trustme", reason="the extra `live` is not installed")

from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed, InvalidStatus

from activeslam_gym.live.access import Access
from activeslam_gym.live.device import Device
from tests.live_scene import serving, visitor

TRUSTING = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
TRUSTING.check_hostname, TRUSTING.verify_mode = False, ssl.CERT_NONE


def got(address: str) -> tuple[int, bytes]:
    """The status and the body of what is at an ``address``."""
    try:
        with urllib.request.urlopen(address, timeout=30.0, context=TRUSTING) as answer:
            return answer.status, answer.read()
    except urllib.error.HTTPError as refused:
        return refused.code, refused.read()


def test_without_the_token_a_page_is_neither_read_nor_steered() -> None:
    with serving() as page:
        scheme, _, place, token, _ = page.address.split("/")
        assert got(page.address)[0] == 200 and len(token) >= 22 and not page.access.encrypted
        with visitor(page.address) as client:
            assert client.recv(timeout=30.0)
        assert got(page.address[:-1])[0] == 403, "its parts would be sought beside it"
        for path in ("", f"{token}x", f"x{token}/", f"{token[:-1]}/", f"/{token}/", f"?{token}/", token.swapcase()):
            assert got(f"{scheme}//{place}/{path}")[0] == 403, path
            with pytest.raises(InvalidStatus, match="403"):
                visitor(f"{scheme}//{place}/{path}")
    assert Access("127.0.0.1").address(1) != Access("127.0.0.1").address(1)


def test_a_page_that_films_from_afar_is_encrypted(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(Device, "_warm_up", lambda self: None)
    device: Any = Device(None, None, 5.0, tmp_path / "lens.json", kept="a <folder>")
    with serving(device, "0.0.0.0") as page:
        scheme, _, place, token, _ = page.address.split("/")
        own = f"https://127.0.0.1:{place.split(':')[1]}/{token}/"
        assert scheme == "https:" and page.access.encrypted
        assert b'data-kept="They are kept there, with the trajectory, in a &lt;folder&gt;.' in got(own)[1]
        assert b"getUserMedia" in got(f"{own}device.js")[1] and b"<svg" in got(f"{own}board.svg")[1]
        with pytest.raises((OSError, urllib.error.URLError)):
            got(own.replace("https", "http"))
        jpeg = cv2.imencode(".jpg", np.full((8, 16), 99, np.uint8))[1].tobytes()
        times = asyncio.run(sent(own.replace("https", "wss") + "device", jpeg, device))
        assert np.diff(times) == pytest.approx(1.5)


async def sent(address: str, jpeg: bytes, device: Device) -> list[float]:
    """The times of the images that are taken, of three that are sent; one of the past is left out."""
    times = []
    async with connect(address, ssl=TRUSTING) as sender:  # one thread: two may not share an encrypted connection
        for seconds, taken in ((5.0, True), (4.0, False), (6.5, True)):
            await sender.send(struct.pack("<d", seconds) + jpeg)
            assert await sender.recv() == "next" and device.wait(0.0) == taken
            if taken:
                at, image = device.next()
                times.append(at)
                assert image.shape == (8, 16)
        await sender.send(b"nonsense, of some length")
        with pytest.raises(ConnectionClosed, match="no image"):
            await sender.recv()
    return times


def test_a_server_that_cannot_be_guarded_is_not_used() -> None:
    with pytest.raises(OSError, match="this version of viser"), Access("127.0.0.1").guarding():
        pass
