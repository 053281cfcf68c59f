"""Figure 1: a camera with two degrees of freedom and three landmarks. Which move brings the most information?

The paper gives neither positions nor uncertainties, only that the landmarks lie to the left, in front and to the right
front, and that the best place lies between landmarks 2 and 3. Here the camera moves in a plane with a known heading and
measures bearings. Two choices decide: whether a landmark is as uncertain across the line of sight as along it
(`isotropic`) or long along it, as after one sighting; and whether the camera sees all around or only to the front.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

VIEWS = {"96° view": np.radians(48.0), "sees all around": np.pi}  # name → half the angle of view [rad]
SHAPES = {"isotropic landmarks": True, "landmarks long along the sight": False}  # name → `Toy.isotropic`


@dataclass(frozen=True)
class Toy:
    """The scene; the start is the origin, the front is +Y. L landmarks."""

    bearings: tuple[float, ...] = (np.pi, np.pi / 2.0, np.pi / 4.0)
    """(L,) directions of the landmarks from the start [rad]: left, front, right front."""
    ranges: tuple[float, ...] = (1.5, 1.5, 1.5)  # (L,) distances [m]
    range_ratio: float = 0.2  # standard deviation of a landmark's range over the range
    isotropic: bool = True
    """A landmark is as uncertain across the line of sight as along it; otherwise across by one bearing's noise."""
    half_view: float = np.radians(48.0)  # half the angle of view about +Y [rad]; pi: all around
    bearing_std: float = 0.01  # of a measured bearing [rad]
    position_std: float = 0.02  # of the camera's start, each axis [m]
    motion_std: float = 0.02  # added by the move, each axis [m]
    step: float = 0.3  # length of the move [m], the paper's 30 cm

    @property
    def landmarks(self) -> Array:
        """(L, 2) m."""
        return np.array(self.ranges)[:, None] * direction(np.array(self.bearings))

    @property
    def covariance(self) -> Array:
        """(2 + 2 L, 2 + 2 L) of camera and landmarks, y_i = p + r_i e(theta_i), before the move."""
        G = np.tile(np.eye(2), (1 + len(self.ranges), 1))
        P = self.position_std**2 * G @ G.T
        ratios = self.range_ratio, self.range_ratio if self.isotropic else self.bearing_std
        for i, (r, theta) in enumerate(zip(self.ranges, self.bearings)):
            block = slice(2 + 2 * i, 4 + 2 * i)
            for ratio, axis in zip(ratios, (direction(theta), direction(theta + np.pi / 2.0))):
                P[block, block] += (ratio * r) ** 2 * np.outer(axis, axis)
        return P


def information(toy: Toy, positions: Array) -> Array:
    """I(x; z) = 1/2 log2(|S| / |R|) [bit] of the bearings measured at `positions` (..., 2) after the move, (...)."""
    P = toy.covariance
    P[:2, :2] += toy.motion_std**2 * np.eye(2)
    L = len(toy.ranges)
    d = toy.landmarks - positions[..., None, :]  # (..., L, 2)
    H_y = np.stack((-d[..., 1], d[..., 0]), axis=-1) / np.sum(d * d, axis=-1, keepdims=True)
    H_y[np.abs(np.arctan2(d[..., 0], d[..., 1])) > toy.half_view] = 0.0  # out of view: no information
    H = np.zeros((*positions.shape[:-1], L, len(P)))
    for i in range(L):
        H[..., i, :2], H[..., i, 2 + 2 * i : 4 + 2 * i] = -H_y[..., i, :], H_y[..., i, :]
    S = H @ P @ np.swapaxes(H, -1, -2) / toy.bearing_std**2 + np.eye(L)
    return 0.5 * np.linalg.slogdet(S)[1] / np.log(2.0)


def best_direction(toy: Toy) -> float:
    """The direction of the move with the most information [rad], of one in each degree."""
    angles = np.linspace(-np.pi, np.pi, 360, endpoint=False)
    return float(angles[information(toy, toy.step * direction(angles)).argmax()])


def lies_between(toy: Toy, first: int = 1, second: int = 2) -> bool:
    """Whether the best direction lies in the angle between two landmarks as seen from the start."""
    low, high = sorted((toy.bearings[first], toy.bearings[second]))
    return low <= best_direction(toy) <= high


def drawn(seed: int, isotropic: bool, half_view: float) -> Toy:
    """Another scene of the same kind: directions within 15 degrees, ranges 0.75 to 1.5 times, ratios 0.1 to 0.5."""
    rng, L = np.random.default_rng(seed), len(Toy.bearings)
    bearings = tuple(np.array(Toy.bearings) + np.radians(rng.uniform(-15.0, 15.0, L)))
    ranges = tuple(np.array(Toy.ranges) * rng.uniform(0.75, 1.5, L))
    return Toy(bearings, ranges, float(rng.uniform(0.1, 0.5)), isotropic, half_view)


def direction(angle: float | Array) -> Array:
    """Unit vector(s) (..., 2) of an angle [rad]."""
    return np.stack((np.cos(angle), np.sin(angle)), axis=-1)
