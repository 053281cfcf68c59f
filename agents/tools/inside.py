"""The one place that looks behind what an environment shows: hidden labels, matches and the expected landmarks.

For referees, and for the study, which moves what is expected. `core` is a bare single environment (`env.unwrapped`).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from activeslam_gym.slam.belief import FEATURES, POINT

Array = NDArray[Any]
Key = tuple[str, int]
"""What a detection is matched to: a `FIDUCIAL` and its index, or a `FEATURE` and its serial number."""
FIDUCIAL, FEATURE = "fiducial", "feature"


class Features(NamedTuple):
    """The features of the map, oldest first: the order of `belief.landmarks`."""

    serial: Array
    """(n,) serial numbers: no two features of a run share one."""
    is_point: Array
    """(n,) bool: converted from a ray or an inverse depth."""
    anchor: Array
    """(n, 3) where the line of sight of a feature that is no point yet begins, as it is estimated now [m]."""
    owner: Array
    """(n,) index of the true landmark that more than half of the feature's detections were of, or -1."""


def features(core: Any) -> Features:
    """The map with its hidden labels, as copies."""
    belief, labels = core._run.simulation.belief, core._run.simulation.labels
    slots = belief.order[: belief.size[FEATURES]]
    return Features(belief.serial[slots], belief.kind[slots] == POINT, belief.feature[slots, :3], labels.owner[slots])


def matches(core: Any) -> list[Key]:
    """What the detections of the last frame were matched to, births among them."""
    simulation, fiducials = core._run.simulation, core.scenario.fiducial_count
    rows = simulation.match[: simulation.detections.used[0]]
    serials = simulation.belief.serial
    return [
        (FIDUCIAL, row) if row < fiducials else (FEATURE, int(serials[row - fiducials]))
        for row in rows[rows >= 0].tolist()
    ]


def detected_points(core: Any) -> Array:
    """(d, 3) true positions of what was detected in the last frame, clutter left out [m]."""
    detections = core._run.simulation.detections
    labels = detections.labels[: detections.used[0]]
    return core._run.simulation.world.points[labels[labels >= 0]]


def waiting_count(core: Any) -> int:
    """How many expected landmarks no feature has retired; they are the last points of `env.prospect`."""
    return int(np.count_nonzero(core._run.simulation.expectation.slot < 0))


def move_expected_landmarks(core: Any, points: Array) -> None:
    """Put the expected landmarks at `points` (N, 3) [m]: to the policies' criteria that is all there is to them."""
    core._run.simulation.expectation.points[:] = points
