"""The page and its command: what they refuse and show, and that nothing is lost at the end."""

import asyncio
import json
import os
import signal
import ssl
import struct
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

cv2 = pytest.importorskip("cv2", reason="the extra `vision` is not installed")
pytest.importorskip("viser", reason="the extra `live` is not installed")
pytest.importorskip("trustme", reason="the extra `live` is not installed")

from msgspec.msgpack import encode
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed, InvalidStatus

from activeslam_gym.__main__ import main
from activeslam_gym.live.access import Access
from activeslam_gym.live.device import Device
from activeslam_gym.live.page import Page
from activeslam_gym.live.source import ROOM, GuidanceError
from activeslam_gym.live.state import Standing, State
from activeslam_gym.motion import Motion
from activeslam_gym.vision.board import BOARD
from activeslam_gym.vision.search import Searched
from activeslam_gym.vision.target import printed
from tests.support import until
from tests.vision_scene import LENS

ROOT = Path(__file__).resolve().parents[2]
JPEG = cv2.imencode(".jpg", np.full((240, 320), 99, np.uint8))[1].tobytes()
SOURCE: Any = SimpleNamespace(name="a <test>", scenario=ROOM, person=object())


def a_state(frame: int = 1, n: int = 12) -> State:
    rng = np.random.default_rng(frame)
    return State(
        frame=frame, time=frame / 15, image=rng.integers(0, 255, (240, 320)).astype(np.uint8),
        standing=Standing.TRACKING, words="Tracking.", camera=np.eye(1, 13, 3)[0], camera_covariance=1e-4 * np.eye(3),
        ids=np.arange(1, n + 1), points=rng.normal(0, 1, (n, 3)), covariances=np.tile(1e-3 * np.eye(3), (n, 1, 1)),
        mapped=np.arange(n) % 2 == 0, fiducials=np.zeros((4, 3)),
        searched=Searched(np.arange(1, n + 1), rng.uniform(20, 220, (n, 2)), np.tile(9.0 * np.eye(2), (n, 1, 1)),
                          np.arange(n) % 3),
        command=Motion.UP, scores=np.arange(7.0), advised=np.arange(7), log2_dets=np.array((-100.0, -200.0, -310.0)),
        landmarks=n, milliseconds=8.0, follows=True,
    )  # fmt: skip


@contextmanager
def serving(source: Any = SOURCE, host: str = "127.0.0.1") -> Iterator[Page]:
    made = Page(source, host, 0)
    try:
        yield made
    finally:
        made.close()


def visitor(address: str) -> Any:
    """A client that connects as viser's own does."""
    import viser
    from websockets.sync.client import connect

    url = address.replace("http", "ws").replace("localhost", "127.0.0.1").removesuffix("/")
    return connect(url, subprotocols=[f"viser-v{viser.__version__}"], max_size=None, compression=None)


@pytest.fixture
def page() -> Iterator[Page]:
    with serving() as made:
        yield made


def test_a_public_tunnel_is_refused(page: Page, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[Any] = []
    monkeypatch.setattr("viser._viser.ViserTunnel", lambda *details: opened.append(details))
    with visitor(page.address) as client:
        client.send(encode({"type": "ShareUrlRequest"}))
        assert client.recv(timeout=30.0)
    assert page._server._share_tunnel is None and not opened


MISTAKES = {
    "--port 70000": "--port must be in 0 to 65535, got 70000",
    "--host no.such.host.invalid": "no page can be served at --host no.such.host.invalid",
    "--seconds nan": "--seconds must be a positive number, got nan",
    "--seed -1": "--seed must be 0 or more, got -1",
    "--source shots --calibration lens.json": "--source shots needs --target",
    "--source shots --calibration lens.json --target t.json": "No such file or directory",
    "--source browser --target t.json": "--source browser needs --calibration or --calibrate",
    "--target t.json": "--target is for a source that is not rendered",
    "--calibrate lens.json": "--calibrate is for --source browser without --calibration",
    "--record /dev/null/x": "'/dev/null/x' is no folder to write to",
    "--record run --host 192.0.2.1 --port 0": "--host 192.0.2.1 --port 0: Cannot assign requested address",
}


@pytest.mark.parametrize("line", MISTAKES)
def test_a_mistake_is_reported_in_a_line(line: str, tmp_path: Path, monkeypatch: Any, capsys: Any) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["live", *line.split()]) == 2
    *first, message = capsys.readouterr().err.splitlines()
    assert all("compiling kernels" in one for one in first)
    assert MISTAKES[line] in message and "live: " in message
    assert not list(tmp_path.iterdir())


def test_states_of_all_kinds_are_shown(page: Page) -> None:
    searched = a_state().searched._replace(covariance=np.tile(np.diag((1e12, -1.0)), (12, 1, 1)))
    kinds: list[dict[str, Any]] = [
        {}, {"points": np.full((12, 3), np.nan)}, {"camera": np.full(13, np.nan)}, {"searched": searched},
        {"scores": np.full(7, np.nan), "log2_dets": np.full(3, np.nan), "command": Motion.STAY},
        {"camera_covariance": np.full((3, 3), np.nan)}, {"standing": Standing.WAITING, "follows": False},
    ]  # fmt: skip
    states = [replace(a_state(), frame=frame, **kind) for frame, kind in enumerate(kinds, 1)]
    for state in (*states, a_state(11, 100), replace(a_state(12, 0), advised=np.zeros(7, int))):
        page.draw(state)


def test_the_command_agrees_with_the_standing_and_each_start_is_shown(page: Page) -> None:
    told, waits = list[str](), replace(a_state(0, 0), time=5e3, standing=Standing.WAITING, log2_dets=np.full(3, np.nan))
    tell, send = (lambda _, words, **__: told.append(words)), (lambda name, *_, **__: told.append(name))
    event = SimpleNamespace(client=SimpleNamespace(add_notification=tell, send_file_download=send))
    for _ in range(2):
        page.draw(waits)
        page._save(event)
        assert told.pop() == "There is no map yet." and page.requests.empty()
        assert "–" in page._counts.content and not page._way.visible and not page._history
        for frame in range(2, 7):  # the first state may not be drawn
            page._drawn = 0.0
            page.draw(replace(a_state(frame), camera=np.eye(1, 13, 3)[0] + np.eye(1, 13)[0] * frame))
        np.testing.assert_allclose(page._server.initial_camera.position, (2.8, 1.2, -2.8))
        page._server.initial_camera.position = (9.0, 9.0, 9.0)
        page._save(event)
        assert told.pop() == "map.csv" and page.requests.get() == ("save", event.client)
        assert page._way.visible and "Move up" in page._command.content and page._arrow.visible
    for words, standing in (("Go back", Standing.LOST), ("The end", Standing.OVER), ("Please wait", Standing.WAITING)):
        page.draw(replace(a_state(7), standing=standing))
        assert words in page._command.content and not page._arrow.visible
    assert "with the next images" in page._command.content, "the target was seen long ago"
    for frame, standing in ((2, Standing.WAITING), (9, Standing.TRACKING)):
        page.draw(replace(a_state(frame), standing=standing))
        page._shown -= 9.0
        page._wait()
        assert "No image for 9 s." in page._standing.content and "Please wait" in page._command.content


@pytest.mark.parametrize("number", [signal.SIGINT, pytest.param(signal.SIGHUP, marks=pytest.mark.slow)])
def test_ctrl_c_or_a_closed_terminal_ends_it_and_loses_nothing(tmp_path: Path, number: signal.Signals) -> None:
    line = [sys.executable, "-m", "activeslam_gym", "live", "--port", "0", "--film", "--record", str(tmp_path / "run")]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    with subprocess.Popen(line, env=environment, stdout=subprocess.PIPE, text=True, start_new_session=True) as process:
        assert process.stdout is not None
        try:
            said = process.stdout.readline()
            assert "http://localhost:" in said and "this whole address is needed" in said
            frames = tmp_path / "run" / "states.jsonl"
            until(lambda: frames.exists() and len(frames.read_text().splitlines()) > 20, 240.0)
            os.killpg(process.pid, number)  # as a terminal does: to the page's process too
            rest = process.stdout.read()
            assert process.wait(60) == 0
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
    assert rest == f"Recorded in {tmp_path / 'run'}\n"
    count = len(frames.read_text().splitlines())
    assert len(np.loadtxt(tmp_path / "run" / "trajectory.tum")) == count
    assert (tmp_path / "run" / "map.csv").stat().st_size > 100
    assert cv2.VideoCapture(str(tmp_path / "run" / "film.mp4")).get(cv2.CAP_PROP_FRAME_COUNT) == count


TRUSTING = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
TRUSTING.check_hostname, TRUSTING.verify_mode = False, ssl.CERT_NONE


def got(address: str) -> tuple[int, bytes]:
    """The status and the body of what is at an ``address``."""
    try:
        with urllib.request.urlopen(address, timeout=30.0, context=TRUSTING) as answer:
            return answer.status, answer.read()
    except urllib.error.HTTPError as refused:
        return refused.code, refused.read()


def test_without_the_token_a_page_is_neither_read_nor_steered(monkeypatch: pytest.MonkeyPatch) -> None:
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
    monkeypatch.setattr("socket.gethostname", lambda: "my_pc")
    assert Access("0.0.0.0").encrypted, "though a certificate has no such name"
    assert Access("127.0.0.1").address(1) != Access("127.0.0.1").address(1)


@pytest.fixture
def device(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    monkeypatch.setattr(Device, "_warm_up", lambda self: None)
    (tmp_path / "lens.json").write_text(json.dumps(LENS._asdict()))
    return Device(tmp_path / "lens.json", None, 5.0, kept="a <folder>")


def test_a_page_that_films_from_afar_is_encrypted(device: Any) -> None:
    with serving(device, "0.0.0.0") as page:
        scheme, _, place, token, _ = page.address.split("/")
        own = f"https://127.0.0.1:{place.split(':')[1]}/{token}/"
        assert scheme == "https:" and page.access.encrypted
        kept = b'data-board="" data-kept="They are kept there, with the trajectory, in a &lt;folder&gt;.'
        assert b'data-width="320" data-height="240" ' + kept in got(own)[1]
        assert b"getUserMedia" in got(f"{own}device.js")[1] and b"<svg" in got(f"{own}board.svg")[1]
        with pytest.raises((OSError, urllib.error.URLError)):
            got(own.replace("https", "http"))
        times = [at for _ in range(2) for at in asyncio.run(sent(own.replace("https", "wss") + "device", device))]
        assert np.diff(times) == pytest.approx([1.5, 0.2, 1.5]), "another one's times begin after the first one's"
    for shape, words in (((320, 240), "Turn the device"), ((180, 320), "or calibrate this one")):
        device._frame = (0.0, np.zeros(shape, np.uint8))
        with pytest.raises(GuidanceError, match=words):
            device.next()


def test_views_of_a_calibration_are_of_one_device_and_one_run(device: Any, tmp_path: Path) -> None:
    """A lens was fitted to the views of two devices, of two focal lengths."""
    unknown, at = Device(None, None, 5.0, tmp_path / "own.json"), iter(range(99))
    board = cv2.resize(printed(BOARD), (420, 300), interpolation=cv2.INTER_AREA)
    image = cv2.copyMakeBorder(board, 90, 90, 110, 110, cv2.BORDER_CONSTANT, value=255)

    def filmed(connection: str) -> str:
        for _ in range(2):  # the board rests
            unknown._images.put((connection, (next(at) / 5.0, image)))
            with pytest.raises(GuidanceError) as said:
                unknown.start(unknown.next()[1])
        return str(said.value)

    said = [filmed("A"), filmed("B")]
    unknown.restart()
    for words, start in zip([*said, filmed("B")], ("", " from the start", " from the start"), strict=True):
        assert words.startswith(f"Calibration{start}: ") and words.endswith("(1 views so far).")


def test_the_page_closes_while_a_device_films(device: Any) -> None:
    page = Page(device, "127.0.0.1", 0)
    with visitor(page.address + "device") as sender:
        sender.send(struct.pack("<d", 1.0) + JPEG)
        sender.send(struct.pack("<d", 2.0) + JPEG)  # there is room for one
        assert sender.recv(timeout=30.0) == "next"
        began = time.monotonic()
        page.close()
        assert time.monotonic() - began < 3.0


async def sent(address: str, device: Device) -> list[float]:
    """The times of the images that are taken, of three that are sent; one of the past is left out."""
    times = []
    async with connect(address, ssl=TRUSTING) as sender:  # one thread: two may not share an encrypted connection
        for seconds, taken in ((5.0, True), (4.0, False), (6.5, True)):
            await sender.send(struct.pack("<d", seconds) + JPEG)
            assert await sender.recv() == "next" and device.wait(0.0) == taken
            if taken:
                at, image = device.next()
                times.append(at)
                assert image.shape == (240, 320)
    for message, words in ((b"nonsense, of some length", "no image"), (bytes(307201), "307201 bytes; at most 307200")):
        async with connect(address, ssl=TRUSTING) as sender:
            await sender.send(message)
            with pytest.raises(ConnectionClosed, match=words):
                await sender.recv()
    return times


def test_a_server_that_cannot_be_guarded_is_not_used() -> None:
    with pytest.raises(OSError, match="this version of viser"), Access("127.0.0.1").guarding():
        pass
