"""When the looks of a target's fiducials are out of date, and how they are drawn again."""

from collections.abc import Callable, Iterator
from contextlib import suppress

import numpy as np

from activeslam_gym.vision.templates import has_room, shows_template
from activeslam_gym.vision.views import is_outdated

Drawn = Callable[[np.ndarray, int], tuple[np.ndarray, np.ndarray]]
"""From a camera's pose (7,) and the number of a fiducial, the picture (h, w) float32 of the target around it, NaN where
it is unknown, and its pixel (2,); a ValueError: it is not before the camera, or too little is known of it."""


class Redrawing:
    """The views for which the fiducials of a target were drawn.

    Args:
        target: Draws it.
        fiducials: (K, 3) [m].
        after: Change of the view, and turn of the camera, after which a fiducial is drawn again [rad].
        shown_from: The pose (7,) for which all were drawn; None: none was drawn.
    """

    def __init__(
        self, target: Drawn, fiducials: np.ndarray, after: tuple[float, float], shown_from: np.ndarray | None
    ) -> None:
        self._target, self._fiducials, self._after = target, fiducials, after
        self._drawn_from = np.full((len(fiducials), 7), np.nan if shown_from is None else shown_from)

    def due(
        self, numbers: np.ndarray, expected: np.ndarray, pose: np.ndarray, shape: tuple[int, ...]
    ) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
        """Of the fiducials ``numbers`` (n,), ``expected`` at pixels (n, 2) of an image of ``shape`` (h, w), those that
        were drawn for another view than that from ``pose`` (7,), and are wholly in it: number, picture, pixel (2,)."""
        own = numbers >= 0
        numbers, expected = numbers[own], expected[own]
        for k, pixel in zip(numbers.tolist(), expected):
            if is_outdated(self._drawn_from[k], pose, self._fiducials[k], *self._after) and has_room(shape, pixel):
                with suppress(ValueError):
                    picture, pixel = self._target(pose, k)
                    if shows_template(picture, pixel):
                        self._drawn_from[k] = pose
                        yield k, picture, pixel
