"""Figure 1: a camera with two degrees of freedom and three landmarks. Where should it go to learn the most?

The paper gives neither positions nor uncertainties, only that the landmarks lie to the left, in front and to the right
front, and that the best place lies between landmarks 2 and 3. Here the camera moves in a plane with a known heading and
measures bearings. Two choices decide: whether a landmark is as uncertain across the line of sight as along it
(`isotropic`) or long along it, as after one sighting; and whether the camera sees all around or only to the front.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Toy:
    """The scene; the start is the origin, the front is +Y. L landmarks."""

    bearings: tuple[float, ...] = (np.pi, np.pi / 2.0, np.pi / 4.0)
    """(L,) directions of the landmarks from the start [rad]: left, front, right front."""
    ranges: tuple[float, ...] = (1.5, 1.5, 1.5)
    """(L,) distances [m]."""
    range_ratio: float = 0.2
    """Standard deviation of a landmark's range over the range."""
    isotropic: bool = True
    """A landmark is as uncertain across the line of sight as along it; otherwise across by one bearing's noise."""
    half_view: float = np.radians(48.0)
    """Half the angle of view about +Y [rad]; pi: all around."""
    bearing_std: float = 0.01
    """Of a measured bearing [rad]."""
    position_std: float = 0.02
    """Of the camera's start, each axis [m]."""
    motion_std: float = 0.02
    """Added by the move, each axis [m]."""
    step: float = 0.3
    """Length of the move [m], the paper's 30 cm."""

    @property
    def landmarks(self) -> Array:
        """(L, 2) m."""
        return np.array(self.ranges)[:, None] * direction(np.array(self.bearings))

    @property
    def covariance(self) -> Array:
        """(2 + 2 L, 2 + 2 L) of camera and landmarks, y_i = p + r_i e(theta_i), before the move."""
        L = len(self.ranges)
        G = np.tile(np.eye(2), (1 + L, 1))
        P = self.position_std**2 * G @ G.T
        for i, (r, theta) in enumerate(zip(self.ranges, self.bearings)):
            along, across = direction(theta), direction(theta + np.pi / 2.0)
            block = slice(2 + 2 * i, 4 + 2 * i)
            ratio_across = self.range_ratio if self.isotropic else self.bearing_std
            P[block, block] += (self.range_ratio * r) ** 2 * np.outer(along, along)
            P[block, block] += (ratio_across * r) ** 2 * np.outer(across, across)
        return P


def information(toy: Toy, positions: Array) -> Array:
    """I(x; z) = 1/2 log2(|S| / |R|) [bit] of the bearings measured at `positions` (..., 2) after the move, (...)."""
    P = toy.covariance
    P[:2, :2] += toy.motion_std**2 * np.eye(2)
    L = len(toy.ranges)
    d = toy.landmarks - positions[..., None, :]  # (..., L, 2)
    H_y = np.stack((-d[..., 1], d[..., 0]), axis=-1) / np.sum(d * d, axis=-1, keepdims=True)
    H_y[np.abs(np.arctan2(d[..., 0], d[..., 1])) > toy.half_view] = 0.0  # out of view: tells nothing
    H = np.zeros((*positions.shape[:-1], L, len(P)))
    for i in range(L):
        H[..., i, :2], H[..., i, 2 + 2 * i : 4 + 2 * i] = -H_y[..., i, :], H_y[..., i, :]
    S = H @ P @ np.swapaxes(H, -1, -2) / toy.bearing_std**2 + np.eye(L)
    return 0.5 * np.linalg.slogdet(S)[1] / np.log(2.0)


def field(toy: Toy, xs: Array, ys: Array) -> Array:
    """(len(ys), len(xs)) bits at every place of a grid [m]."""
    return information(toy, np.stack(np.meshgrid(xs, ys), axis=-1))


def ring(toy: Toy, count: int = 360) -> tuple[Array, Array]:
    """Directions (count,) of a move [rad] and what each would teach (count,) [bit]."""
    angles = np.linspace(-np.pi, np.pi, count, endpoint=False)
    return angles, information(toy, toy.step * direction(angles))


def best_direction(toy: Toy, count: int = 360) -> float:
    """The direction of the move that teaches the most [rad]."""
    angles, bits = ring(toy, count)
    return float(angles[bits.argmax()])


def lies_between(toy: Toy, first: int = 1, second: int = 2) -> bool:
    """Whether the best direction lies in the angle between two landmarks as seen from the start."""
    low, high = sorted((toy.bearings[first], toy.bearings[second]))
    return low <= best_direction(toy) <= high


def drawn(seed: int, isotropic: bool = True, half_view: float = np.pi) -> Toy:
    """Another scene of the same kind: directions within 15 degrees, ranges 0.75 to 1.5 times, ratios 0.1 to 0.5."""
    rng = np.random.default_rng(seed)
    toy = Toy()
    return Toy(
        bearings=tuple(np.array(toy.bearings) + np.radians(rng.uniform(-15.0, 15.0, len(toy.bearings)))),
        ranges=tuple(np.array(toy.ranges) * rng.uniform(0.75, 1.5, len(toy.ranges))),
        range_ratio=float(rng.uniform(0.1, 0.5)),
        isotropic=isotropic,
        half_view=half_view,
    )


def direction(angle: float | Array) -> Array:
    """Unit vector(s) (..., 2) of an angle [rad]."""
    return np.stack((np.cos(angle), np.sin(angle)), axis=-1)
