"""`fixed-lag` and `smoother`: incremental smoothing by GTSAM (Kaess et al., iSAM2, IJRR 2012).

`smoother` keeps every pose of the episode, so that each can be relinearised: the reference. `fixed-lag` marginalises
poses that are older than a lag, and so takes the same time for each frame. What they tell of the rest stays as a linear
factor. Landmarks always stay.

The variables are the camera's rotations and positions, one of each a frame, and the landmarks: azimuth, elevation and
inverse depth from a fixed world point, the camera's estimated position at their first detection. Two successive poses
hold the velocities, since p_k = p_{k-1} + dt v_k and R_k = Exp(dt w_k) R_{k-1}. So the process noise of `motion` is a
factor on three positions, which is linear, and one on three rotations.

Rotation and position are variables of their own: with GTSAM's poses a correction of one bends the other, by more than
the process noise of a frame. GTSAM perturbs a rotation on the right, R Exp(omega).
"""

import copy
from dataclasses import replace
from typing import Any

import numpy as np

from activeslam_gym.camera import View, camera_of, ray_from_pixel
from activeslam_gym.config import KNOWN, Scenario
from activeslam_gym.geometry import rotation_error, rotation_matrix, so3_left_jacobian
from activeslam_gym.kernels import Record, compiled
from activeslam_gym.motion import CAMERA_DIM, POSITION, QUATERNION, VELOCITY, motion_of, transition
from activeslam_gym.slam.belief import angles_of, bearing
from activeslam_gym.slam.estimate import Estimate
from activeslam_gym.slam.estimator import NO_MATCH, Measurements
from activeslam_gym.slam.sight import inverse_depth_measurement, point_measurement

FIXED_LAG, SMOOTHER = "fixed-lag", "smoother"
LAG = 8.0  # poses are marginalised when they are between this [s] and this and `MARGINALISED_EVERY` old
MARGINALISED_EVERY = 2.0  # time between two marginalisations, after each of which all else is relinearised [s]
RELINEARISED_EVERY = 10  # frames between relinearisations
RELINEARISATION_THRESHOLD = 0.02  # a variable that has moved by more [m, rad, 1/m] is then relinearised
LEAST_INVERSE_DEPTH = 0.02  # an estimate's landmarks are at most at the inverse of this [1/m]
MOST_ITERATIONS = 5
"""A frame that moves the camera by more than the threshold, or does not fit, is iterated at most so often."""
LARGEST_MISFIT = 6.0
"""Half the squared residuals of a frame's M numbers are M / 2 on average; over M and this, the frame does not fit."""
CAUCHY = 2.0
"""Deviations of a landmark's prior beyond which it has the tails of Cauchy: a landmark may be very near the camera."""
FREE_ANGLE_STD = 10.0  # prior of a landmark's azimuth and elevation [rad]: none to speak of


class FixedLag:
    """An `Estimator` for known data association and measurements that are pixels.

    Where the system of equations cannot be solved, the estimate stays as it is for the rest of the episode.

    Raises:
        ImportError: GTSAM is not installed.
        ValueError: the scenario has another association, or the sensor other measurements.
    """

    name, lag = FIXED_LAG, LAG
    libraries = ("gtsam",)  # on whose versions its results depend

    def __init__(self, scenario: Scenario, fiducials: np.ndarray, sensor: Any) -> None:
        self.check(scenario)
        if np.shape(sensor.noise) != (2, 2):
            raise ValueError(f"the estimator {self.name!r} needs measurements that are pixels")
        import gtsam

        self._gtsam, self._scenario, self._fiducials = gtsam, scenario, fiducials
        self._lens, self._motion = camera_of(scenario), motion_of(scenario, 1.0)

    @classmethod
    def check(cls, scenario: Scenario) -> None:
        """Raise where it cannot work in the ``scenario``; the environment asks when it is made."""
        if scenario.association != KNOWN:
            raise ValueError(
                f"the estimator {cls.name!r} needs scenario.association {KNOWN!r}, got {scenario.association!r}"
            )
        try:
            import gtsam  # noqa: F401
        except ImportError as error:
            hint = "pip install gtsam, or in a clone: pip install -e '.[gtsam]'"
            raise ImportError(f"the estimator {cls.name!r} needs GTSAM: {hint}") from error

    def reset(self, mean: np.ndarray, covariance: np.ndarray) -> None:
        """Begin an episode."""
        gtsam, dt = self._gtsam, self._scenario.frame_time
        self._isam, self._graph, self._values = self._new_isam(), gtsam.NonlinearFactorGraph(), gtsam.Values()
        self._kept_factors: list[Any] = []
        self._anchors, self._oldest = np.zeros((0, 3)), 0
        self._mean, self._dt, self._frame, self._time, self._failed = mean.copy(), dt, 1, 0.0, False
        self._newest: Any = None
        x, keys = self._mean, [*self._pose(0), *self._pose(1)]
        self._add_pose(0, transition(np.concatenate((x[:7], -x[7:])), np.zeros(6), dt))
        self._add_pose(1, x)

        def error(this: Any, values: Any, jacobians: Any) -> np.ndarray:
            R_A, R_B = (values.atRot3(key) for key in keys[::2])
            p_A, p_B = (values.atPoint3(key) for key in keys[1::2])
            found, J = camera_state(R_A, p_A, R_B, p_B, dt)
            _write(jacobians, J, 3, 3, 3, 3)
            return np.concatenate((found[:3] - x[:3], rotation_error(found[3:7], x[3:7]), found[7:] - x[7:]))

        self._graph.add(gtsam.CustomFactor(gtsam.noiseModel.Gaussian.Covariance(covariance), keys, error))
        self._kept = self.estimate()

    def predict(self, u: np.ndarray, dt: float, contact: bool = False) -> None:
        """Go on by ``dt`` seconds."""
        self._time += dt
        if not self._settled():
            return
        gtsam, motion, before, change = self._gtsam, self._motion, self._dt, dt * u
        self._mean = transition(self._camera()[0], u, dt)
        self._dt, self._frame, self._newest = dt, self._frame + 1, None
        stds = dt * np.repeat((motion.filter_acceleration_std, motion.filter_angular_acceleration_std), 3)
        if contact:
            stds[:3] = np.hypot(stds[:3], self._mean[VELOCITY])
        rotations, positions = zip(*(self._pose(self._frame - i) for i in (2, 1, 0)))
        blocks = (np.eye(3) * scale for scale in (1.0 / before, -1.0 / before - 1.0 / dt, 1.0 / dt))
        terms = [one for pair in zip(positions, blocks) for one in pair]
        accelerated = gtsam.JacobianFactor(*terms, change[:3], gtsam.noiseModel.Diagonal.Sigmas(stds[:3]))
        origin = gtsam.Values()
        for key in positions:
            origin.insertPoint3(key, np.zeros(3))

        def error(this: Any, values: Any, jacobians: Any) -> np.ndarray:
            changed, J = turn_rate_change(*(values.atRot3(key).matrix() for key in rotations), before, dt)
            _write(jacobians, J, 3, 3, 3)
            return changed - change[3:]

        self._graph.add(gtsam.LinearContainerFactor(accelerated, origin))
        self._graph.add(gtsam.CustomFactor(gtsam.noiseModel.Diagonal.Sigmas(stds[3:]), rotations, error))
        self._add_pose(self._frame, self._mean)

    def update(self, measurements: Measurements) -> np.ndarray:
        """Update, and initialise the landmarks that are detected for the first time."""
        used = np.where(measurements.ids >= -len(self._fiducials), measurements.ids, NO_MATCH)
        for m in np.flatnonzero(measurements.ids == 0).tolist():
            if len(self._anchors) < self._scenario.landmark_count:
                used[m] = self._initialise(measurements.values[m])
        order = np.concatenate((np.flatnonzero(used < 0), np.flatnonzero(used > 0)))
        if len(order):
            self._measure(used[order], measurements.values[order], measurements.noise[order])
        return used if self._settled() else np.zeros_like(used)

    def estimate(self) -> Estimate:
        """The present state estimate."""
        if not self._settled():
            return replace(self._kept, time=self._time)
        keys, n = self._last(), len(self._anchors)
        camera, J = self._camera()
        P = self._isam.jointMarginalCovariance(keys).fullMatrix()
        lines = np.array([self._isam.calculateEstimatePoint3(key) for key in keys[4:]]).reshape(n, 3)
        lines[:, 2] = np.maximum(lines[:, 2], LEAST_INVERSE_DEPTH)
        G, points = np.zeros((CAMERA_DIM + 3 * n, CAMERA_DIM + 3 * n)), np.empty((n, 3))
        G[:CAMERA_DIM, :CAMERA_DIM] = J
        write_points(self._anchors, lines, points, G[CAMERA_DIM:, CAMERA_DIM:])
        mapped = np.sqrt(P.diagonal()[CAMERA_DIM + 2 :: 3]) < self._scenario.mapped_depth_ratio * lines[:, 2]
        ids = np.arange(1, n + 1)
        self._kept = Estimate(camera, ids, points, G @ P @ G.T, mapped, np.zeros(n, bool), self._time)
        return self._kept

    def copy(self) -> "FixedLag":
        """An independent copy."""
        self._settled()
        other = copy.copy(self)
        other._isam = self._gtsam.ISAM2(self._isam)
        other._graph, other._values = self._gtsam.NonlinearFactorGraph(), self._gtsam.Values()
        other._kept_factors = self._kept_factors.copy()
        return other

    def _new_isam(self) -> Any:
        settings = self._gtsam.ISAM2Params()
        settings.setFactorization("QR")  # Cholesky fails after some seconds without measurements
        settings.relinearizeSkip = RELINEARISED_EVERY
        settings.setRelinearizeThreshold(RELINEARISATION_THRESHOLD)
        return self._gtsam.ISAM2(settings)

    def _initialise(self, z: np.ndarray) -> int:
        """A landmark at the pixel ``z`` (2,); its id."""
        self._anchors = np.vstack((self._anchors, self._mean[POSITION]))
        id, scenario, noise = len(self._anchors), self._scenario, self._gtsam.noiseModel
        ray = rotation_matrix(self._mean[QUATERNION]) @ ray_from_pixel(self._lens, z)
        line = np.array((*angles_of(ray, np.empty((2, 3))), scenario.inverse_depth_mean))
        stds = np.array((FREE_ANGLE_STD, FREE_ANGLE_STD, scenario.inverse_depth_std))
        self._values.insertPoint3(self._landmark(id), line)
        tails = noise.mEstimator.Cauchy.Create(CAUCHY)
        self._graph.addPriorPoint3(self._landmark(id), line, noise.Robust.Create(tails, noise.Diagonal.Sigmas(stds)))
        return id

    def _measure(self, ids: np.ndarray, pixels: np.ndarray, noise: np.ndarray) -> None:
        """Add the factor of a frame's measurements (M,), those of fiducials first."""
        lens, M, landmarks = self._lens, len(ids), ids[ids > 0]
        known, anchors = self._fiducials[-1 - ids[ids < 0]], self._anchors[landmarks - 1]
        keys = [*self._pose(self._frame), *(self._landmark(id) for id in landmarks.tolist())]
        R = np.zeros((M, 2, M, 2))
        R[np.arange(M), :, np.arange(M)] = noise

        def error(this: Any, values: Any, jacobians: Any) -> np.ndarray:
            lines = np.array([values.atPoint3(key) for key in keys[2:]]).reshape(-1, 3)
            R_WC, p = values.atRot3(keys[0]).matrix(), values.atPoint3(keys[1])
            z_hat, J = measured(lens, R_WC, p, known, anchors, lines)
            _write(jacobians, J, 3, 3, *[3] * len(lines))
            return np.nan_to_num(z_hat - pixels, nan=2.0 * lens.focal).ravel()

        model = self._gtsam.noiseModel.Gaussian.Covariance(R.reshape(2 * M, 2 * M))
        self._newest = self._gtsam.CustomFactor(model, keys, error)
        self._graph.add(self._newest)

    def _settled(self) -> bool:
        """Take in the factors that are new. False where that has failed."""
        if self._graph.size() and not self._failed:
            try:
                self._solve()
                if self.lag < np.inf:
                    self._kept_factors += [self._graph.at(i) for i in range(self._graph.size())]
                    if (self._frame - self._oldest) * self._scenario.frame_time > self.lag + MARGINALISED_EVERY:
                        self._marginalise(self._frame - round(self.lag / self._scenario.frame_time))
            except RuntimeError:  # GTSAM's, of a system that is singular to working precision
                self._failed = True
            self._graph, self._values = self._gtsam.NonlinearFactorGraph(), self._gtsam.Values()
        return not self._failed

    def _solve(self) -> None:
        """Steps of Gauss and Newton, as many as the frame wants; the present state and the map are eliminated last."""
        last, before = self._constrained(), self._mean
        self._isam.update(self._graph, self._values, constrainedKeys=last)
        for _ in range(MOST_ITERATIONS):
            now = self._camera()[0]
            moved = np.concatenate((now[:3] - before[:3], rotation_error(now[3:7], before[3:7])))
            if np.abs(moved).max() < RELINEARISATION_THRESHOLD and self._fits():
                break
            before = now
            self._isam.update(constrainedKeys=last, force_relinearize=True)

    def _marginalise(self, first: int) -> None:
        """Delete the poses before the frame ``first``, and linearise all others again.

        The factors of those poses, linearised at the present estimate, give a linear factor on the rest.
        """
        gtsam, values, kept = self._gtsam, self._isam.calculateEstimate(), []
        old = [key for frame in range(self._oldest, first) for key in self._pose(frame)]
        past, graph, order = gtsam.NonlinearFactorGraph(), gtsam.NonlinearFactorGraph(), gtsam.Ordering()
        for key in old:
            order.push_back(key)
        for factor in self._kept_factors:
            if set(old).isdisjoint(factor.keys()):
                kept.append(factor)
            else:
                past.add(factor)
        _, rest = past.linearize(values).eliminatePartialSequential(order, gtsam.EliminateQR)
        parts = (rest.at(i) for i in range(rest.size()))
        kept += [gtsam.LinearContainerFactor(part, values) for part in parts if part is not None]
        for key in old:
            values.erase(key)
        for factor in kept:
            graph.add(factor)
        self._isam, self._kept_factors, self._oldest = self._new_isam(), kept, first
        self._isam.update(graph, values, constrainedKeys=self._constrained())

    def _constrained(self) -> Any:
        """Eliminates the last two poses and the landmarks last."""
        last = self._gtsam.KeyGroupMap()
        for key in self._last():
            last.insert2(key, 1)
        return last

    def _fits(self) -> bool:
        """Whether the estimate fits the newest measurements; else it is too far from the linearisation."""
        if self._newest is None:
            return True
        values, (rotation, *points) = self._gtsam.Values(), self._newest.keys()
        values.insert(rotation, self._isam.calculateEstimateRot3(rotation))
        for key in points:
            values.insertPoint3(key, self._isam.calculateEstimatePoint3(key))
        return bool(self._newest.error(values) <= self._newest.dim() + LARGEST_MISFIT)

    def _camera(self) -> tuple[np.ndarray, np.ndarray]:
        (r_A, p_A), (r_B, p_B) = self._pose(self._frame - 1), self._pose(self._frame)
        rotation, point = self._isam.calculateEstimateRot3, self._isam.calculateEstimatePoint3
        return camera_state(rotation(r_A), point(p_A), rotation(r_B), point(p_B), self._dt)

    def _last(self) -> list[int]:
        """The keys of the last two poses and of the landmarks."""
        poses = [*self._pose(self._frame - 1), *self._pose(self._frame)]
        return poses + [self._landmark(id) for id in range(1, len(self._anchors) + 1)]

    def _add_pose(self, frame: int, x: np.ndarray) -> None:
        rotation, position = self._pose(frame)
        self._values.insert(rotation, self._gtsam.Rot3.Quaternion(*x[QUATERNION]))
        self._values.insertPoint3(position, x[POSITION])

    def _pose(self, frame: int) -> tuple[int, int]:
        """The keys of rotation and position."""
        return self._gtsam.symbol("r", frame), self._gtsam.symbol("p", frame)

    def _landmark(self, id: int) -> int:
        return int(self._gtsam.symbol("l", id))


class Smoother(FixedLag):
    """The same over the whole episode."""

    name, lag = SMOOTHER, np.inf


def _write(jacobians: Any, J: np.ndarray, *widths: int) -> None:
    """Give GTSAM the blocks of columns of ``J``, where it asks for them."""
    if jacobians is not None:
        at = 0
        for i, width in enumerate(widths):
            jacobians[i] = np.asfortranarray(J[:, at : at + width])
            at += width


def camera_state(R_A: Any, p_A: np.ndarray, R_B: Any, p_B: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """The camera (13,) at the pose B, ``dt`` seconds after A, and the Jacobian (12, 12) of its tangent."""
    w, J_w = turn_rate(R_A.matrix(), R_B.matrix(), dt)
    q, J = R_B.toQuaternion(), np.zeros((CAMERA_DIM, CAMERA_DIM))
    J[:3, 9:] = np.eye(3)
    J[3:6, 6:9] = R_B.matrix()
    J[6:9, 3:6], J[6:9, 9:] = -np.eye(3) / dt, np.eye(3) / dt
    J[9:, :3], J[9:, 6:9] = -J_w, J_w
    return np.concatenate((p_B, (q.w(), q.x(), q.y(), q.z()), (p_B - p_A) / dt, w)), J


@compiled
def write_points(anchors: np.ndarray, lines: np.ndarray, points: np.ndarray, J: np.ndarray) -> None:
    """The world ``points`` (n, 3) of azimuth, elevation and inverse depth (n, 3) from the ``anchors`` (n, 3).

    Their Jacobian goes into ``J`` (3 n, 3 n), block by block.
    """
    for k in range(lines.shape[0]):
        (azimuth, elevation, rho), at = lines[k], 3 * k
        m = bearing(azimuth, elevation)
        for i in range(3):
            points[k, i] = anchors[k, i] + m[0][i] / rho
            J[at + i, at], J[at + i, at + 1], J[at + i, at + 2] = m[1][i] / rho, m[2][i] / rho, -m[0][i] / (rho * rho)


@compiled
def turn_rate(R_A: np.ndarray, R_B: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """w (3,) of the turn from the rotation ``R_A`` (3, 3) to ``R_B`` in ``dt`` seconds, and J (3, 3): dw = J (dB - dA).

    w dt = Log(R_B R_A^T), whose derivative is J_r^{-1} R_A (omega_B - omega_A), with J_r(phi) = J_l(-phi).
    """
    R = R_B @ R_A.T
    axis = 0.5 * np.array((R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]))
    sine = np.sqrt(np.sum(axis * axis))
    angle = np.arctan2(sine, 0.5 * (R[0, 0] + R[1, 1] + R[2, 2] - 1.0))
    phi = axis * (angle / sine if sine > 1e-9 else 1.0)
    return phi / dt, np.linalg.solve(so3_left_jacobian(-phi), np.ascontiguousarray(R_A)) / dt


@compiled
def turn_rate_change(
    R_A: np.ndarray, R_B: np.ndarray, R_C: np.ndarray, dt_B: float, dt_C: float
) -> tuple[np.ndarray, np.ndarray]:
    """The change (3,) of w at the rotation ``R_B`` (3, 3), between ``R_A`` and ``R_C``, and its Jacobian (3, 9)."""
    w_B, J_B = turn_rate(R_A, R_B, dt_B)
    w_C, J_C = turn_rate(R_B, R_C, dt_C)
    J = np.empty((3, 9))
    J[:, :3], J[:, 3:6], J[:, 6:] = J_B, -J_B - J_C, J_C
    return w_C - w_B, J


@compiled
def measured(
    lens: Record, R_WC: np.ndarray, p: np.ndarray, known: np.ndarray, anchors: np.ndarray, lines: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (K + n, 2) from the position ``p`` (3,) with the rotation ``R_WC`` (3, 3).

    They are of ``known`` points (K, 3), and of landmarks with those ``anchors`` and ``lines``, (n, 3) each. Also their
    Jacobian (2 (K + n), 6 + 3 n) by rotation, position and lines. NaN, with no derivative, where a point is not in
    front of the camera.
    """
    K, n = known.shape[0], lines.shape[0]
    pixels, J = np.full((K + n, 2), np.nan), np.zeros((2 * (K + n), 6 + 3 * n))
    view = View(lens, p.copy(), np.ascontiguousarray(R_WC), np.zeros((0, 2, 3)))
    z, H_x, H_y, feature = np.empty(2), np.zeros((2, 6)), np.zeros((2, 6)), np.empty(6)
    for k in range(K + n):
        if k < K:
            seen = point_measurement(view, known[k], z, H_x, H_y)
        else:
            feature[:3], feature[3:] = anchors[k - K], lines[k - K]
            seen = inverse_depth_measurement(view, feature, z, H_x, H_y)
        if seen:
            pixels[k], rows = z, J[2 * k : 2 * k + 2]
            rows[:, :3], rows[:, 3:6] = H_x[:, 3:].copy() @ view.R_WC, H_x[:, :3]
            if k >= K:
                rows[:, 6 + 3 * (k - K) : 9 + 3 * (k - K)] = H_y[:, 3:]
    return pixels, J
