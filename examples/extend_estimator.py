"""An estimator of your own: a plain EKF in NumPy, given the data association."""

from typing import Any

import numpy as np

from activeslam_gym.camera import camera_of
from activeslam_gym.geometry import rotate_left
from activeslam_gym.motion import motion_of, process_covariance, transition, transition_jacobian
from activeslam_gym.slam.belief import bearing
from activeslam_gym.slam.ekf import new_landmark
from activeslam_gym.slam.estimate import Estimate


class NumpyEkf:
    def __init__(self, scenario: Any, fiducials: np.ndarray, sensor: Any) -> None:
        self.scenario, self.fiducials, self.sensor = scenario, fiducials, sensor
        self.lens, self.motion = camera_of(scenario), motion_of(scenario, 1.0)
        self.prior = scenario.inverse_depth_mean, scenario.inverse_depth_std

    def reset(self, mean: np.ndarray, covariance: np.ndarray) -> None:
        self.x, self.P = mean.copy(), covariance.copy()
        self.y = np.zeros((0, 6))  # of each landmark: anchor (3), azimuth, elevation, inverse depth

    def predict(self, u: np.ndarray, dt: float, contact: bool = False) -> None:
        self.x, F = transition(self.x, u, dt), np.eye(len(self.P))
        F[:12, :12] = transition_jacobian(self.x[10:13], dt)
        self.P = F @ self.P @ F.T
        self.P[:12, :12] += process_covariance(self.motion, F[:12, :12], dt)
        self.P[6:9, 6:9] += contact * np.diag(self.x[7:10] ** 2)

    def update(self, measurements: Any) -> np.ndarray:
        for value, R, id in zip(*measurements):
            if id == 0 or id < -len(self.fiducials):  # of nothing known yet, or of clutter
                continue
            H = np.zeros((len(value), len(self.P)))
            y, T = point_of(self.y[id - 1]) if id > 0 else (self.fiducials[-1 - id], None)
            z_hat, H[:, :6], H_y = self.sensor.predict(self.x, y)
            if id > 0:
                H[:, 6 + 6 * id : 12 + 6 * id] = H_y @ T
            if np.isfinite(z_hat).all():
                K = np.linalg.solve(H @ self.P @ H.T + R, H @ self.P).T
                I_KH = np.eye(len(self.P)) - K @ H
                delta, P = K @ (value - z_hat), I_KH @ self.P @ I_KH.T + K @ R @ K.T
                self.P = 0.5 * (P + P.T)
                q = rotate_left(delta[3:6], self.x[3:7])
                self.x = np.concatenate((self.x[:3] + delta[:3], q / np.linalg.norm(q), self.x[7:] + delta[6:12]))
                self.y += delta[12:].reshape(-1, 6)
                self.y[:, 5] = np.maximum(self.y[:, 5], 0.02)
        matched, z, R = measurements.ids.copy(), measurements.values, measurements.noise
        for m in np.flatnonzero(matched == 0)[: self.scenario.landmark_count - len(self.y)]:
            mean, J, Q = new_landmark(self.sensor, self.lens, self.x, z[m], R[m], *self.prior)
            G = np.vstack((np.eye(len(self.P)), np.pad(J, ((0, 0), (0, len(self.P) - 12)))))
            self.y, self.P = np.vstack((self.y, mean)), G @ self.P @ G.T
            self.P[-6:, -6:] += Q
            matched[m] = len(self.y)
        return matched

    def estimate(self) -> Estimate:
        n, points, T = len(self.y), np.zeros((len(self.y), 3)), np.eye(12 + 3 * len(self.y), len(self.P))
        for k, y in enumerate(self.y):
            points[k], T_k = point_of(y)
            T[12 + 3 * k : 15 + 3 * k, 12:] = np.kron(np.eye(n)[k], T_k)
        mapped = np.sqrt(self.P.diagonal()[17::6]) < self.scenario.mapped_depth_ratio * self.y[:, 5]
        return Estimate(self.x, np.arange(1, n + 1), points, T @ self.P @ T.T, mapped, np.zeros(n, bool))


def point_of(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    m = np.array(bearing(y[3], y[4]))
    return y[:3] + m[0] / y[5], np.column_stack((np.eye(3), m[1] / y[5], m[2] / y[5], -m[0] / y[5] ** 2))
