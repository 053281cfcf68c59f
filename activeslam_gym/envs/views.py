"""What an environment shows of itself: the public belief, the truth for referees, and a snapshot for the painter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from activeslam_gym.config import Scenario
from activeslam_gym.motion import Gaze, Motion


@dataclass(frozen=True)
class PublicBelief:
    """The belief with every feature as a point, oldest first; read-only copies."""

    position: np.ndarray
    """(3,) [m]."""
    quaternion: np.ndarray
    """(4,) q_WC, scalar first."""
    velocity: np.ndarray
    """(3,) [m/s], world frame."""
    angular_velocity: np.ndarray
    """(3,) [rad/s], world frame."""
    landmarks: np.ndarray
    """(n, 3) [m]."""
    mapped: np.ndarray
    """(n,) bool: the deviation of the depth over the depth is under the scenario's ratio."""
    covariance: np.ndarray
    """(12 + 3 n, 12 + 3 n) of position, rotation (world-frame tangent), velocity, angular velocity, landmarks."""
    log2_dets: dict[str, float]
    """log2 |P| of ``camera``, ``map`` and ``total`` at the constant dimension."""

    def log2_det(self, part: str = "total") -> float:
        """log2 |P| of a part at its constant dimension: 12, 3 N or 12 + 3 N (an unmapped landmark at its prior).

        Raises:
            ValueError: ``part`` is none of ``camera``, ``map`` and ``total``.
        """
        if part not in self.log2_dets:
            raise ValueError(f"part must be one of {', '.join(self.log2_dets)}, got {part!r}")
        return self.log2_dets[part]


class PublicBeliefs(tuple[PublicBelief, ...]):
    """The beliefs of a batch of B: a tuple of them whose fields can be read for all at once.

    What is of one size for all is an array with a leading axis, what grows with the map a tuple of B arrays.
    """

    __slots__ = ()

    @property
    def position(self) -> np.ndarray:
        """(B, 3) [m]."""
        return np.stack([belief.position for belief in self])

    @property
    def quaternion(self) -> np.ndarray:
        """(B, 4) q_WC, scalar first."""
        return np.stack([belief.quaternion for belief in self])

    @property
    def velocity(self) -> np.ndarray:
        """(B, 3) [m/s], world frame."""
        return np.stack([belief.velocity for belief in self])

    @property
    def angular_velocity(self) -> np.ndarray:
        """(B, 3) [rad/s], world frame."""
        return np.stack([belief.angular_velocity for belief in self])

    @property
    def landmarks(self) -> tuple[np.ndarray, ...]:
        """B arrays (n, 3) [m]."""
        return tuple(belief.landmarks for belief in self)

    @property
    def mapped(self) -> tuple[np.ndarray, ...]:
        """B arrays (n,) bool."""
        return tuple(belief.mapped for belief in self)

    @property
    def covariance(self) -> tuple[np.ndarray, ...]:
        """B arrays (12 + 3 n, 12 + 3 n)."""
        return tuple(belief.covariance for belief in self)

    def log2_det(self, part: str = "total") -> np.ndarray:
        """(B,) see `PublicBelief.log2_det`."""
        return np.array([belief.log2_det(part) for belief in self])


@dataclass(frozen=True)
class Truth:
    """What really is; for referees, never for policies. Read-only copies. Of a batch, with a leading axis."""

    position: np.ndarray
    """(3,) [m]."""
    quaternion: np.ndarray
    """(4,) q_WC, scalar first."""
    velocity: np.ndarray
    """(3,) [m/s], world frame."""
    angular_velocity: np.ndarray
    """(3,) [rad/s], world frame."""
    landmarks: np.ndarray
    """(L, 3) [m]."""
    fiducials: np.ndarray
    """(K, 3) [m]."""


@dataclass(frozen=True)
class Snapshot:
    """Everything that a picture of one moment needs."""

    scenario: Scenario
    time: float
    duration: float
    motion: Motion
    gaze: Gaze
    room_size: np.ndarray
    """(3,) [m]."""
    true_position: np.ndarray
    true_quaternion: np.ndarray
    true_landmarks: np.ndarray
    fiducials: np.ndarray
    position: np.ndarray
    quaternion: np.ndarray
    covariance: np.ndarray
    landmarks: np.ndarray
    mapped: np.ndarray
    expected_landmarks: np.ndarray
    """(k, 3) expected and not yet retired [m]."""
    detections: np.ndarray
    """(d, 2) [px]."""
    predicted: np.ndarray
    """(m, 2) [px]."""
    predicted_covariance: np.ndarray
    """(m, 2, 2) [px^2]."""
    true_trajectory: np.ndarray
    """(T, 3) [m]; T = 0 where no history is kept."""
    estimated_trajectory: np.ndarray
    """(T, 3) [m]."""
    times: np.ndarray
    """(T,) [s]."""
    entropy: np.ndarray
    """(T,) [bit]."""
    landmark_times: np.ndarray
    """(j,) times at which the number of mapped landmarks rose [s]."""
    image_size: np.ndarray
    """(2,) width and height [px]."""
