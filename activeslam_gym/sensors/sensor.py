"""Sensors: what measures the true world, and what the filter and the planner may know of it.

`points` (simulated detections) is compiled; `images` runs the front end of `vision`, and `corners` is what that would
find in the same room, without an image. Another sensor is a class with the methods of `Sensor`, and
``gymnasium.make("ActiveSLAM-v0", sensor=Mine)`` runs it.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple, Protocol

import numpy as np

from activeslam_gym.config import Scenario
from activeslam_gym.registry import array_of, asked
from activeslam_gym.world.truth import Truth

POINTS, IMAGES, CORNERS = "points", "images", "corners"
TEXTURED = IMAGES, CORNERS
"""Those that see a textured room instead of points."""


class Detections(NamedTuple):
    """What a sensor measures in one frame: M detections of d numbers each. The first two are a pixel."""

    values: np.ndarray
    """(M, d)."""
    labels: np.ndarray
    """(M,) what each is of: k for fiducial k, K + l for landmark l, -1 for clutter. For scoring alone: an estimator
    never sees them."""


class Sensor(Protocol):
    """One run's sensor. ``Sensor(scenario, seed)`` makes one; ``seed`` is a `numpy.random.SeedSequence` of its own.

    A measurement (d,) is (u, v, ...): a pixel of the scenario's lens, by which the filter associates, and more.

    `measure` alone reads the ground truth. Filter and planner use the other two and ``noise``. Where a sensor has an
    attribute ``boxes`` (B, 2, 3), those that are known to hide landmarks are written into it at each reset [m].
    """

    noise: np.ndarray
    """(d, d) covariance R of a measurement."""

    def __init__(self, scenario: Scenario, seed: np.random.SeedSequence) -> None: ...

    def measure(self, truth: Truth, time: float) -> Detections:
        """What is measured at ``time`` [s]. Noise must depend on the seed and the time alone, not on earlier calls."""

    def predict(self, camera: np.ndarray, point: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """h(x), no prediction in time: the measurement (d,) of a world ``point`` (3,) from ``camera`` (13,), and its
        Jacobians by the camera's position and rotation, (d, 6), and by the point, (d, 3). Rotation is perturbed in the
        world frame. NaN where there is none."""

    def visible(self, camera: np.ndarray, points: np.ndarray) -> np.ndarray:
        """(m,) bool: which of the ``points`` (m, 3) would be measured from ``camera`` (13,)."""


OWN_SENSORS: Mapping[str, None] = MappingProxyType(dict.fromkeys((POINTS, IMAGES, CORNERS)))
"""Names of the package's own sensors, which the environment itself makes."""


def noise_of(what: str, sensor: Any) -> np.ndarray:
    """The noise (d, d) of a sensor; a ValueError that begins with ``what`` where it is no covariance, or d is 1."""
    what = f"noise of {what}"
    noise = array_of(what, asked(what, lambda: sensor.noise), (None, None))
    square = len(noise) >= 2 and noise.shape == noise.T.shape and np.isfinite(noise).all()
    if not square or not np.allclose(noise, noise.T, 1e-5) or not np.linalg.eigvalsh(noise).min() > 0.0:
        raise ValueError(f"{what} must be a covariance of 2 rows or more, got {noise!r}")
    return noise


def seen_by(what: str, sensor: Any, camera: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(m,) bool: `Sensor.visible`; a ValueError that begins with ``what`` where the answer is of another form."""
    what = f"visible() of {what}"
    return array_of(what, asked(what, sensor.visible, camera.copy(), points.copy()), (len(points),), bool)


def measured(what: str, sensor: Any, truth: Truth, time: float, d: int) -> Detections:
    """What a sensor measures: finite values (M, d), and labels; a ValueError that begins with ``what`` is all else."""
    what, points = f"measure() of {what}", len(truth.fiducials) + len(truth.landmarks)
    given = asked(what, lambda: Detections(*sensor.measure(truth, time)))
    values = array_of(f"values of {what}", given.values, (None, d))
    labels = array_of(f"labels of {what}", given.labels, (len(values),), int)
    if not np.isfinite(values).all() or not ((-1 <= labels) & (labels < points)).all():
        allowed = f"finite values, and labels in -1 … {points - 1}"
        raise ValueError(f"{what} must return {allowed}, got {values!r} and {labels!r}")
    return Detections(values, labels)
