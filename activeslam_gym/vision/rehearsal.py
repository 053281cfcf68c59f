"""Depths for a start without a target: the first images are filtered several times before the track begins.

At the first image nothing is known of a feature's depth but its prior. The filter linearises about that guess, and what
it takes for a slow turn instead of a slide it keeps. So the images until the camera has moved are filtered first, and
the features of the first image start again at the inverse depths that were found, with the spread of the prior: a
Gauss-Newton iteration over these images, but that the prior's mean moves along. As the prior has much less
information than the images, they count little more than once.
"""

from collections.abc import Callable, Iterator

import numpy as np

from activeslam_gym.vision.frontend import FrontEnd
from activeslam_gym.vision.sources import Frame

_TIMES = 2  # that the first images are filtered before the track begins
_LONGEST = 3.0  # [s] of them
_LONGER = 1.5  # so many times as long as until half of the first image's features were mapped


def rehearsed(first: Frame, later: Iterator[Frame], begin: Callable[[], FrontEnd]) -> tuple[FrontEnd, Iterator[Frame]]:
    """A front end that has seen the ``first`` frame, and knows its depths from some ``later`` ones; and all of these.

    ``begin`` makes a front end that has seen the first frame, each time with the same features. An exception of a later
    frame is raised when it is that frame's turn.
    """
    front_end = begin()
    at_first = dict(zip(front_end.filter.ids, front_end.filter.positions))
    held: list[Frame] = []
    ending: BaseException | None = None
    moved, until = False, _LONGEST
    try:
        while not held or held[-1][0] - first[0] < until:
            frame = next(later)
            front_end.step(frame[1], frame[0])
            held.append(frame)
            if not moved and (moved := _half_mapped(front_end, at_first)):
                until = min(_LONGER * (frame[0] - first[0]), _LONGEST)
    except (StopIteration, ValueError, KeyboardInterrupt) as error:
        ending = error
    front_end = _begun_again(begin, front_end, at_first)
    for _ in range(_TIMES - 1):
        for time, image in held:
            front_end.step(image, time)
        front_end = _begun_again(begin, front_end, at_first)
    return front_end, _again(held, ending, later)


def _begun_again(begin: Callable[[], FrontEnd], known: FrontEnd, at_first: dict[int, np.ndarray]) -> FrontEnd:
    """A front end at the first frame, with the depths that ``known`` has found for features of it that are left.

    ``at_first``: by id, their points before anything was measured, which give the direction.
    """
    front_end = begin()
    origin = front_end.filter.mean[:3]
    for id, point in zip(known.filter.ids, known.filter.positions):
        if id in at_first and (point - origin) @ (at_first[id] - origin) > 0.0:
            front_end.filter.suppose(id, 1.0 / float(np.linalg.norm(point - origin)))
    return front_end


def _half_mapped(front_end: FrontEnd, ids: dict[int, np.ndarray]) -> bool:
    """Whether of the features ``ids`` that are left, if any, at least half are mapped."""
    mapped = [mapped for id, mapped in zip(front_end.filter.ids, front_end.filter.mapped) if id in ids]
    return len(mapped) > 0 and 2 * sum(mapped) >= len(mapped)


def _again(held: list[Frame], ending: BaseException | None, rest: Iterator[Frame]) -> Iterator[Frame]:
    """The frames ``held``, then the exception that ended them, or the ``rest``."""
    yield from held
    if ending is None:
        yield from rest
    elif not isinstance(ending, StopIteration):
        raise ending
