"""The limits of a sensor, by which a planner foresees which points it would measure from another pose.

The sensor `points` measures everything in view. The front end of `images` knows a feature by its appearance, so it
measures none that it would see too differently; and it initialises features only while few are in view.
"""

import math
from typing import NamedTuple


class SensorLimits(NamedTuple):
    """The limits of a sensor beside the image's border, occlusion and the greatest distance."""

    greatest_change: float
    """Of a feature's view since it was initialised, up to which it is measured [rad]."""
    wanted: int
    """Features and fiducials in view up to which new ones are initialised."""


UNLIMITED = SensorLimits(math.inf, 2**62)  # those of `points`
