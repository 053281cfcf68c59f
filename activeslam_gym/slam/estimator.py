"""Estimators: what turns measurements into a state estimate.

`ekf` is compiled, and the default; `ekf-plain` is the same with the plain tangent. Another one is a class with the
methods of `Estimator`, and ``gymnasium.make("ActiveSLAM-v0", estimator=Mine)`` runs it.
"""

from typing import Any, NamedTuple, Protocol

import numpy as np

from activeslam_gym.config import Scenario
from activeslam_gym.slam.estimate import Estimate

EKF, EKF_PLAIN = COMPILED = "ekf", "ekf-plain"
"""The compiled estimators, of which the environments run whole steps in one kernel; see `slam.kalman`."""
NO_MATCH = 0  # in place of an id: a measurement of no known landmark


class Measurements(NamedTuple):
    """The measurements of one frame: M of them, of d numbers each. The first two are a pixel."""

    values: np.ndarray
    """(M, d)."""
    noise: np.ndarray
    """(M, d, d) covariance R of each."""
    ids: np.ndarray
    """(M,) the landmark or fiducial (-1 - k) that each is of where the association is known, else 0."""


class Estimator(Protocol):
    """One run's estimator. ``Estimator(scenario, fiducials, sensor)`` makes one.

    ``fiducials`` (K, 3) have known positions [m]. ``sensor`` is the `Sensor`: its ``noise``, `predict` and `visible`.

    A class may have a static method ``check(scenario)``, which raises where it cannot work in a scenario and is called
    when an environment is made.
    """

    def __init__(self, scenario: Scenario, fiducials: np.ndarray, sensor: Any) -> None: ...

    def reset(self, mean: np.ndarray, covariance: np.ndarray) -> None:
        """Begin an episode: the camera's prior ``mean`` (13,) and tangent ``covariance`` (12, 12), and no landmark."""

    def predict(self, u: np.ndarray, dt: float, contact: bool = False) -> None:
        """Go on by ``dt`` seconds under the known accelerations ``u`` (6,); ``contact``: the camera touched something,
        so that any part of its velocity may be gone."""

    def update(self, measurements: Measurements) -> np.ndarray:
        """Associate, update, and initialise landmarks: (M,) the id that each measurement was used for, new ones
        included; `NO_MATCH`, or `detection.REJECTED` where it was too ambiguous to be used."""

    def estimate(self) -> Estimate:
        """The present state estimate."""
