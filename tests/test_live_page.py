"""The page's process: what it refuses, what it survives, and that tracking never waits for it."""

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

cv2 = pytest.importorskip("cv2", reason="the extra `vision` is not installed")
pytest.importorskip("viser", reason="the extra `live` is not installed")

from msgspec.msgpack import encode  # noqa: E402

from activeslam_gym.__main__ import main  # noqa: E402
from activeslam_gym.live.link import Link, check_address  # noqa: E402
from activeslam_gym.live.state import Standing  # noqa: E402
from activeslam_gym.motion import Motion  # noqa: E402

from .live_scene import ABOUT, Served, a_state, serving, until, visitor  # noqa: E402

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture
def page() -> Iterator[Served]:
    with serving() as made:
        yield made


@pytest.fixture(scope="module")
def links() -> Iterator[list[Link]]:
    made: list[Link] = []
    yield made
    for one in made:
        one.close()


@pytest.fixture
def link(links: list[Link]) -> Link:
    """A page in a process of its own, which starts slowly: the same one for every test that leaves it alive."""
    if not links or not links[-1].alive:
        links.append(Link(ABOUT, "127.0.0.1", 0))
    return links[-1]


@contextmanager
def hanging(link: Link) -> Iterator[None]:
    """While the page's process stands still."""
    pid = link._process.pid
    assert pid is not None
    os.kill(pid, signal.SIGSTOP)
    try:
        yield
    finally:
        os.kill(pid, signal.SIGCONT)


def hears(client: Any) -> bool:
    return bool(client.recv(timeout=30.0))


# What it refuses ------------------------------------------------------------------------------------------------------


def test_a_public_tunnel_is_refused(page: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[Any] = []
    monkeypatch.setattr("viser._viser.ViserTunnel", lambda *details: opened.append(details))
    assert page[0]._server.request_share_url() is None
    with visitor(page[0].address) as client:
        client.send(encode({"type": "ShareUrlRequest"}))
        assert hears(client)
    assert page[0]._server._share_tunnel is None and not opened


def test_a_port_in_use_and_unknown_hosts_are_named() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(OSError, match=f"port {port} is in use; choose another"):
            check_address("127.0.0.1", port)
    with pytest.raises(OSError, match="host no.such.host.invalid is unknown"):
        check_address("no.such.host.invalid", 0)


MISTAKES = {
    "--port 70000": "--port must be in 0 to 65535, got 70000",
    "--port -1": "--port must be in 0 to 65535, got -1",
    "--host 192.0.2.1 --port 0": "is no address of this machine",
    "--seconds 0": "--seconds must be a positive number, got 0.0",
    "--seconds nan": "--seconds must be a positive number, got nan",
    "--seed -1": "--seed must be 0 or more, got -1",
    "--source shots": "--source shots needs --calibration and --target",
    "--source shots --calibration lens.json": "--source shots needs --target",
    "--source shots --calibration lens.json --target t.json": "No such file or directory",
    "--source browser --target t.json": "--source browser needs --calibration or --calibrate",
    "--source shots --calibrate lens.json": "--calibrate is for --source browser without --calibration",
    "--calibrate lens.json": "--calibrate is for --source browser without --calibration",
    "--record /dev/null/x": "'/dev/null/x' is no folder to write to",
    f"--record {'a' * 300}": "is no folder to write to (File name too long)",
    "--record run --host 192.0.2.1 --port 0": "is no address of this machine",
}


@pytest.mark.parametrize("line", MISTAKES)
def test_a_mistake_is_told_in_a_line(line: str, tmp_path: Path, monkeypatch: Any, capsys: Any) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["live", *line.split()]) == 2
    *first, told = capsys.readouterr().err.splitlines()
    assert all("compiling kernels" in one for one in first)
    assert MISTAKES[line] in told and "live: " in told
    assert not list(tmp_path.iterdir())


# What it survives -----------------------------------------------------------------------------------------------------


def test_tracking_does_not_wait_for_a_page_that_hangs(link: Link) -> None:
    with hanging(link):
        began = time.process_time()
        for k in range(300):
            link.show(a_state(k, 40))
        assert len(link._latest) == 1 and link._latest[-1].frame == 299
        assert time.process_time() - began < 30.0
        link.requests()
    until(lambda: not link._latest)
    with visitor(link.address) as client:
        assert hears(client)


def test_a_page_that_is_killed_does_not_end_tracking(link: Link) -> None:
    link._process.kill()
    until(lambda: not link.alive)
    for k in range(5):
        link.show(a_state(k))
    assert link.requests() == []


# What it shows --------------------------------------------------------------------------------------------------------


def test_states_of_all_kinds_are_shown(page: Served) -> None:
    nothing, stay = {"scores": np.full(7, np.nan), "log2_dets": np.full(3, np.nan)}, Motion.STAY
    kinds = [
        {}, {"points": np.full((12, 3), np.nan)}, {"camera": np.full(13, np.nan)}, {**nothing, "command": stay},
        {"ellipses": np.tile(np.diag((1e12, -1.0)), (12, 1, 1))}, {"command": Motion.FORWARD},
        {"ellipses": np.full((12, 2, 2), np.nan)}, {"camera_covariance": np.full((3, 3), np.nan)},
        {"standing": Standing.WAITING, "follows": False},
    ]  # fmt: skip
    states = [replace(a_state(), frame=frame, **kind) for frame, kind in enumerate(kinds, 1)]
    for state in (*states, a_state(11, 100), replace(a_state(12, 0), advised=np.zeros(7, int))):
        page[0].show(state)


# The command ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("number", [signal.SIGINT, pytest.param(signal.SIGHUP, marks=pytest.mark.slow)])
def test_ctrl_c_or_a_closed_terminal_ends_it_and_loses_nothing(tmp_path: Path, number: signal.Signals) -> None:
    line = [sys.executable, "-m", "activeslam_gym", "live", "--port", "0", "--film", "--record", str(tmp_path / "run")]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    with subprocess.Popen(line, env=environment, stdout=subprocess.PIPE, text=True, start_new_session=True) as process:
        assert process.stdout is not None
        try:
            said = process.stdout.readline()
            assert "http://localhost:" in said and "Only this machine can open it" in said
            frames = tmp_path / "run" / "states.jsonl"
            until(lambda: frames.exists() and len(frames.read_text().splitlines()) > 20, 240.0)
            os.killpg(process.pid, number)  # as a terminal does: to the page's process too
            rest = process.stdout.read()
            assert process.wait(60) == 0
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
    assert f"Recorded in {tmp_path / 'run'}" in rest
    count = len(frames.read_text().splitlines())
    assert len(np.loadtxt(tmp_path / "run" / "trajectory.tum")) == count
    assert (tmp_path / "run" / "map.csv").stat().st_size > 100
    assert cv2.VideoCapture(str(tmp_path / "run" / "film.mp4")).get(cv2.CAP_PROP_FRAME_COUNT) == count
