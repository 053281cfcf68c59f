"""The filter in plain Python, for any sensor: the reference of the filter that `envs.step` runs, compiled for pixels.

Everything that a sensor enters is written out here in NumPy, by the sensor's own predictions and Jacobians: predicted
measurements, the iterated update, and initialisation. The motion model, the data association and the care of the map do
not depend on it, and are the compiled functions. A measurement's first two numbers are a pixel: the association uses
them alone.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from activeslam_gym.camera import ray_from_pixel
from activeslam_gym.config import KNOWN, Scenario
from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.motion import CAMERA_DIM, D_POSITION, D_ROTATION, POSITION, QUATERNION
from activeslam_gym.slam.association import associate
from activeslam_gym.slam.belief import INVERSE_DEPTH, KIND_DIM, angles_of, bearing, point_of, reset_belief
from activeslam_gym.slam.detection import NEW, REJECTED
from activeslam_gym.slam.estimate import EKF, EKF_PLAIN, Estimate, Measurements, taken_estimate
from activeslam_gym.slam.filter import Filter, detections_of
from activeslam_gym.slam.kalman import (
    ITERATIONS,
    MINIMUM_INVERSE_DEPTH,
    NONLINEARITY_PX,
    factored_gain,
    invariance_correction,
    left_jacobian,
    predict,
    shift_mean,
    update_covariance,
)
from activeslam_gym.slam.map import (
    add_landmark,
    append_feature,
    convert_and_delete,
    count_misses,
    follow_tracks,
    room_for,
)
from activeslam_gym.slam.restart import contradicted, restart
from activeslam_gym.slam.sight import NEAR, POSE_DIM, PREDICTED, PRODUCT_FRAMES, Sight, sight_of_belief, sight_with

_DEPTHS = 0.2 * 1.15 ** np.arange(35.0)  # where the depth of a new landmark is looked for first: 0.2 to 23 m
_STEPS = 10  # of Gauss and Newton from there


class Ekf:
    """The extended Kalman filter as an `Estimator`, for any ``sensor`` (see `sensors.sensor.Sensor`).

    With the sensor `points` the environment runs the compiled filter instead, see `envs.step`.
    """

    def __init__(self, scenario: Scenario, fiducials: np.ndarray, sensor: Any) -> None:
        self.scenario, self.fiducials, self.sensor = scenario, fiducials, sensor
        self._filter = Filter(scenario, fiducials=fiducials, boxes=getattr(sensor, "boxes", None))
        self.belief, self.models, self.boxes = self._filter.belief, self._filter.models, self._filter.boxes
        self.counts = self._filter.counts

    def reset(self, mean: np.ndarray, covariance: np.ndarray) -> None:
        """Begin an episode."""
        reset_belief(self.belief, mean, covariance)

    def predict(self, u: np.ndarray, dt: float, contact: bool = False) -> None:
        """Go on by ``dt`` seconds: x = f(x, u), P = F P F^T + Q."""
        predict(self.models.motion, self.belief, u, dt, contact)

    def update(self, measurements: Measurements) -> np.ndarray:
        """Associate, update, and initialise features; (M,) what each measurement was matched to."""
        belief, model, counts = self.belief, self.models.filter, self.counts
        values, noise = measurements.values, measurements.noise
        found = detections_of(values[:, :2], noise[:, :2, :2], measurements.ids)
        sight = self.predicted()
        matches = associate(self.models, belief, self.boxes, sight, found, self._is_labelled(), counts)
        count_misses(model.initialisation, belief, len(self.fiducials), sight, matches)
        if contradicted(model.restart, belief, sight, found, matches):
            restart(model.restart, belief)
            counts.restarts += 1
            found["match"] = REJECTED
        elif len(matched := np.flatnonzero(matches >= 0)):
            self.correct(sight.point[matched], values[matches[matched]], noise[matches[matched]])
        convert_and_delete(model.initialisation, belief, counts)
        for i in follow_tracks(self.models.lens, model.initialisation, belief, found):
            found["match"][i] = self.add_landmark(values[i], noise[i])
        return found["match"].copy()

    def estimate(self) -> Estimate:
        """The present state estimate."""
        return taken_estimate(self._filter.arrays())

    def predicted(self) -> Sight:
        """The predicted measurements of the fiducials and features in reach: their pixels, by the sensor.

        A miss of one that the sensor would not see is not telling.
        """
        belief, camera = self.belief, self.belief.state.camera
        sight = sight_of_belief(self.models.lens, belief, self.fiducials, self.boxes)
        points, places = sight.point.view(PREDICTED), np.zeros((len(sight.point), 3))
        z, H = self.linearised(points, places)
        shown = self.sensor.visible(camera, places)
        for a, point in enumerate(points):
            own = slice(point.column, point.column + point.width)
            point.z_hat[:], point.H_camera[:] = z[a, :2], H[a, :2, :POSE_DIM]
            point.H_feature[:, : point.width] = H[a, :2, own]
            point.R[:] = self.sensor.noise[:2, :2]
            point.visibility = point.visibility if shown[a] else min(point.visibility, NEAR)
        return sight_with(points[np.isfinite(z).all(axis=1)], belief.covariance, belief.state.dim)

    def linearised(self, points: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The measurements z (m, d) of ``points`` (m,) at the present mean, and H (m, d, dim).

        Writes ``places`` (m, 3), where the points are in the world [m].
        """
        belief, K, d, T = self.belief, len(self.fiducials), len(self.sensor.noise), np.zeros((3, 6))
        z, H = np.zeros((len(points), d)), np.zeros((len(points), d, belief.state.dim))
        for a, point in enumerate(points):
            places[a] = self.fiducials[point.row] if point.row < K else point_of(belief, point.row - K, T)
            z[a], H[a, :, :POSE_DIM], H_y = self.sensor.predict(belief.state.camera, places[a])
            if point.row >= K:
                H[a, :, point.column : point.column + point.width] = H_y @ T[:, : point.width]
        return z, H

    def correct(self, points: np.ndarray, values: np.ndarray, noise: np.ndarray) -> None:
        """x ⊞ delta, P - W^T W by the ``values`` (m, d), with their ``noise`` (m, d, d), of m ``points``.

        The iterated Kalman filter of `kalman.correct`. Where S has no factor, nothing is changed.
        """
        from scipy.linalg import block_diag  # a fifth of the package's import, for sensors of one's own alone

        belief, dim = self.belief, self.belief.state.dim
        P, places, value = belief.covariance[:dim, :dim], np.zeros((len(points), 3)), values.ravel()
        lasts = self.models.lens.command_known or len(self.fiducials) > 0
        R, size = block_diag(*noise), self.models.lens.pixel_std / np.sqrt(noise.diagonal(axis1=1, axis2=2)).ravel()
        S_c = np.zeros((len(points), *self.sensor.noise.shape))
        S_c[:, :2, :2] = (PRODUCT_FRAMES if lasts else 1.0) * points["curvature"]
        R = R + block_diag(*S_c)
        first = belief.state.camera.copy(), belief.feature["mean"].copy()
        z, H = self.linearised(points, places)
        line, H = z.ravel(), H.reshape(len(value), dim)  # z at delta = 0, by the line through the last mean
        W, delta, sound = factored_gain(H @ P, H @ P @ H.T + R, value - line)
        for _ in range(ITERATIONS if sound else 0):
            shift_mean(belief, delta)
            z, H_next = self.linearised(points, places)
            bends = (size * np.abs(z.ravel() - line - H @ delta)).max() > NONLINEARITY_PX  # not where a point is behind
            if bends:  # H by the tangent that P is of; see `kalman.correct`
                H = H_next.reshape(len(value), dim)
                H[:, D_ROTATION] = (
                    H[:, D_ROTATION] @ left_jacobian(belief, delta) + H @ invariance_correction(belief, delta).T
                )
                line = z.ravel() - H @ delta
            belief.state.camera[:], belief.feature["mean"] = first
            if not bends:
                break
            W_next, delta_next, next_sound = factored_gain(H @ P, H @ P @ H.T + R, value - line)
            if not next_sound:
                break
            W, delta = W_next, delta_next
        if sound:
            shift_mean(belief, delta)
            update_covariance(belief, W, delta)

    def add_landmark(self, value: np.ndarray, R: np.ndarray) -> int:
        """Initialise the feature measured as ``value`` (d,) with noise ``R`` (d, d); its id, or NEW without room."""
        belief, model, lens, camera = self.belief, self.models.filter, self.models.lens, self.belief.state.camera
        if belief.particles.shape[1] > 0:
            return int(add_landmark(lens, model.initialisation, model.particles, belief, value[:2], R[:2, :2]))
        prior = float(model.initialisation.rho_mean), float(model.initialisation.rho_std)
        mean, J, Q = new_landmark(self.sensor, lens, camera, value, R, *prior)
        if not np.isfinite(Q).all() or not room_for(belief, KIND_DIM[INVERSE_DEPTH]):
            return NEW
        return int(belief.feature[append_feature(belief, INVERSE_DEPTH, mean, J, Q)]["id"])

    def _is_labelled(self) -> bool:
        """Whether the ids of this frame's measurements are certain."""
        first = self.scenario.labelled_first_match and self.belief.state.frame == 1
        return bool(first or self.scenario.association == KNOWN)


def new_landmark(
    sensor: Any, lens: Any, camera: np.ndarray, value: np.ndarray, R: np.ndarray, rho: float, rho_std: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A landmark by inverse depth, measured as ``value`` (d,) with noise ``R`` (d, d) from ``camera`` (13,).

    Its mean (6,): anchor, azimuth, elevation and inverse depth; the Jacobian of it by the camera's tangent (6, 12); and
    its covariance (6, 6) by measurement and prior. The last three numbers are those of the least squares of measurement
    and prior inverse depth, ``rho`` of deviation ``rho_std``: a pixel leaves the prior as it is, a range replaces it.
    Where these have no solution, as where the sensor predicts nothing on the line of sight, the covariance is NaN.
    """
    weight = 1.0 / rho_std**2

    def at(s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        m, depth = np.array(bearing(s[0], s[1])), 1.0 / s[2]
        z, H_x, H_y = sensor.predict(camera, camera[POSITION] + depth * m[0])
        H_x = np.array(H_x)
        H_x[:, D_POSITION] += H_y  # the anchor is the camera's position
        H_s = H_y @ np.stack((depth * m[1], depth * m[2], -(depth**2) * m[0]), axis=1)
        G = np.linalg.solve(R, H_s).T
        try:
            C = np.linalg.inv(G @ H_s + np.diag((0.0, 0.0, weight)))
        except np.linalg.LinAlgError:  # singular
            C = np.full((3, 3), np.nan)
        return value - z, H_x, G, C

    h = rotation_matrix(camera[QUATERNION]) @ ray_from_pixel(lens, value[:2])
    s = np.array((*angles_of(h, np.zeros((2, 3))), rho))
    if len(value) > 2:
        m = np.array(bearing(s[0], s[1])[0])
        offs = value - [sensor.predict(camera, camera[POSITION] + depth * m)[0] for depth in _DEPTHS]
        costs = np.sum(offs * np.linalg.solve(R, offs.T).T, axis=1) + weight * (1.0 / _DEPTHS - rho) ** 2
        s[2] = 1.0 / _DEPTHS[np.argmin(np.nan_to_num(costs, nan=np.inf))]
    for _ in range(_STEPS):
        off, _, G, C = at(s)
        s += C @ (G @ off + np.array((0.0, 0.0, weight * (rho - s[2]))))
        s[2] = max(s[2], MINIMUM_INVERSE_DEPTH)
    _, H_x, G, C = at(s)
    J, Q = np.zeros((6, CAMERA_DIM)), np.zeros((6, 6))
    J[:3, :3], J[3:, :POSE_DIM], Q[3:, 3:] = np.eye(3), -C @ G @ H_x, C
    return np.array((*camera[POSITION], *s)), J, Q


ESTIMATORS: Mapping[str, Any] = MappingProxyType({EKF: Ekf, EKF_PLAIN: Ekf})
"""The package's own estimators by name."""
