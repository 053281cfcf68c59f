"""The limits of a sensor, by which a planner foresees which points it would measure from another pose.

The sensor `points` measures everything in view. The front end of `images` knows a feature by its appearance, so it
measures none that it would see too differently; and it initialises features only while few are in view.
"""

import math
from typing import NamedTuple

import numpy as np

from activeslam_gym.camera import distance_between
from activeslam_gym.kernels import borrowing


class SensorLimits(NamedTuple):
    """The limits of a sensor beside the image's border, occlusion and the greatest distance."""

    greatest_change: float
    """Of a feature's view since it was initialised, up to which it is measured [rad]."""
    wanted: int
    """Features and fiducials in view up to which new ones are initialised."""


UNLIMITED = SensorLimits(math.inf, 2**62)  # those of `points`


@borrowing
def change_of_view(first: np.ndarray, now: np.ndarray, point: np.ndarray) -> float:
    """How differently ``point`` (3,) is seen from ``first`` (>= 3,) and from ``now`` (>= 3,) [rad].

    The angle between the lines of sight, and the logarithm of the ratio of the distances, as the two sides of a right
    angle. 0 where ``first`` is NaN.
    """
    if math.isnan(first[0]):
        return 0.0
    far, near = max(distance_between(first, point), 1e-9), max(distance_between(now, point), 1e-9)
    product = 0.0
    for i in range(3):
        product += (point[i] - first[i]) * (point[i] - now[i])
    return math.hypot(math.acos(min(max(product / (far * near), -1.0), 1.0)), math.log(near / far))
