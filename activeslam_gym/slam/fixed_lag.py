"""`fixed-lag`: incremental smoothing by GTSAM (Kaess et al., iSAM2, IJRR 2012). The lag is the whole episode.

The variables are the camera's poses, one a frame, and the landmarks: azimuth, elevation and inverse depth from a fixed
world point, the camera's estimated position at their first detection. Two successive poses hold the velocities, since
p_k = p_{k-1} + dt v_k and R_k = Exp(dt w_k) R_{k-1}. So the process noise of `motion` is a factor on three poses.

GTSAM perturbs a pose (4, 4) on the right: R Exp(omega) and p + R t, in the order omega, t.
"""

import copy
from typing import Any

import numpy as np

from activeslam_gym.camera import View, camera_of, ray_from_pixel
from activeslam_gym.config import KNOWN, Scenario
from activeslam_gym.geometry import rotation_error, rotation_matrix, so3_left_jacobian
from activeslam_gym.kernels import Record, compiled
from activeslam_gym.motion import CAMERA_DIM, POSITION, QUATERNION, VELOCITY, motion_of, transition
from activeslam_gym.slam.belief import angles_of, bearing
from activeslam_gym.slam.estimate import Estimate
from activeslam_gym.slam.estimator import Measurements
from activeslam_gym.slam.sight import inverse_depth_measurement, point_measurement

FIXED_LAG = "fixed-lag"
RELINEARISED_EVERY = 10
"""Frames between relinearisations."""
RELINEARISATION_THRESHOLD = 0.01
"""A variable that has moved by more [m, rad, 1/m] is then relinearised."""
LEAST_INVERSE_DEPTH = 0.02
"""An estimate's landmarks are at most at the inverse of this [1/m]."""
FREE_ANGLE_STD = 10.0
"""Prior of a landmark's azimuth and elevation [rad]: none to speak of."""


class FixedLag:
    """An `Estimator` for known data association and measurements that are pixels.

    Raises:
        ImportError: GTSAM is not installed.
        ValueError: the scenario has another association, or the sensor other measurements.
    """

    def __init__(self, scenario: Scenario, fiducials: np.ndarray, sensor: Any) -> None:
        try:
            import gtsam
        except ImportError as error:
            told = f"the estimator {FIXED_LAG!r} needs GTSAM: pip install 'activeslam-gym[gtsam]' (Python >= 3.11)"
            raise ImportError(told) from error
        if scenario.association != KNOWN or np.shape(sensor.noise) != (2, 2):
            raise ValueError(
                f"the estimator {FIXED_LAG!r} needs scenario.association {KNOWN!r}, and measurements that are pixels"
            )
        self._gtsam, self._scenario, self._fiducials = gtsam, scenario, fiducials
        self._lens, self._motion = camera_of(scenario), motion_of(scenario, 1.0)

    def reset(self, mean: np.ndarray, covariance: np.ndarray) -> None:
        """Begin an episode."""
        gtsam, dt = self._gtsam, self._scenario.frame_time
        settings = gtsam.ISAM2Params()
        settings.relinearizeSkip = RELINEARISED_EVERY
        settings.setRelinearizeThreshold(RELINEARISATION_THRESHOLD)
        self._isam, self._graph, self._values = gtsam.ISAM2(settings), gtsam.NonlinearFactorGraph(), gtsam.Values()
        self._anchors = np.zeros((0, 3))
        self._mean, self._dt, self._frame, self._time = mean.copy(), dt, 1, 0.0
        x, keys = self._mean, [self._pose(0), self._pose(1)]
        self._add_pose(keys[0], transition(np.concatenate((x[:7], -x[7:])), np.zeros(6), dt))
        self._add_pose(keys[1], x)

        def error(this: Any, values: Any, jacobians: Any) -> np.ndarray:
            found, J = camera_state(values.atPose3(keys[0]), values.atPose3(keys[1]), dt)
            _write(jacobians, J, 6, 6)
            return np.concatenate((found[:3] - x[:3], rotation_error(found[3:7], x[3:7]), found[7:] - x[7:]))

        self._graph.add(gtsam.CustomFactor(gtsam.noiseModel.Gaussian.Covariance(covariance), keys, error))

    def predict(self, u: np.ndarray, dt: float, contact: bool = False) -> None:
        """Go on by ``dt`` seconds."""
        self._settle()
        gtsam, motion, before, change = self._gtsam, self._motion, self._dt, dt * u
        self._mean = transition(self._camera()[0], u, dt)
        self._dt, self._time, self._frame = dt, self._time + dt, self._frame + 1
        stds = dt * np.repeat((motion.filter_acceleration_std, motion.filter_angular_acceleration_std), 3)
        if contact:
            stds[:3] = np.hypot(stds[:3], self._mean[VELOCITY])
        keys = [self._pose(self._frame - i) for i in (2, 1, 0)]

        def error(this: Any, values: Any, jacobians: Any) -> np.ndarray:
            A, B, C = (values.atPose3(key).matrix() for key in keys)
            changed, J = velocity_change(A, B, C, before, dt)
            _write(jacobians, J, 6, 6, 6)
            return changed - change

        self._graph.add(gtsam.CustomFactor(gtsam.noiseModel.Diagonal.Sigmas(stds), keys, error))
        self._add_pose(keys[-1], self._mean)

    def update(self, measurements: Measurements) -> np.ndarray:
        """Update, and initialise the landmarks that are detected for the first time."""
        used = np.where(measurements.ids >= -len(self._fiducials), measurements.ids, 0)
        for m in np.flatnonzero(measurements.ids == 0).tolist():
            if len(self._anchors) < self._scenario.landmark_count:
                used[m] = self._initialise(measurements.values[m])
        order = np.concatenate((np.flatnonzero(used < 0), np.flatnonzero(used > 0)))
        if len(order):
            self._measure(used[order], measurements.values[order], measurements.noise[order])
        self._settle()
        return used

    def estimate(self) -> Estimate:
        """The present state estimate."""
        self._settle()
        keys, n = self._last(), len(self._anchors)
        camera, J = self._camera()
        P = self._isam.jointMarginalCovariance(keys).fullMatrix()
        lines = np.array([self._isam.calculateEstimatePoint3(key) for key in keys[2:]]).reshape(n, 3)
        lines[:, 2] = np.maximum(lines[:, 2], LEAST_INVERSE_DEPTH)
        G, points = np.zeros((CAMERA_DIM + 3 * n, CAMERA_DIM + 3 * n)), np.empty((n, 3))
        G[:CAMERA_DIM, :CAMERA_DIM] = J
        for k, at in enumerate(range(CAMERA_DIM, len(G), 3)):
            points[k], G[at : at + 3, at : at + 3] = point_of(self._anchors[k], lines[k])
        mapped = np.sqrt(P.diagonal()[CAMERA_DIM + 2 :: 3]) < self._scenario.mapped_depth_ratio * lines[:, 2]
        ids = np.arange(1, n + 1)
        return Estimate(camera, ids, points, G @ P @ G.T, mapped, np.zeros(n, bool), self._time)

    def copy(self) -> "FixedLag":
        """An independent copy."""
        self._settle()
        other = copy.copy(self)
        other._isam = self._gtsam.ISAM2(self._isam)
        other._graph, other._values = self._gtsam.NonlinearFactorGraph(), self._gtsam.Values()
        return other

    def _initialise(self, z: np.ndarray) -> int:
        """A landmark at the pixel ``z`` (2,); its id."""
        self._anchors = np.vstack((self._anchors, self._mean[POSITION]))
        id, scenario, noise = len(self._anchors), self._scenario, self._gtsam.noiseModel.Diagonal
        ray = rotation_matrix(self._mean[QUATERNION]) @ ray_from_pixel(self._lens, z)
        line = np.array((*angles_of(ray, np.empty((2, 3))), scenario.inverse_depth_mean))
        stds = np.array((FREE_ANGLE_STD, FREE_ANGLE_STD, scenario.inverse_depth_std))
        self._values.insert(self._landmark(id), line)
        self._graph.addPriorPoint3(self._landmark(id), line, noise.Sigmas(stds))
        return id

    def _measure(self, ids: np.ndarray, pixels: np.ndarray, noise: np.ndarray) -> None:
        """Add the factor of a frame's measurements (M,), those of fiducials first."""
        lens, M, landmarks = self._lens, len(ids), ids[ids > 0]
        known, anchors = self._fiducials[-1 - ids[ids < 0]], self._anchors[landmarks - 1]
        keys = [self._pose(self._frame), *(self._landmark(id) for id in landmarks.tolist())]
        R = np.zeros((M, 2, M, 2))
        R[np.arange(M), :, np.arange(M)] = noise

        def error(this: Any, values: Any, jacobians: Any) -> np.ndarray:
            lines = np.array([values.atPoint3(key) for key in keys[1:]]).reshape(-1, 3)
            z_hat, J = measured(lens, values.atPose3(keys[0]).matrix(), known, anchors, lines)
            _write(jacobians, J, 6, *[3] * len(lines))
            return np.nan_to_num(z_hat - pixels).ravel()

        model = self._gtsam.noiseModel.Gaussian.Covariance(R.reshape(2 * M, 2 * M))
        self._graph.add(self._gtsam.CustomFactor(model, keys, error))

    def _settle(self) -> None:
        """Take in the factors that are new; the present state and the map are eliminated last."""
        if self._graph.size():
            groups = self._gtsam.KeyGroupMap()
            for key in self._last():
                groups.insert2(key, 1)
            self._isam.update(self._graph, self._values, constrainedKeys=groups)
            self._graph, self._values = self._gtsam.NonlinearFactorGraph(), self._gtsam.Values()

    def _camera(self) -> tuple[np.ndarray, np.ndarray]:
        A, B = (self._isam.calculateEstimatePose3(self._pose(self._frame - i)) for i in (1, 0))
        return camera_state(A, B, self._dt)

    def _last(self) -> list[int]:
        """The keys of the last two poses and of the landmarks."""
        poses = [self._pose(self._frame - 1), self._pose(self._frame)]
        return poses + [self._landmark(id) for id in range(1, len(self._anchors) + 1)]

    def _add_pose(self, key: int, x: np.ndarray) -> None:
        gtsam = self._gtsam
        self._values.insert(key, gtsam.Pose3(gtsam.Rot3.Quaternion(*x[QUATERNION]), x[POSITION]))

    def _pose(self, frame: int) -> int:
        return int(self._gtsam.symbol("x", frame))

    def _landmark(self, id: int) -> int:
        return int(self._gtsam.symbol("l", id))


def _write(jacobians: Any, J: np.ndarray, *widths: int) -> None:
    """Give GTSAM the blocks of columns of ``J``, where it asks for them."""
    if jacobians is not None:
        at = 0
        for i, width in enumerate(widths):
            jacobians[i] = np.asfortranarray(J[:, at : at + width])
            at += width


def camera_state(A: Any, B: Any, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """The camera (13,) at the pose ``B``, ``dt`` seconds after ``A``, and the Jacobian (12, 12) of its tangent."""
    M_b, q = B.matrix(), B.rotation().toQuaternion()
    v, J_v = velocity(A.matrix(), M_b, dt)
    J = np.zeros((CAMERA_DIM, CAMERA_DIM))
    J[:3, 9:] = J[3:6, 6:9] = M_b[:3, :3]
    J[6:] = J_v
    return np.concatenate((M_b[:3, 3], (q.w(), q.x(), q.y(), q.z()), v)), J


def point_of(anchor: np.ndarray, line: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The world point (3,) of azimuth, elevation and inverse depth (3,) from the ``anchor`` (3,), and its Jacobian."""
    m, m_azimuth, m_elevation = np.array(bearing(line[0], line[1]))
    return anchor + m / line[2], np.stack((m_azimuth, m_elevation, -m / line[2]), axis=1) / line[2]


@compiled
def velocity(A: np.ndarray, B: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """v and w (6,) of the motion from the pose ``A`` (4, 4) to ``B`` in ``dt`` seconds, and its Jacobian (6, 12).

    w dt = Log(R_B R_A^T), whose derivative is J_r^{-1} R_A (omega_B - omega_A) with J_r(phi) = J_l(-phi).
    """
    out, J = np.empty(6), np.zeros((6, 12))
    R_A, R_B = A[:3, :3].copy(), B[:3, :3].copy()
    R = R_B @ R_A.T
    axis = 0.5 * np.array((R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]))
    sine = np.sqrt(np.sum(axis * axis))
    angle = np.arctan2(sine, 0.5 * (R[0, 0] + R[1, 1] + R[2, 2] - 1.0))
    phi = axis * (angle / sine if sine > 1e-9 else 1.0)
    out[:3], out[3:] = (B[:3, 3] - A[:3, 3]) / dt, phi / dt
    J[:3, 3:6], J[:3, 9:] = -R_A / dt, R_B / dt
    J[3:, 6:9] = np.linalg.solve(so3_left_jacobian(-phi), R_A) / dt
    J[3:, :3] = -J[3:, 6:9]
    return out, J


@compiled
def velocity_change(
    A: np.ndarray, B: np.ndarray, C: np.ndarray, dt_B: float, dt_C: float
) -> tuple[np.ndarray, np.ndarray]:
    """The change (6,) of v and w at the pose ``B`` (4, 4) between ``A`` and ``C``, and its Jacobian (6, 18)."""
    v_B, J_B = velocity(A, B, dt_B)
    v_C, J_C = velocity(B, C, dt_C)
    J = np.zeros((6, 18))
    J[:, :12] -= J_B
    J[:, 6:] += J_C
    return v_C - v_B, J


@compiled
def measured(
    lens: Record, X: np.ndarray, known: np.ndarray, anchors: np.ndarray, lines: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (K + n, 2) from the pose ``X`` (4, 4), and their Jacobian (2 (K + n), 6 + 3 n).

    They are of ``known`` points (K, 3), and of landmarks with those ``anchors`` and ``lines``, (n, 3) each. NaN, with
    no derivative, where a point is not in front of the camera.
    """
    K, n = known.shape[0], lines.shape[0]
    R_WC, pixels, J = X[:3, :3].copy(), np.full((K + n, 2), np.nan), np.zeros((2 * (K + n), 6 + 3 * n))
    view = View(lens, X[:3, 3].copy(), R_WC, np.zeros((0, 2, 3)))
    z, H_x, H_y, feature = np.empty(2), np.zeros((2, 6)), np.zeros((2, 6)), np.empty(6)
    for k in range(K + n):
        if k < K:
            seen = point_measurement(view, known[k], z, H_x, H_y)
        else:
            feature[:3], feature[3:] = anchors[k - K], lines[k - K]
            seen = inverse_depth_measurement(view, feature, z, H_x, H_y)
        if seen:
            pixels[k], rows = z, J[2 * k : 2 * k + 2]
            rows[:, :3], rows[:, 3:6] = H_x[:, 3:].copy() @ R_WC, H_x[:, :3].copy() @ R_WC
            if k >= K:
                rows[:, 6 + 3 * (k - K) : 9 + 3 * (k - K)] = H_y[:, 3:]
    return pixels, J
