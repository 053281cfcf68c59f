"""The state estimate, which is all that anything outside reads of an estimator; and what an estimator is.

An estimate presents every feature as a world point, oldest first, with one joint covariance of camera and points. Ids
are positive, grow with the order of initialisation, and are never used twice within an episode.

`ekf` is compiled, and the default; `ekf-plain` is the same with the plain tangent. Another estimator is a class with
the methods of `Estimator`, which returns an `Estimate`; ``gymnasium.make("ActiveSLAM-v0", estimator=Mine)`` runs it.
`EstimateArrays` holds an estimate in arrays of fixed capacity, for kernels and for batches.
"""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from activeslam_gym.camera import distance_between
from activeslam_gym.config import Scenario
from activeslam_gym.kernels import Record, borrowed, borrowing, compiled, inlined, record
from activeslam_gym.motion import ANGULAR_VELOCITY, CAMERA_DIM, CAMERA_SIZE, POSITION, QUATERNION, VELOCITY
from activeslam_gym.registry import array_of

EKF, EKF_PLAIN = COMPILED = "ekf", "ekf-plain"
"""The compiled estimators, of which the environments run whole steps in one kernel; see `slam.kalman`."""
NO_MATCH = 0  # in place of an id: a measurement of no known landmark

CAMERA_ESTIMATE = record(
    camera=("f8", CAMERA_SIZE),  # mean: position, quaternion, velocity, angular velocity
    count="i8",  # landmarks in use
    whole="b1",  # the covariance is that of this camera and these landmarks
)
"""The camera of an estimate, and the size of its map."""

LANDMARK_ESTIMATE = record(
    point=("f8", 3),  # world position [m]
    id="i8",
    mapped="b1",  # the deviation of its depth over its depth is under the scenario's ratio
    converted="b1",  # the estimator holds it as a point
    located="b1",  # its depth has a Gaussian: false for a ray whose depth is a set of particles
)
"""One landmark of an estimate."""


@dataclass(frozen=True)
class Estimate:
    """What an estimator believes at one time; n landmarks, oldest first. Arrays are read-only."""

    camera: np.ndarray
    """(13,) position [m], quaternion q_WC (scalar first), velocity [m/s], angular velocity [rad/s], world frame."""
    ids: np.ndarray
    """(n,) positive and increasing."""
    points: np.ndarray
    """(n, 3) world positions [m]."""
    covariance: np.ndarray
    """(12 + 3 n, 12 + 3 n) of position, rotation (world-frame tangent), velocity, angular velocity, points."""
    mapped: np.ndarray
    """(n,) bool: the deviation of the depth over the depth is under the scenario's ratio."""
    converted: np.ndarray
    """(n,) bool: the estimator holds it as a point."""
    located: np.ndarray | None = None
    """(n,) bool: the depth has a Gaussian; None: of all landmarks. One whose depth is a set of particles has none."""

    def __post_init__(self) -> None:
        n = len(array_of("ids of an Estimate", self.ids, (None,), int))
        size, of = CAMERA_DIM + 3 * n, f"of an Estimate of {n} landmarks"
        if self.located is None:
            object.__setattr__(self, "located", np.ones(n, bool))
        numbers = {"camera": (13,), "points": (n, 3), "covariance": (size, size)}
        shapes = {"ids": ((n,), int), **dict.fromkeys(("mapped", "converted", "located"), ((n,), bool))}
        for name, (shape, kind) in (shapes | {name: (shape, float) for name, shape in numbers.items()}).items():
            array = array_of(f"{name} {of}", getattr(self, name), shape, kind)
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        if n and (self.ids[0] <= 0 or (np.diff(self.ids) <= 0).any()):
            raise ValueError(f"ids of an Estimate must be positive and increasing, got {self.ids.tolist()}")

    @property
    def position(self) -> np.ndarray:
        """(3,) [m]."""
        return self.camera[POSITION]

    @property
    def quaternion(self) -> np.ndarray:
        """(4,) q_WC, scalar first."""
        return self.camera[QUATERNION]

    @property
    def velocity(self) -> np.ndarray:
        """(3,) [m/s], world frame."""
        return self.camera[VELOCITY]

    @property
    def angular_velocity(self) -> np.ndarray:
        """(3,) [rad/s], world frame."""
        return self.camera[ANGULAR_VELOCITY]

    @property
    def landmarks(self) -> np.ndarray:
        """(n, 3) [m]: the points."""
        return self.points


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


def read_only(array: np.ndarray) -> np.ndarray:
    """A copy that cannot be written to."""
    copy = np.array(array)
    copy.flags.writeable = False
    return copy


class EstimateArrays(NamedTuple):
    """An estimate in arrays of fixed capacity, for F landmarks; a batch has a leading axis."""

    state: Record  # CAMERA_ESTIMATE
    landmark: np.ndarray  # (F,) LANDMARK_ESTIMATE, of which the leading ``state.count`` are in use
    covariance: np.ndarray  # (12 + 3 F, 12 + 3 F), of which the leading 12 + 3 n are in use, where ``state.whole``


@inlined
def estimate_at(estimates, i, covariance):  # type: ignore[no-untyped-def]
    """Estimate ``i`` of a batch: views; its covariance is the array ``covariance``."""
    return EstimateArrays(estimates.state[i], borrowed(estimates.landmark[i]), borrowed(covariance))


def empty_estimates(capacity: int, count: int) -> EstimateArrays:
    """``count`` estimates with room for ``capacity`` landmarks each."""
    size = CAMERA_DIM + 3 * capacity
    return EstimateArrays(
        state=np.zeros(count, CAMERA_ESTIMATE),
        landmark=np.zeros((count, capacity), LANDMARK_ESTIMATE),
        covariance=np.zeros((count, size, size)),
    )


def put_estimate(estimate: Estimate, arrays: EstimateArrays) -> None:
    """Write an ``estimate`` into ``arrays`` of one run; a ValueError where it has too many landmarks."""
    n, landmark = len(estimate.ids), arrays.landmark
    if n > len(landmark):
        raise ValueError(f"an Estimate may have {len(landmark)} landmarks in this scenario, got {n}")
    arrays.state.camera[:], arrays.state.count, arrays.state.whole = estimate.camera, n, True
    size = CAMERA_DIM + 3 * n
    arrays.covariance[:size, :size] = estimate.covariance
    own = landmark[:n]
    own["id"], own["point"], own["mapped"] = estimate.ids, estimate.points, estimate.mapped
    own["converted"], own["located"] = estimate.converted, estimate.located


def taken_estimate(arrays: EstimateArrays) -> Estimate:
    """The `Estimate` that ``arrays`` of one run hold; copies."""
    n = int(arrays.state.count)
    own, size = arrays.landmark[:n], CAMERA_DIM + 3 * n
    return Estimate(
        camera=arrays.state.camera,
        ids=own["id"],
        points=own["point"],
        covariance=arrays.covariance[:size, :size],
        mapped=own["mapped"],
        converted=own["converted"],
        located=own["located"],
    )


@compiled
def add_offsets(estimate: EstimateArrays, first_seen: np.ndarray, angle: float) -> None:
    """Add to the covariance of each landmark a constant offset, isotropic, of deviation ``angle`` [rad] at its distance
    from where it was ``first_seen`` (>= n, 3) [m]; none where that is NaN."""
    for k in range(estimate.state.count):
        distance = distance_between(first_seen[k], estimate.landmark[k].point)
        if not math.isnan(distance):
            for i in range(CAMERA_DIM + 3 * k, CAMERA_DIM + 3 * k + 3):
                estimate.covariance[i, i] += (angle * distance) ** 2


@borrowing
def index_of(estimate: EstimateArrays, id: int) -> int:
    """Where the landmark with that ``id`` stands, or -1."""
    for k in range(estimate.state.count):
        if estimate.landmark[k].id == id:
            return k
    return -1
