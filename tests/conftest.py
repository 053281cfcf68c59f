"""Fixtures of several files: a screen, and none."""

from collections.abc import Iterator
from typing import Any

import pytest


@pytest.fixture
def no_screen() -> Any:
    """matplotlib's pyplot where no window can be opened."""
    pyplot = pytest.importorskip("matplotlib.pyplot")
    pyplot.switch_backend("agg")
    return pyplot


@pytest.fixture
def screen(no_screen: Any, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """pyplot with a stand-in for a GUI: a manager of its own, as every backend with windows has."""
    from matplotlib.backend_bases import FigureManagerBase

    class Manager(FigureManagerBase):
        def show(self) -> None:
            pass

    monkeypatch.setattr("matplotlib.backends.backend_agg.FigureCanvasAgg.manager_class", Manager)
    yield no_screen
    no_screen.close("all")
