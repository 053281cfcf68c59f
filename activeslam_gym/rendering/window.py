"""A window on the screen, to watch an episode in."""

from __future__ import annotations

import warnings
from types import ModuleType
from typing import TYPE_CHECKING, Any

import gymnasium

from activeslam_gym.rendering.picture import REFERENCE_SIZE, Picture, figure_with, the_matplotlib

if TYPE_CHECKING:
    from activeslam_gym.rendering.scene import Snapshot


class NoScreen(gymnasium.error.Error):
    """No window can be opened."""


class NoScreenWarning(UserWarning):
    """No window can be opened, and the run goes on without one."""


class Window:
    """A window on the screen. Where there is none, or a user has closed it, the run goes on without."""

    def __init__(self, size: tuple[int, int] = REFERENCE_SIZE):
        self.size = size
        self._picture: Picture | None = None
        self._no_screen = False

    def show(self, snapshot: Snapshot) -> None:
        """Draws the snapshot now; the first call opens the window, or gives a `NoScreenWarning`.

        Raises gymnasium.error.DependencyNotInstalled where matplotlib is missing.
        """
        if self._picture is None and not self._no_screen:
            try:
                self._picture = Picture(*_on_screen(self.size, "render_mode='human' needs a screen and none was found"))
            except NoScreen as error:
                self._no_screen = True
                message = f"{error}: nothing is shown; render_mode='rgb_array' draws without one"
                warnings.warn(message, NoScreenWarning, stacklevel=2)
        if self._picture is not None and _is_open(self._picture.figure):
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


def _is_open(figure: Any) -> bool:
    """Whether the user has left the figure's window open."""
    return bool(_pyplot().fignum_exists(figure.number))


def _on_screen(size: tuple[int, int], hint: str) -> tuple[Any, bool]:
    """A figure in a window of its own, and whether it is small; where none can be opened, an error with the `hint`."""
    pyplot = _pyplot()
    from matplotlib.backend_bases import FigureManagerBase

    try:
        figure, small = figure_with(pyplot.figure, size)
    except Exception as error:  # each GUI toolkit has its own way to say that there is no screen
        raise NoScreen(hint) from error
    if type(figure.canvas.manager) is FigureManagerBase:  # a backend without windows, such as Agg
        pyplot.close(figure)
        raise NoScreen(hint)
    figure.canvas.manager.set_window_title("Active SLAM")
    figure.show()
    return figure, small
