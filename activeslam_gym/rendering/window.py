"""Windows on the screen: one to watch an episode in, and one to fly in."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping, Sequence
from types import ModuleType
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np

from activeslam_gym.rendering.picture import REFERENCE_SIZE, Picture, figure_with, our_style, the_matplotlib

if TYPE_CHECKING:
    from activeslam_gym.rendering.scene import Snapshot

COCKPIT_SIZE = (1190, 560)
"""Pixels of the window to fly in, the picture and the actions' scores beside it; with its bars it fits 1366 x 768."""
SCORES_WIDTH = 0.417  # width of the scores, relative to the picture's


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
                told = f"{error}: nothing is shown; render_mode='rgb_array' draws without one"
                warnings.warn(told, NoScreenWarning, stacklevel=2)
        if self._picture is not None and _is_open(self._picture.figure):
            self._picture.update(snapshot)
            self._picture.figure.canvas.draw()
            self._picture.figure.canvas.flush_events()

    def close(self) -> None:
        """Closes the window; harmless where none is open."""
        if self._picture is not None:
            _pyplot().close(self._picture.figure)
        self._picture = None


class Cockpit:
    """A window to fly in: the picture, what every action promises, and the keys that are pressed in it.

    Args:
        actions: A label for each score, in groups.

    Raises:
        NoScreen: there is none.
        gymnasium.error.DependencyNotInstalled: matplotlib is missing.
    """

    def __init__(self, actions: Sequence[Sequence[str]]):
        self._figure, _ = _on_screen(COCKPIT_SIZE, "flying by hand needs a screen and none was found")
        with our_style():
            from activeslam_gym.rendering.panels import ScorePanel

            left, right = self._figure.subfigures(1, 2, width_ratios=(1.0, SCORES_WIDTH))
            self._picture, self._scores = Picture(left), ScorePanel(right, actions)
        self._pressed: list[str] = []
        canvas = self._figure.canvas
        own_keys = getattr(canvas.manager, "key_press_handler_id", None)
        if own_keys is not None:  # matplotlib's own, among them the arrows and "q"
            canvas.mpl_disconnect(own_keys)
        canvas.mpl_connect("key_press_event", lambda event: self._pressed.append(event.key or ""))

    @property
    def is_open(self) -> bool:
        """False once the user has closed the window."""
        return _is_open(self._figure)

    def show(self, snapshot: Snapshot, scores: Mapping[str, np.ndarray], chosen: Iterable[int], caption: str) -> None:
        """Draws now: the scores (n,) of all actions by their title, the chosen actions marked, and a line of text."""
        if self.is_open:
            self._picture.update(snapshot)
            self._scores.update(scores, chosen, caption)
            self._figure.canvas.draw()

    def keys(self, seconds: float) -> list[str]:
        """The keys pressed since the last call, after waiting so long for more; matplotlib's names."""
        if self.is_open:
            self._figure.canvas.start_event_loop(seconds)
        pressed, self._pressed = self._pressed, []
        return pressed

    def close(self) -> None:
        """Closes the window; harmless where it is closed."""
        _pyplot().close(self._figure)


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
