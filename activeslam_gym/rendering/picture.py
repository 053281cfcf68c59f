"""The picture of a snapshot: three panels on one figure, as an array of pixels or in a window on the screen."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from types import ModuleType
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np

from activeslam_gym.rendering.scene import MUTED, TEXT

if TYPE_CHECKING:
    from activeslam_gym.rendering.scene import Snapshot

Curve = tuple[np.ndarray, np.ndarray]  # times (T,) [s] and entropies (T,) [bit]
REFERENCE_SIZE = (960, 640)  # pixels at which the lettering has its nominal size; other sizes scale it
_SMALL_SIZE = (480, 320)  # the same for a small picture, which has fewer words, and larger ones
_SMALL_BELOW = 720  # a picture of fewer pixels in width is small

_NO_SCREEN = "render_mode='human' needs a screen, and none was found; render_mode='rgb_array' draws without one"
_TICKS = {"color": MUTED, "labelsize": 7.0, "major.width": 0.7, "major.size": 3.0}
_STYLE = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 8.0,
    "text.color": TEXT,
    "axes.edgecolor": MUTED,
    "axes.linewidth": 0.7,
    "axes.labelcolor": TEXT,
    **{f"{axis}tick.{name}": value for axis in "xy" for name, value in _TICKS.items()},
}


def draw(snapshot: Snapshot, size: tuple[int, int] = REFERENCE_SIZE, beside: Sequence[Curve] = ()) -> np.ndarray:
    """The picture of a snapshot, (H, W, 3) uint8, for size = (W, H) in pixels.

    ``beside``: entropies of whole episodes, drawn up to the snapshot's time; they determine the axis of entropy.

    Raises gymnasium.error.DependencyNotInstalled where matplotlib is missing.
    """
    picture = _offscreen_picture(int(size[0]), int(size[1]))
    picture.update(snapshot, beside)
    picture.figure.canvas.draw()
    return np.asarray(picture.figure.canvas.buffer_rgba())[..., :3].copy()


class Picture:
    """Three panels on one figure of matplotlib, whose artists are kept from frame to frame."""

    def __init__(self, figure: Any, small: bool = False):
        self.figure, self._small = figure, small
        with the_matplotlib().style.context(["default", _STYLE]):  # whatever the user's settings are
            from activeslam_gym.rendering.panels import EntropyPanel, ImagePanel, MapPanel, map_legend

            figure.set_facecolor("white")
            self._title = figure.text(0.022, 0.952, "", size=8.5 if small else 11.5, weight="bold", va="center")
            self._summary = figure.text(0.977, 0.952, "", size=7.5 if small else 9.5, va="center", ha="right")
            self._panels = (
                MapPanel(figure.add_axes((0.012, 0.115, 0.625, 0.79)), small),
                ImagePanel(figure.add_axes((0.682, 0.530, 0.295, 0.332)), small),
            )
            self._entropy = EntropyPanel(figure.add_axes((0.682, 0.135 if small else 0.115, 0.295, 0.255)), small)
            spacing = 1.0 if small else 1.8
            figure.legend(**map_legend(small), loc="center", bbox_to_anchor=(0.325, 0.062), frameon=False, fontsize=7.5,
                          ncols=4, columnspacing=spacing, handletextpad=0.5, labelspacing=0.55)  # fmt: skip

    def update(self, snapshot: Snapshot, beside: Sequence[Curve] = ()) -> None:
        """Moves every artist to the snapshot; the caller draws the canvas. ``beside``: see `draw`."""
        error_cm = 100 * np.linalg.norm(snapshot.belief.position - snapshot.truth.position)
        mapped = f"{np.count_nonzero(snapshot.belief.mapped)} of {len(snapshot.truth.landmarks)}"
        if self._small:
            self._title.set_text(f"{snapshot.scenario.name}   t = {snapshot.time:.1f} s")
            self._summary.set_text(f"{mapped} mapped, camera {error_cm:.1f} cm off")
        else:
            self._title.set_text(f"{snapshot.scenario.name}   t = {snapshot.time:.1f} s")
            self._summary.set_text(f"{mapped} landmarks mapped   ·   position error {error_cm:.1f} cm")
        for panel in self._panels:
            panel.update(snapshot)
        self._entropy.update(snapshot, beside)


def the_matplotlib() -> ModuleType:
    """The library, or an error that says how to get it."""
    try:
        import matplotlib
        import matplotlib.style
    except ImportError as error:
        raise gymnasium.error.DependencyNotInstalled(
            "matplotlib is needed to render: pip install matplotlib, or in a clone: pip install -e '.[plot]'"
        ) from error
    return matplotlib


def figure_with(make: Any, size: tuple[int, int]) -> tuple[Any, bool]:
    """A figure of ``size`` (W, H) in pixels from matplotlib's function ``make``, and whether it is a small one."""
    small = size[0] < _SMALL_BELOW
    dpi = 100 * min(np.array(size) / (_SMALL_SIZE if small else REFERENCE_SIZE))
    # A thousandth of a pixel more, since the canvas truncates.
    return make(figsize=tuple((np.array(size) + 1e-3) / dpi), dpi=dpi), small


@functools.lru_cache(maxsize=4)
def _offscreen_picture(width: int, height: int) -> Picture:
    """The picture of a size in pixels, kept: building a figure costs more than drawing one."""
    the_matplotlib()
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure, small = figure_with(Figure, (width, height))
    FigureCanvasAgg(figure)
    return Picture(figure, small)


class NoScreen(gymnasium.error.Error):
    """No window can be opened."""


class Window:
    """A window on the screen. Where a user has closed it, the run goes on without."""

    def __init__(self, size: tuple[int, int] = REFERENCE_SIZE):
        self.size = size
        self._picture: Picture | None = None

    def show(self, snapshot: Snapshot) -> None:
        """Draws the snapshot now; the first call opens the window.

        Raises NoScreen where there is none, and gymnasium.error.DependencyNotInstalled where matplotlib is missing.
        """
        self._picture = self._picture or Picture(*_on_screen(self.size))
        if _pyplot().fignum_exists(self._picture.figure.number):
            self._picture.update(snapshot)
            self._picture.figure.canvas.draw()
            self._picture.figure.canvas.flush_events()

    def close(self) -> None:
        """Closes the window; harmless where none is open."""
        if self._picture is not None:
            _pyplot().close(self._picture.figure)
        self._picture = None


def _pyplot() -> ModuleType:
    """matplotlib's interface with windows."""
    the_matplotlib()
    import matplotlib.pyplot

    return matplotlib.pyplot


def _on_screen(size: tuple[int, int]) -> tuple[Any, bool]:
    """A figure in a window of its own, and whether it is small. Raises NoScreen: none can be opened."""
    pyplot = _pyplot()
    from matplotlib.backend_bases import FigureManagerBase

    try:
        figure, small = figure_with(pyplot.figure, size)
    except Exception as error:  # each GUI toolkit has its own way to say that there is no screen
        raise NoScreen(_NO_SCREEN) from error
    if type(figure.canvas.manager) is FigureManagerBase:  # a backend without windows, such as Agg
        pyplot.close(figure)
        raise NoScreen(_NO_SCREEN)
    figure.canvas.manager.set_window_title("Active SLAM")
    figure.show()
    return figure, small
