"""Which points a sensor would measure from another pose: what its model lets a planner count on.

The sensor `points` measures everything in view. The front end of `images` knows a feature by its appearance, so it
measures none that it would see too differently; and it initialises features only while few are in view.
"""

import math
from typing import NamedTuple

import numpy as np

from activeslam_gym.camera import distance_between, view_of, visible
from activeslam_gym.kernels import Record, borrowing, compiled


class SensorLimits(NamedTuple):
    """The limits of a sensor beside the image's border, occlusion and the greatest distance."""

    greatest_change: float
    """Of a feature's view since it was initialised, up to which it is measured [rad]."""
    wanted: int
    """Features and fiducials in view up to which new ones are initialised."""


UNLIMITED = SensorLimits(math.inf, 2**62)  # those of `points`


@compiled
def foresee(
    camera: Record,
    limits: SensorLimits,
    boxes: np.ndarray,
    pose: np.ndarray,
    fiducials: np.ndarray,
    points: np.ndarray,
    first_seen: np.ndarray,
) -> np.ndarray:
    """(M,) bool: which of ``points`` (M, 3) the sensor can measure from ``pose`` (13,), if they are in its image.

    The leading points are features that were first seen from ``first_seen`` (k, 3), k ≤ M; where that is NaN, and where
    k is 0, every side will do. The others are expected landmarks: as many of those in view as there is room for beside
    the features in view, the first ones, since any may stand for another.
    """
    seen = np.ones(points.shape[0], np.bool_)
    if limits.greatest_change == math.inf:
        return seen
    k, room, z, view = first_seen.shape[0], limits.wanted, np.empty(2), view_of(camera, pose, boxes)
    for fiducial in fiducials:
        room -= visible(view, fiducial, 0.0, z)
    for i in range(points.shape[0]):
        if i < k:
            seen[i] = not change_of_view(first_seen[i], pose, points[i]) > limits.greatest_change
            room -= seen[i] and visible(view, points[i], 0.0, z)
        elif visible(view, points[i], 0.0, z):
            seen[i] = room > 0
            room -= 1
    return seen


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
