"""An estimator of your own: a plain EKF in NumPy, given the data association, behind the same environment."""

from typing import Any

import gymnasium as gym
import numpy as np
from scipy.linalg import block_diag

import baselines
from activeslam_gym import Scenario
from activeslam_gym.camera import camera_of, ray_from_pixel
from activeslam_gym.evaluation import run_episode
from activeslam_gym.geometry import rotate_left, rotation_matrix
from activeslam_gym.motion import motion_of, process_covariance, transition, transition_jacobian
from activeslam_gym.slam.belief import bearing
from activeslam_gym.slam.estimate import Estimate
from activeslam_gym.slam.estimator import ESTIMATORS, Measurements


@ESTIMATORS.register("numpy-ekf")
class NumpyEkf:
    """State: camera (13,), and six numbers a landmark: anchor (3), azimuth, elevation, inverse depth."""

    def __init__(self, scenario: Scenario, fiducials: np.ndarray, sensor: Any) -> None:
        self.scenario, self.fiducials, self.sensor = scenario, fiducials, sensor
        self.lens, self.motion = camera_of(scenario), motion_of(scenario, 1.0)

    def reset(self, mean: np.ndarray, covariance: np.ndarray) -> None:
        self.x, self.P, self.y = mean.copy(), covariance.copy(), np.zeros((0, 6))
        self.ids, self.time, self.next_id = np.zeros(0, int), 0.0, 1

    def predict(self, u: np.ndarray, dt: float, contact: bool = False) -> None:
        if contact:
            self.P[6:9, 6:9] += np.diag((self.x[7:10] + dt * u[:3]) ** 2)
        self.x, self.time = transition(self.x, u, dt), self.time + dt
        F = np.eye(len(self.P))
        F[:12, :12] = transition_jacobian(self.x[10:13], dt)
        self.P = F @ self.P @ F.T
        self.P[:12, :12] += process_covariance(self.motion, F[:12, :12], dt)

    def update(self, measurements: Measurements) -> np.ndarray:
        used: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
        matched = np.zeros(len(measurements.ids), int)
        for m, (id, value, R) in enumerate(zip(measurements.ids, measurements.values, measurements.noise)):
            known = np.flatnonzero(self.ids == id)
            if not (len(known) or -len(self.fiducials) <= id < 0):
                continue
            k = known[0] if len(known) else None
            z_hat, H_x, H_y = self.sensor.predict(self.x, self.fiducials[-1 - id] if k is None else point_of(self.y[k]))
            H = np.zeros((len(value), len(self.P)))
            H[:, :6] = H_x
            if k is not None:
                H[:, 12 + 6 * k : 18 + 6 * k] = H_y @ jacobian(point_of, self.y[k])
            if np.isfinite(z_hat).all():
                used.append((value - z_hat, H, R))
                matched[m] = id
        if used:
            innovations, rows, noises = zip(*used)
            H, R = np.vstack(rows), block_diag(*noises)
            K = np.linalg.solve(H @ self.P @ H.T + R, H @ self.P).T
            self.x, self.y = shifted(self.x, self.y, K @ np.concatenate(innovations))
            I_KH = np.eye(len(self.P)) - K @ H
            self.P = I_KH @ self.P @ I_KH.T + K @ R @ K.T
        for m in np.flatnonzero(measurements.ids == 0).tolist():
            if len(self.ids) < self.scenario.landmark_count:
                matched[m] = self.initialise(measurements.values[m], measurements.noise[m])
        return matched

    def initialise(self, value: np.ndarray, R: np.ndarray) -> int:
        rho, rho_std = self.scenario.inverse_depth_mean, self.scenario.inverse_depth_std
        if hasattr(self.sensor, "inverse_depth"):  # a sensor that measures the distance
            rho, rho_std = self.sensor.inverse_depth(value)

        def landmark(v: np.ndarray) -> np.ndarray:  # of a change of position and rotation, and of the pixel
            ray = rotation_matrix(rotate_left(v[3:6], self.x[3:7])) @ ray_from_pixel(self.lens, value[:2] + v[6:])
            angles = np.arctan2(ray[0], ray[2]), np.arctan2(ray[1], np.hypot(ray[0], ray[2]))
            return np.array((*(self.x[:3] + v[:3]), *angles, rho))

        J, n = jacobian(landmark, np.zeros(8)), len(self.P)
        G = np.vstack((np.eye(n), np.zeros((6, n))))
        G[n:, :6] = J[:, :6]
        self.P, self.y = G @ self.P @ G.T, np.vstack((self.y, landmark(np.zeros(8))))
        self.P[n:, n:] += J[:, 6:] @ R[:2, :2] @ J[:, 6:].T
        self.P[-1, -1] += rho_std**2
        self.ids, self.next_id = np.append(self.ids, self.next_id), self.next_id + 1
        return int(self.ids[-1])

    def estimate(self) -> Estimate:
        n = len(self.ids)
        T = np.zeros((12 + 3 * n, len(self.P)))
        T[:12, :12] = np.eye(12)
        for k in range(n):
            T[12 + 3 * k : 15 + 3 * k, 12 + 6 * k : 18 + 6 * k] = jacobian(point_of, self.y[k])
        depth_std = np.sqrt(self.P.diagonal()[17::6])
        mapped = depth_std < self.scenario.mapped_depth_ratio * self.y[:, 5]
        points = np.array([point_of(y) for y in self.y]).reshape(-1, 3)
        return Estimate(self.x, self.ids, points, T @ self.P @ T.T, mapped, np.zeros(n, bool), self.time)


def point_of(y: np.ndarray) -> np.ndarray:
    """The world point (3,) of a landmark (6,): anchor + m(azimuth, elevation) / inverse depth."""
    return y[:3] + np.array(bearing(y[3], y[4])[0]) / y[5]


def jacobian(f: Any, x: np.ndarray, step: float = 1e-6) -> np.ndarray:
    """d f / d x by central differences."""
    return np.stack([(f(x + d) - f(x - d)) / (2 * step) for d in step * np.eye(len(x))], axis=1)


def shifted(x: np.ndarray, y: np.ndarray, delta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean ⊞ delta: the rotation is perturbed in the world frame; inverse depths stay positive."""
    quaternion = rotate_left(delta[3:6], x[3:7])
    x = np.concatenate((x[:3] + delta[:3], quaternion / np.linalg.norm(quaternion), x[7:] + delta[6:12]))
    y = y + delta[12:].reshape(-1, 6)
    y[:, 5] = np.maximum(y[:, 5], 0.02)
    return x, y


if __name__ == "__main__":
    env: Any = gym.make("ActiveSLAM-v0", scenario={"estimator": "numpy-ekf", "association": "known"}, duration=5.0)
    run = run_episode(env, baselines.make("mi-mi", env), seed=0)
    print(f"log score {run.log_score[-1]:.0f} bits, position error {100 * run.position_error[-1]:.1f} cm")
