"""Draws a snapshot: the map with its uncertainty, the camera's image, the entropy so far.

`scene` says what is shown, where it lies on the page, and in which colours, and needs no drawing library.
`panels` holds what matplotlib draws, `picture` puts it on one figure, and that on a screen. matplotlib (the extra
``plot``) is imported when something is drawn, and nowhere else in this library.
"""

from activeslam_gym.rendering.picture import REFERENCE_SIZE, NoScreen, Window, draw

__all__ = ["REFERENCE_SIZE", "NoScreen", "Window", "draw"]
