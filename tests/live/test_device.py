"""A browser films with its fake camera, which plays a rendered sequence, and is tracked (`make client-live`)."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

viser = pytest.importorskip("viser", reason="the extra `live` is not installed")
cv2 = pytest.importorskip("cv2", reason="the extra `vision` is not installed")
playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed: see make client-live")

from activeslam_gym.vision.frontend import MATCHED
from activeslam_gym.vision.target import target_from
from tests.live_scene import BROWSER, PATIENCE, SWITCHES, served, until
from tests.vision_scene import CHARUCO, LENS, board_on_the_plane, path

pytestmark = [pytest.mark.slow, pytest.mark.skipif(BROWSER is None, reason="no chromium is installed")]

SMALL = {"width": 320, "height": 240}
"""Of a window, for GL in software is slow."""
POSES = path(40, 0.45, -0.002)


def video(file: Path, images: list[np.ndarray], rate: int) -> Path:
    """The grey ``images`` as a raw video of colours, which chromium's fake camera repeats without end."""
    h, w = images[0].shape
    with file.open("wb") as out:
        out.write(f"YUV4MPEG2 W{w} H{h} F{rate}:1 Ip A1:1 C420jpeg\n".encode())
        for image in images:
            luminance = np.rint(16.0 + image * (219.0 / 255.0)).astype(np.uint8)  # as televisions have it
            out.write(b"FRAME\n" + luminance.tobytes() + bytes([128]) * (h * w // 2))
    return file


@pytest.fixture(scope="module")
def there_and_back(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A board on the textured plane from `POSES`, and back again."""
    there = [board_on_the_plane(target_from(CHARUCO), pose, 2) for pose in POSES]
    return video(tmp_path_factory.mktemp("camera") / "board.y4m", there + there[::-1], 5)


@pytest.fixture(scope="module")
def camera(there_and_back: Path) -> Iterator[Any]:
    """A browser whose camera plays that video."""
    fake = ["--use-fake-device-for-media-stream", f"--use-file-for-fake-video-capture={there_and_back}"]
    with playwright.sync_playwright() as driver:
        opened = driver.chromium.launch(executable_path=BROWSER, args=[*SWITCHES, *fake])
        yield opened
        opened.close()


@pytest.fixture
def files(tmp_path: Path) -> list[str]:
    (tmp_path / "lens.json").write_text(json.dumps(LENS._asdict()))
    (tmp_path / "target.json").write_text(json.dumps(CHARUCO))
    given = ["--calibration", str(tmp_path / "lens.json"), "--target", str(tmp_path / "target.json"), "--rate", "5"]
    return ["--source", "browser", *given]


@pytest.fixture
def visit(camera: Any) -> Iterator[Callable[..., Any]]:
    """Opens a page, with a person who allows the camera or does not."""
    contexts = []

    def open_(address: str, allows: bool = True) -> Any:
        contexts.append(
            camera.new_context(permissions=["camera"] if allows else [], viewport=SMALL, ignore_https_errors=True)
        )
        page = contexts[-1].new_page()
        page.set_default_timeout(1e3 * PATIENCE)
        page.goto(address)
        page.wait_for_selector("#device")
        return page

    yield open_
    for context in contexts:
        context.close()


def states(folder: Path) -> list[dict[str, Any]]:
    file = folder / "states.jsonl"
    return [json.loads(line) for line in file.read_text().splitlines()[:-1]] if file.exists() else []


def kept(run: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Of a run the states soon after two that were tracked: on a busy machine a browser does not film for seconds."""
    threes = zip(run, run[1:], run[2:])
    soon = [three for three in threes if np.diff([state["time"] for state in three]).max() < 0.5]
    return [now for *before, now in soon if all(state["standing"] == "tracking" for state in before)]


def test_the_camera_of_the_browser_is_tracked_and_advised(visit: Any, files: list[str], tmp_path: Path) -> None:
    run = tmp_path / "run"
    with served(*files, "--record", str(run)) as address:
        page = visit(address)
        asked = page.locator("#device").inner_text()
        assert "Use this device's camera?" in asked and f"kept there, with the trajectory, in {run}" in asked
        page.wait_for_timeout(2000)
        assert not states(run) and "press Film" in page.locator("#standing").inner_text()
        page.click("#film")
        until(lambda: len(kept(states(run))) > 20 and sum(states(run)[-1]["advised"]) > 4, PATIENCE)
        assert "Filming" in page.locator("#device").inner_text()
        page.click("#stop")
        assert page.locator("#film").is_visible()
        command = page.locator("#command")
        until(lambda: any(word in command.inner_text() for word in ("Move", "Hold still")), PATIENCE)
    every = kept(states(run))
    late = np.diff([state["time"] for state in every], prepend=every[0]["time"]) > 0.3  # a busy browser drops images
    tracked = [state for state, after_a_gap in zip(every, late) if not after_a_gap]
    assert len(tracked) > 15 and {state["standing"] for state in tracked} == {"tracking"}
    places, truth = np.array([state["camera"][:3] for state in tracked]), np.array(POSES)[:, :3]
    assert np.linalg.norm(places[:, None] - truth, axis=2).min(axis=1).max() < 0.01, "they are on the path ..."
    assert np.ptp(places, axis=0)[0] > 0.5 * np.ptp(truth, axis=0)[0], "... and along it"
    features = [np.array(state["outcomes"])[np.array(state["searched"]) > 0] for state in tracked]
    assert np.mean([(outcomes == MATCHED).sum() for outcomes in features[-20:]]) > 8, "beside the target's corners"


def test_without_leave_nothing_is_filmed_and_without_a_recording_nothing_is_kept(
    visit: Any, files: list[str], tmp_path: Path
) -> None:
    before = set(tmp_path.rglob("*"))
    with served(*files) as address:
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
