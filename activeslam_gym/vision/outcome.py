"""The events of an image: what was searched where, and how it ended; what became of the map."""

from typing import NamedTuple

import numpy as np

MISSED, MATCHED, DOUBTED = 0, 1, 2
"""Outcomes of a search: nothing similar was found; the filter believed the candidate; the filter did not."""


class FrameLog(NamedTuple):
    """The events of a frame: a row of frames.csv."""

    time: float  # [s]
    features: int  # in the map after the frame
    searched: int
    found: int  # with at least one candidate
    matched: int
    rejected: int  # found and not believed
    initialised: int
    deletions: int
    clear: bool  # so much of the searched was matched that features could be judged and initialised
    lost: bool  # too little of the map was matched to tell the pose
    relocalised: bool  # the map was lost, and found again in this image
    metric: bool  # the scale is known: there are fiducials
    milliseconds: float  # of computation
    start_certain: bool = True  # the motion of the first images was told without doubt: so it is with a target


FIRST = FrameLog(0.0, 0, 0, 0, 0, 0, 0, 0, True, False, False, False, 0.0)
"""Of an image in which nothing was searched."""


class Searched(NamedTuple):
    """Where m templates were searched in the last image, and with which outcome."""

    id: np.ndarray  # (m,)
    pixel: np.ndarray  # (m, 2) as predicted [px]
    covariance: np.ndarray  # (m, 2, 2) of that [px^2]
    outcome: np.ndarray  # (m,) MISSED, MATCHED or DOUBTED
    inside: np.ndarray = np.zeros(0, bool)  # (m,) well inside the image, where a miss counts


NOTHING = Searched(np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros(0, np.int64))
