"""Draws a snapshot: the map with its uncertainty, the camera's image, the entropy so far.

`scene` says what is shown and in which colours, `geometry` where it lies on the page; neither needs a drawing library.
`panels` holds what matplotlib draws, `picture` puts it on one figure, `window` brings that to a screen. matplotlib (the
extra ``plot``) is imported when something is drawn, and nowhere else in this library.
"""

from activeslam_gym.rendering.picture import REFERENCE_SIZE, draw
from activeslam_gym.rendering.window import NoScreen, NoScreenWarning, Window

__all__ = ["REFERENCE_SIZE", "NoScreen", "NoScreenWarning", "Window", "draw"]
