"""A real browser opens the live page and presses every control; its fake camera, which plays a video, is tracked.

It is the system's own chromium, headless, with GL in software: what is judged is the picture's pixels.
"""

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

viser = pytest.importorskip("viser", reason="the extra `live` is not installed")
cv2 = pytest.importorskip("cv2", reason="the extra `vision` is not installed")
playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed: see make client-live")

from activeslam_gym.vision.search import MATCHED
from activeslam_gym.vision.target import target_from
from tests.support import until
from tests.vision_scene import CHARUCO, LENS, board_on_the_plane, path

ROOT = Path(__file__).resolve().parents[2]
BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
SWITCHES = """--no-sandbox --disable-gpu --use-gl=angle --use-angle=swiftshader --enable-unsafe-swiftshader
    --disable-quic
    --no-first-run --disable-background-networking --disable-component-update --disable-sync""".split()
PATIENCE = 240.0
"""Software GL on a busy machine is slow [s]."""

pytestmark = [pytest.mark.slow, pytest.mark.skipif(BROWSER is None, reason="no chromium is installed")]

VIEW = "img:not([src^='data:image/svg'])"
"""The camera's view: the only picture but for icons."""
DESK = {"width": 1280, "height": 800}
SMALL = {"width": 320, "height": 240}
"""Of a window, for GL in software is slow."""
POSES = path(40, 0.45, -0.002)


@contextmanager
def serving(*options: str) -> Iterator[str]:
    """The address of a page that the command serves with these ``options``."""
    line = [sys.executable, "-m", "activeslam_gym", "live", "--port", "0", *options]
    process = subprocess.Popen(line, env={**os.environ, "PYTHONPATH": str(ROOT)}, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        yield process.stdout.readline().split()[1]
    finally:
        process.terminate()
        process.wait(30)


@pytest.fixture(scope="module")
def there_and_back(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A board on the textured plane from `POSES` and back, a video that chromium's fake camera repeats without end."""
    there = [board_on_the_plane(target_from(CHARUCO), pose, 2) for pose in POSES]
    file, (h, w) = tmp_path_factory.mktemp("camera") / "board.y4m", there[0].shape
    with file.open("wb") as out:
        out.write(f"YUV4MPEG2 W{w} H{h} F5:1 Ip A1:1 C420jpeg\n".encode())
        for image in there + there[::-1]:
            luminance = np.rint(16.0 + image * (219.0 / 255.0)).astype(np.uint8)  # as televisions have it
            out.write(b"FRAME\n" + luminance.tobytes() + bytes([128]) * (h * w // 2))
    return file


@pytest.fixture(scope="module")
def browser(there_and_back: Path) -> Iterator[Any]:
    """A browser whose camera plays that video."""
    fake = ["--use-fake-device-for-media-stream", f"--use-file-for-fake-video-capture={there_and_back}"]
    with playwright.sync_playwright() as driver:
        opened = driver.chromium.launch(executable_path=BROWSER, args=[*SWITCHES, *fake])
        yield opened
        opened.close()


@pytest.fixture
def visit(browser: Any) -> Iterator[Callable[..., Any]]:
    """Opens a page, with a person who allows the camera or does not, once ``there`` stands on it."""
    contexts = []

    def open_(address: str, there: str = "#device", allows: bool = True, size: dict[str, int] = SMALL) -> Any:
        permissions = ["camera"] if allows else []
        contexts.append(browser.new_context(permissions=permissions, viewport=size, ignore_https_errors=True))
        page = contexts[-1].new_page()
        page.set_default_timeout(1e3 * PATIENCE)
        page.goto(address)
        page.wait_for_selector(there)
        return page

    yield open_
    for context in contexts:
        context.close()


def states(folder: Path) -> list[dict[str, Any]]:
    """What is recorded of a run; the last line may not be whole."""
    file = folder / "states.jsonl"
    return [json.loads(line) for line in file.read_text().splitlines()[:-1]] if file.exists() else []


def colours(page: Any) -> int:
    """How many there are in the part of the window that shows the map alone."""
    size = page.viewport_size
    shot = page.screenshot(clip={"x": 360, "y": 160, "width": size["width"] - 800, "height": size["height"] - 200})
    return len(np.unique(cv2.imdecode(np.frombuffer(shot, np.uint8), cv2.IMREAD_COLOR).reshape(-1, 3), axis=0))


def press(page: Any, name: str) -> None:
    page.get_by_role("button", name=name, exact=True).first.click()


def at_rest(folder: Path) -> bool:
    """Whether no more states come."""
    before = len(states(folder))
    time.sleep(1.5)
    return len(states(folder)) == before


def test_every_control_does_what_it_says(visit: Any, tmp_path: Path) -> None:
    run = tmp_path / "run"
    with serving("--seconds", "3000", "--record", str(run)) as address:
        page = visit(address, "#command", size=DESK)
        view = page.locator(VIEW).get_attribute("src")
        until(lambda: colours(page) > 100, PATIENCE)  # of a map that is drawn
        until(lambda: len(states(run)) > 40, PATIENCE)
        assert page.locator(VIEW).get_attribute("src") != view
        press(page, "Pause")
        until(lambda: page.locator("#standing").inner_text() == "Paused.", PATIENCE)
        until(lambda: at_rest(run), PATIENCE)
        with page.expect_download() as download:
            press(page, "Save")
        rows = Path(download.value.path()).read_text().splitlines()
        assert rows[0] == "id,x,y,z,std_x,std_y,std_z" and len(rows) > 8
        until(lambda: (run / "map.csv").exists(), PATIENCE)
        page.get_by_role("checkbox").first.click()
        press(page, "Go on")
        until(lambda: states(run)[-1]["follows"] is False, PATIENCE)
        press(page, "Restart")
        until(lambda: len(states(run / "2")) > 3, PATIENCE)


@pytest.fixture
def files(tmp_path: Path) -> list[str]:
    (tmp_path / "lens.json").write_text(json.dumps(LENS._asdict()))
    (tmp_path / "target.json").write_text(json.dumps(CHARUCO))
    given = ["--calibration", str(tmp_path / "lens.json"), "--target", str(tmp_path / "target.json"), "--rate", "5"]
    return ["--source", "browser", *given]


def kept(run: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Of a run the states soon after two that were tracked: on a busy machine a browser does not film for seconds."""
    threes = zip(run, run[1:], run[2:])
    soon = [three for three in threes if np.diff([state["time"] for state in three]).max() < 0.5]
    return [now for *before, now in soon if all(state["standing"] == "tracking" for state in before)]


def test_the_camera_of_the_browser_is_tracked_and_advised(visit: Any, files: list[str], tmp_path: Path) -> None:
    run = tmp_path / "run"
    with serving(*files, "--record", str(run)) as address:
        page = visit(address)
        asked = page.locator("#device").inner_text()
        assert "Use this device's camera?" in asked and f"kept there, with the trajectory, in {run}" in asked
        page.wait_for_timeout(2000)
        assert not states(run) and "press Film" in page.locator("#standing").inner_text()
        page.dblclick("#film")
        until(lambda: len(kept(states(run))) > 20 and sum(states(run)[-1]["advised"]) > 4, PATIENCE)
        assert "Filming" in page.locator("#device").inner_text()
        page.click("#stop")
        assert page.locator("#film").is_visible()
        until(lambda: "press Film" in page.locator("#standing").inner_text(), PATIENCE)
        assert "Please wait" in page.locator("#command").inner_text()
    every = kept(states(run))
    late = np.diff([state["time"] for state in every], prepend=every[0]["time"]) > 0.3  # a busy browser drops images
    tracked = [state for state, after_a_gap in zip(every, late) if not after_a_gap]
    assert len(tracked) > 15 and {state["standing"] for state in tracked} == {"tracking"}
    places, truth = np.array([state["camera"][:3] for state in tracked]), np.array(POSES)[:, :3]
    assert np.linalg.norm(places[:, None] - truth, axis=2).min(axis=1).max() < 0.01, "they are on the path ..."
    assert np.ptp(places, axis=0)[0] > 0.5 * np.ptp(truth, axis=0)[0], "... and along it"
    searched = [{name: np.array(one) for name, one in state["searched"].items()} for state in tracked[-20:]]
    features = [((one["id"] > 0) & (one["outcome"] == MATCHED)).sum() for one in searched]
    assert np.mean(features) > 8, "beside the target's corners"


def test_without_leave_nothing_is_filmed_and_without_a_recording_nothing_is_kept(
    visit: Any, files: list[str], tmp_path: Path
) -> None:
    before = set(tmp_path.rglob("*"))
    with serving(*files) as address:
        page = visit(address, allows=False)
        assert "They are not kept." in page.locator("#device").inner_text()
        page.click("#film")
        until(lambda: "The camera was not allowed." in page.locator("#trouble").inner_text(), PATIENCE)
        assert "press Film" in page.locator("#standing").inner_text()
        page.click("#watch")
        other = visit(address)
        other.click("#film")
        until(lambda: "Tracking" in page.locator("#standing").inner_text(), PATIENCE)
    assert set(tmp_path.rglob("*")) == before
