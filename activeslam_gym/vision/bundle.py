"""Bundle adjustment of a few cameras and of points by their direction and inverse depth from the world's origin.

A point d / rho, with |d| = 1, is seen from the camera at p along R^T (d - rho p), so that points at infinity are like
all others. Residuals are angles between bearings, whatever the lens. The first camera is fixed; the unit of length is
the one in which the mean of rho is `UNIT`: bearings tell of no other.
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation

UNIT = 1.5
"""Mean inverse depth of the points."""
_CAUCHY = 2.0  # deviations from which a residual counts as an outlier
_GAUGE = 1e6  # weight of the mean inverse depth
_ENOUGH = 1e-3  # gain of an iteration under which it is the last
_POSE_ROUNDS = 6  # iterations of a camera alone
_RIDGE = 1e-6  # damping of equations that leave the unit open
_BEHIND = 2.0  # residual of a point behind a camera [rad]


class Geometry(NamedTuple):
    """K cameras and N points; its tangent has, of all cameras but the first, position and rotation (world frame), then
    of each point two angles in the plane of `tangents` and the inverse depth, and last what is free of the ``lens``."""

    R_WC: np.ndarray  # (K, 3, 3)
    p: np.ndarray  # (K, 3)
    d: np.ndarray  # (N, 3)
    rho: np.ndarray  # (N,)
    lens: np.ndarray = np.zeros(0)  # (L,) unknowns of the lens, see `Bundle`

    def moved(self, step: np.ndarray) -> "Geometry":
        """The same, shifted by a ``step`` (6 (K - 1) + 3 N + L,) of the tangent, in the unit of the module."""
        K, N = len(self.p), len(self.d)
        cameras, points, lens = np.split(step, (6 * (K - 1), 6 * (K - 1) + 3 * N))
        cameras, points = np.concatenate((np.zeros(6), cameras)).reshape(K, 6), points.reshape(N, 3)
        R = Rotation.from_rotvec(cameras[:, 3:]).as_matrix() @ self.R_WC
        d = self.d + (tangents(self.d) @ points[:, :2, None])[..., 0]
        d /= np.linalg.norm(d, axis=1)[:, None]
        return Geometry(R, self.p + cameras[:, :3], d, self.rho + points[:, 2], self.lens + lens).in_unit()

    def in_unit(self) -> "Geometry":
        """The same with the mean inverse depth `UNIT`; a mirror image, all behind the cameras, is turned over."""
        mean = float(self.rho.mean())
        return self if abs(mean) < 1e-9 else self._replace(p=self.p * mean / UNIT, rho=self.rho * UNIT / mean)


def tangents(d: np.ndarray) -> np.ndarray:
    """(..., 3, 2) two unit vectors across each of the unit vectors ``d`` (..., 3), and each other."""
    x, y, z = np.moveaxis(d, -1, 0)
    zero = np.zeros_like(x)
    u = np.where(np.abs(x) < 0.6, (zero, z, -y), (-z, zero, x))  # d x (1, 0, 0), or d x (0, 1, 0)
    u /= np.linalg.norm(u, axis=0)
    v = y * u[2] - z * u[1], z * u[0] - x * u[2], x * u[1] - y * u[0]  # of one vector, NumPy's cross takes 60 us more
    return np.ascontiguousarray(np.moveaxis(np.array((u, v)), (0, 1), (-1, -2)))


class Bundle:
    """The problem: ``bearings`` (K, N, 3), NaN where a camera does not see a point, with deviations (K, N) [rad].

    With ``stretches`` (K, N, L) the lens is unknown, too: a point's x and y in the camera's axes are multiplied by
    exp(stretches @ x.lens), to be seen along the calculated bearings.
    """

    def __init__(self, bearings: np.ndarray, stds: np.ndarray, stretches: np.ndarray | None = None) -> None:
        self._stretches = stretches
        self.seen = np.isfinite(bearings[..., 0])
        self.bearings = np.where(self.seen[..., None], bearings, (0.0, 0.0, 1.0))
        self._std = np.where(self.seen, stds, 1.0)
        self._across = tangents(self.bearings)

    def fit(self, x: Geometry, rounds: int) -> tuple[Geometry, float]:
        """The geometry of a minimum near ``x``, and its `cost`, by Levenberg and Marquardt's method."""
        x = x.in_unit()
        cost, damping = self.cost(x), 1e-3
        for _ in range(rounds):
            blocks = self._blocks(x)
            while damping < 1e6:
                nearer = x.moved(_step(blocks, damping))
                below = self.cost(nearer)
                if below < cost:
                    break
                damping *= 5.0
            else:
                break
            gain, x, cost, damping = cost - below, nearer, below, max(damping / 5.0, 1e-9)
            if gain < _ENOUGH:
                break
        return x, cost

    def lens_covariance(self, x: Geometry) -> np.ndarray:
        """Covariance (L, L) of ``x.lens`` in a minimum ``x``, by the size of the residuals (their median)."""
        spread = np.median(self.squares(x)[self.seen]) / (2.0 * np.log(2.0))
        freedom = 1.0 - 3.0 * (len(x.p) + 0.5 * len(x.d)) / self.seen.sum()
        own = slice(-len(x.lens), None)
        return spread / freedom * np.linalg.inv(_reduced(self._blocks(x), _RIDGE)[0])[own, own]

    def second_camera(self, x: Geometry, R_WC: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The pose of the second camera of two near the pose ``R_WC`` (3, 3), ``p`` (3,); points are those of ``x``."""
        for _ in range(_POSE_ROUNDS):
            here = Geometry(np.stack((x.R_WC[0], R_WC)), np.stack((x.p[0], p)), x.d, x.rho)
            (H,), _, _, (g,), _ = self._blocks(here)
            step = -np.linalg.solve(H + 1e-9 * np.eye(6), g)
            R_WC, p = Rotation.from_rotvec(step[3:]).as_matrix() @ R_WC, p + step[:3]
        return R_WC, p

    def cost(self, x: Geometry) -> float:
        """-2 log likelihood, but for a constant, of residuals distributed like Cauchy's."""
        return float((_CAUCHY**2 * np.log1p(self.squares(x) / _CAUCHY**2)).sum())

    def squares(self, x: Geometry) -> np.ndarray:
        """(K, N) squared residuals over their variances; 0 where a point is not seen."""
        return (self._residuals(x)[0] ** 2).sum(axis=-1)

    def _residuals(self, x: Geometry) -> tuple[np.ndarray, ...]:
        """Residuals (K, N, 2), the ways d - rho p (K, N, 3) in the world, their lengths, bearings; whether in front."""
        way = x.d - x.rho[:, None] * x.p[:, None]
        q = way @ x.R_WC * self._stretch(x)
        length = np.maximum(np.linalg.norm(q, axis=-1), 1e-9)
        z_hat = q / length[..., None]
        front = (z_hat * self.bearings).sum(axis=-1) > 0.0
        e = (z_hat[..., None, :] @ self._across)[..., 0, :]
        e = np.where(front[..., None], e, _BEHIND) / self._std[..., None]
        return np.where(self.seen[..., None], e, 0.0), way, length, z_hat, front

    def normal_equations(self, x: Geometry) -> tuple[np.ndarray, np.ndarray]:
        """J^T W J and J^T W e in the tangent of ``x``, with the row that fixes the unit."""
        by_camera, both, by_point, g_camera, g_point = self._blocks(x)
        cameras, N, g = g_camera.size, len(by_point), np.concatenate((g_camera.ravel(), g_point.ravel()))
        H, unit = np.zeros((len(g),) * 2), np.zeros(len(g))
        H[:cameras, :cameras], H[cameras:, cameras:] = block_diag(*by_camera), block_diag(*by_point)
        H[:cameras, cameras:] = both.transpose(0, 2, 1, 3).reshape(cameras, 3 * N)
        H[cameras:, :cameras] = H[:cameras, cameras:].T
        unit[cameras + 2 :: 3] = 1.0 / N
        return H + _GAUGE * np.outer(unit, unit), g + _GAUGE * unit * (x.rho.mean() - UNIT)

    def _blocks(self, x: Geometry) -> tuple[np.ndarray, ...]:
        """Of J^T W J the blocks of the cameras but the first (K - 1, 6, 6), of both (K - 1, N, 6, 3) and of the points
        (N, 3, 3); of J^T W e (K - 1, 6) and (N, 3)."""
        e, way, length, z_hat, front = self._residuals(x)
        weight = np.where(self.seen & front, 1.0 / (1.0 + (e**2).sum(axis=-1) / _CAUCHY**2), 0.0)
        # e = B^T q / |q| and q = R^T (d - rho p): de = G^T R^T d(way), G = (I - z z^T) B / |q|
        stretch = self._stretch(x)
        G = self._across - z_hat[..., :, None] * (z_hat[..., None, :] @ self._across)
        G = stretch[..., None] * G / (length * self._std)[..., None, None]
        G = np.swapaxes(x.R_WC[:, None] @ G, -1, -2)
        turn = np.stack([np.cross(way, G[..., a, :]) for a in range(2)], axis=-2)
        A = np.concatenate((-x.rho[:, None, None] * G, -turn), axis=-1)
        C = np.concatenate((G @ tangents(x.d), -G @ x.p[:, None, :, None]), axis=-1)
        A_w, C_w = (np.swapaxes(weight[..., None, None] * J, -1, -2) for J in (A, C))
        g_camera, g_point = (A_w @ e[..., None])[..., 0].sum(axis=1), (C_w @ e[..., None])[..., 0].sum(axis=0)
        blocks = (A_w @ A).sum(axis=1)[1:], (A_w @ C)[1:], (C_w @ C).sum(axis=0), g_camera[1:], g_point
        if self._stretches is None:
            return blocks
        across = (z_hat * length[..., None] * (1.0, 1.0, 0.0) / stretch) @ np.swapaxes(x.R_WC, -1, -2)
        F = G @ (across[..., None] * self._stretches[..., None, :])
        by_camera, by_point = (A_w @ F)[1:].sum(axis=1), (C_w @ F).sum(axis=0)
        F_w = np.swapaxes(weight[..., None, None] * F, -1, -2)
        return *blocks, by_camera, by_point, (F_w @ F).sum(axis=(0, 1)), (F_w @ e[..., None])[..., 0].sum(axis=(0, 1))

    def _stretch(self, x: Geometry) -> np.ndarray:
        """(K, N, 3) or (3,) what points in the camera's axes are multiplied by."""
        if self._stretches is None:
            return np.ones(3)
        across = np.exp(self._stretches @ x.lens)
        return np.stack((across, across, np.ones_like(across)), axis=-1)


def _step(blocks: tuple[np.ndarray, ...], damping: float) -> np.ndarray:
    """The step of Levenberg and Marquardt's method by `Bundle._blocks`."""
    H, g, B, inverse, g_point = _reduced(blocks, damping)
    n, others = 6 * len(blocks[0]), np.linalg.solve(H, g)
    points = -(inverse @ (g_point.ravel() + others @ B).reshape(-1, 3, 1))
    return np.concatenate((others[:n], points.ravel(), others[n:]))


def _reduced(blocks: tuple[np.ndarray, ...], damping: float) -> tuple[np.ndarray, ...]:
    """The damped equations of the cameras and, last, of the lens, from which points are eliminated (Schur)."""
    by_camera, both, by_point, g_camera, g_point, *lens = blocks
    A, C, *own = (
        H + H * (damping * np.eye(len(H.T))) + 1e-9 * np.eye(len(H.T)) for H in (by_camera, by_point, *lens[2:3])
    )
    n, inverse = 6 * len(A), np.linalg.inv(C)
    B, BC = (M.transpose(0, 2, 1, 3).reshape(n, -1) for M in (both, both @ inverse))
    A, g = block_diag(*A), g_camera.ravel()
    if lens:
        columns, rows, _, slope = lens
        side = columns.reshape(n, -1)
        A, g = np.block([[A, side], [side.T, *own]]), np.append(g, slope)
        B, BC = (np.vstack((M, m.reshape(-1, len(slope)).T)) for M, m in ((B, rows), (BC, inverse @ rows)))
    return A - BC @ B.T, BC @ g_point.ravel() - g, B, inverse, g_point


def inverse_depths(first: np.ndarray, last: np.ndarray, p: np.ndarray) -> np.ndarray:
    """(n,) those at which the points that are seen along ``first`` (n, 3) from the origin are nearest to ``last``
    (n, 3), world directions from ``p`` (3,)."""
    a, b = np.cross(last, first), np.cross(last, p)
    return (a * b).sum(axis=1) / np.maximum((b * b).sum(axis=1), 1e-12)
