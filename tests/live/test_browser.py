"""A real browser opens the live page, sees a map that grows, and presses every control (`make client-live`).

It is the system's own chromium, headless, with GL in software: what is judged is the picture's pixels.
"""

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

viser = pytest.importorskip("viser", reason="the extra `live` is not installed")
cv2 = pytest.importorskip("cv2", reason="the extra `vision` is not installed")
playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed: see make client-live")

from tests.live_scene import BROWSER, PATIENCE, SWITCHES, until
from tests.live_scene import served as serving

pytestmark = [pytest.mark.slow, pytest.mark.skipif(BROWSER is None, reason="no chromium is installed")]

from activeslam_gym.vision import film

VIEW = "img:not([src^='data:image/svg'])"
"""The camera's view: the only picture but for icons."""
DESK = {"width": 1280, "height": 800}


class Served(NamedTuple):
    """A page that is being served."""

    address: str
    folder: Path

    def states(self, run: str = ".") -> list[str]:
        path = self.folder / run / "states.jsonl"
        return path.read_text().splitlines() if path.exists() else []


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    folder = tmp_path_factory.mktemp("browser") / "run"
    with serving("--seconds", "3000", "--record", str(folder)) as address:
        yield Served(address, folder)


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with playwright.sync_playwright() as driver:
        opened = driver.chromium.launch(executable_path=BROWSER, args=SWITCHES)
        yield opened
        opened.close()


@pytest.fixture
def visit(browser: Any, served: Served) -> Iterator[Callable[..., Any]]:
    """Opens the page in a window of some size, once something stands on it."""
    opened = []

    def open_(size: dict[str, int], **how: Any) -> Any:
        opened.append(browser.new_page(viewport=size, **how))
        opened[-1].set_default_timeout(1e3 * PATIENCE)
        opened[-1].goto(served.address)
        opened[-1].wait_for_selector("#command")
        return opened[-1]

    yield open_
    for page in opened:
        page.close()


def map_pixels(page: Any) -> np.ndarray:
    """(h, w, 3) of the part of the window that shows the map alone."""
    size = page.viewport_size
    clip = {"x": 360, "y": 160, "width": size["width"] - 800, "height": size["height"] - 200}
    return pixels(page.screenshot(clip=clip))


def pixels(shot: bytes) -> np.ndarray:
    """(h, w, 3) of a screenshot."""
    return cv2.cvtColor(cv2.imdecode(np.frombuffer(shot, np.uint8), cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB).astype(int)


def dots(page: Any) -> int:
    """Pixels of new landmarks in the curves, which stand in the upper left of the window."""
    shot = pixels(page.screenshot(clip={"x": 0, "y": 200, "width": 330, "height": 200}))
    return int((np.abs(shot - film.rgb(film.ORANGE)).sum(axis=2) < 30).sum())


def changed(before: np.ndarray, after: np.ndarray) -> float:
    """Share of the pixels that are another colour."""
    return float((np.abs(before - after).sum(axis=2) > 60).mean())


def bluish(picture: np.ndarray) -> int:
    """Pixels of features: bluer than red, by much."""
    return int((picture[..., 2] - picture[..., 0] > 40).sum())


def press(page: Any, name: str) -> None:
    page.get_by_role("button", name=name, exact=True).first.click()


def test_the_map_grows_and_the_view_is_live(visit: Any, served: Served) -> None:
    page = visit(DESK)
    first, view = map_pixels(page), page.locator(VIEW).get_attribute("src")
    until(lambda: dots(page) > 100, PATIENCE)
    until(lambda: changed(first, map_pixels(page)) > 0.002, PATIENCE)
    until(lambda: bluish(map_pixels(page)) > 150, PATIENCE)  # features
    now = map_pixels(page)
    assert len(np.unique(now.reshape(-1, 3), axis=0)) > 100, "it is no blank canvas"
    assert page.locator(VIEW).get_attribute("src") != view
    assert page.get_by_text("Share").count() == 0
    assert "bits over holding still" in page.content() or "No motion promises more" in page.content()


def test_every_control_does_what_it_says(visit: Any, served: Served) -> None:
    page = visit(DESK)
    until(lambda: len(served.states()) > 40, PATIENCE)
    press(page, "Pause")
    until(lambda: page.locator("#standing").inner_text() == "Paused.", PATIENCE)
    until(lambda: _settled(served), PATIENCE)
    with page.expect_download() as download:
        press(page, "Save")
    rows = Path(download.value.path()).read_text().splitlines()
    assert rows[0] == "id,x,y,z,std_x,std_y,std_z" and len(rows) > 8
    until(lambda: (served.folder / "map.csv").exists(), PATIENCE)
    page.get_by_role("checkbox").first.click()
    press(page, "Go on")
    until(lambda: '"follows": false' in served.states()[-1], PATIENCE)
    press(page, "Restart")
    until(lambda: len(served.states("2")) > 3, PATIENCE)


def _settled(served: Served) -> int:
    """How many states there are, when there come no more; 0 while they do."""
    before = len(served.states())
    time.sleep(1.5)
    return before if len(served.states()) == before else 0
