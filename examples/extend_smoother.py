"""An estimator by another library: GTSAM smooths the whole episode (iSAM2; Kaess et al., IJRR 2012), labels known.

The variables are a rotation and a position for each frame, and for each landmark azimuth, elevation and inverse depth
from the camera's estimated position at its first detection. Two successive poses hold the velocities, since
p_k = p_{k-1} + dt v_k and R_k = Exp(dt w_k) R_{k-1}; so the process noise is a factor on three poses. Rotation and
position are variables of their own: with GTSAM's poses a correction of one bends the other by more than that noise.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import gtsam
import gymnasium as gym
import numpy as np
from gtsam import noiseModel

import baselines
from activeslam_gym import Scenario
from activeslam_gym.camera import camera_of, ray_from_pixel
from activeslam_gym.evaluation import run_episode
from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.motion import motion_of, transition
from activeslam_gym.slam.estimate import NO_MATCH, Estimate, Measurements
from examples.extend_estimator import point_of

THRESHOLD = 0.02  # a variable that has moved by more [m, rad, 1/m] is linearised again


class Smoother:
    mean: np.ndarray

    def __init__(self, scenario: Scenario, fiducials: np.ndarray, sensor: Any) -> None:
        self.scenario, self.fiducials, self.sensor = scenario, fiducials, sensor
        self.lens, self.motion = camera_of(scenario), motion_of(scenario, 1.0)

    @staticmethod
    def check(scenario: Scenario) -> None:
        if scenario.association != "known":
            raise ValueError(f"the smoother needs scenario.association 'known', got {scenario.association!r}")

    def reset(self, mean: np.ndarray, covariance: np.ndarray) -> None:
        settings = gtsam.ISAM2Params()
        settings.setFactorization("QR")  # Cholesky fails after some seconds without measurements
        settings.relinearizeSkip = 10
        settings.setRelinearizeThreshold(THRESHOLD)
        self.isam, self.graph, self.values = gtsam.ISAM2(settings), gtsam.NonlinearFactorGraph(), gtsam.Values()
        self.anchors, self.frame, self.dt = np.zeros((0, 3)), 0, self.scenario.frame_time
        self.begin_frame(0, transition(np.concatenate((mean[:7], -mean[7:])), np.zeros(6), self.dt))  # a frame before
        self.begin_frame(1, mean)
        R, dt = gtsam.Rot3.Quaternion(*mean[3:7]), self.dt

        def error(R_A: Any, p_A: np.ndarray, R_B: Any, p_B: np.ndarray) -> np.ndarray:
            return np.concatenate((p_B - mean[:3], turn(R, R_B), rates(dt, R_A, p_A, R_B, p_B) - mean[7:]))

        self.add(noiseModel.Gaussian.Covariance(covariance), self.present(), error)

    def predict(self, u: np.ndarray, dt: float, contact: bool = False) -> None:
        self.solve()
        before, self.dt, keys = self.dt, dt, self.present()
        self.begin_frame(self.frame + 1, transition(self.mean, u, dt))
        stds = dt * np.repeat((self.motion.filter_acceleration_std, self.motion.filter_angular_acceleration_std), 3)
        if contact:
            stds[:3] = np.hypot(stds[:3], self.mean[7:10])

        def error(*x: Any) -> np.ndarray:
            return rates(dt, *x[2:]) - rates(before, *x[:4]) - dt * u

        self.add(noiseModel.Diagonal.Sigmas(stds), [*keys, *self.present()[2:]], error)

    def update(self, measurements: Measurements) -> np.ndarray:
        used = np.where(measurements.ids >= -len(self.fiducials), measurements.ids, NO_MATCH)
        for m, (value, R) in enumerate(zip(measurements.values, measurements.noise)):
            if measurements.ids[m] == 0 and len(self.anchors) < self.scenario.landmark_count:
                used[m] = self.initialise(value)
            if used[m] != NO_MATCH:
                self.measure(int(used[m]), value, R)
        return used

    def initialise(self, value: np.ndarray) -> int:
        self.anchors = np.vstack((self.anchors, self.mean[:3]))
        ray, key = rotation_matrix(self.mean[3:7]) @ ray_from_pixel(self.lens, value[:2]), landmark(len(self.anchors))
        angles = np.arctan2(ray[0], ray[2]), np.arctan2(ray[1], np.hypot(ray[0], ray[2]))
        line, stds = np.array((*angles, self.scenario.inverse_depth_mean)), (9.0, 9.0, self.scenario.inverse_depth_std)
        self.values.insertPoint3(key, line)
        self.graph.addPriorPoint3(key, line, noiseModel.Diagonal.Sigmas(np.array(stds)))
        return len(self.anchors)

    def measure(self, id: int, value: np.ndarray, R: np.ndarray) -> None:
        keys, anchor = [*self.present()[2:], *([landmark(id)] if id > 0 else [])], self.anchors[id - 1 :][:1].ravel()

        def error(R_WC: Any, p: np.ndarray, *line: np.ndarray) -> np.ndarray:
            point = point_of(np.concatenate((anchor, *line)))[0] if line else self.fiducials[-1 - id]
            z_hat = self.sensor.predict(np.concatenate((p, quaternion(R_WC), np.zeros(6))), point)[0]
            return np.nan_to_num(z_hat - value, nan=1e3)  # behind the camera

        self.add(noiseModel.Gaussian.Covariance(R), keys, error)

    def estimate(self) -> Estimate:
        self.solve()
        n, x = len(self.anchors), [value_of(self.now, key) for key in self.last()]
        P, J = self.isam.jointMarginalCovariance(self.last()).fullMatrix(), np.eye(12 + 3 * n)
        J[:12, :12] = np.vstack(
            (np.eye(3, 12, 9), np.zeros((3, 12)), np.hstack(derivatives(partial(rates, self.dt), x[:4])))
        )
        J[3:6, 6:9] = x[2].matrix()
        y = np.hstack((self.anchors, np.reshape(x[4:], (-1, 3))))
        y[:, 5] = np.maximum(y[:, 5], 0.02)
        for k, at in enumerate(range(12, 12 + 3 * n, 3)):
            J[at : at + 3, at : at + 3] = point_of(y[k])[1][:, 3:]
        points = np.array([point_of(one)[0] for one in y]).reshape(-1, 3)
        mapped = np.sqrt(P.diagonal()[14::3]) < self.scenario.mapped_depth_ratio * y[:, 5]
        return Estimate(self.mean, np.arange(1, n + 1), points, J @ P @ J.T, mapped, np.zeros(n, bool))

    def solve(self) -> None:
        """Gauss and Newton, at most five steps; the present state and the map are eliminated last."""
        last = gtsam.KeyGroupMap()
        for key in self.last():
            last.insert2(key, 1)
        for _ in range(0 if self.graph.empty() else 5):
            self.isam.update(self.graph, self.values, constrainedKeys=last, force_relinearize=self.graph.empty())
            self.graph, self.values = gtsam.NonlinearFactorGraph(), gtsam.Values()
            self.now, before, R = self.isam.calculateEstimate(), self.mean, gtsam.Rot3.Quaternion(*self.mean[3:7])
            x = [value_of(self.now, key) for key in self.present()]
            self.mean = np.concatenate((x[3], quaternion(x[2]), rates(self.dt, *x)))
            if np.abs(np.concatenate((self.mean[:3] - before[:3], turn(R, x[2])))).max() < THRESHOLD:
                break

    def begin_frame(self, frame: int, x: np.ndarray) -> None:
        self.frame, self.mean = frame, x
        self.values.insert(gtsam.symbol("r", frame), gtsam.Rot3.Quaternion(*x[3:7]))
        self.values.insertPoint3(gtsam.symbol("p", frame), x[:3])

    def present(self) -> list[int]:
        """The keys of the last two poses: rotation, position, rotation, position."""
        return [gtsam.symbol(letter, frame) for frame in (self.frame - 1, self.frame) for letter in "rp"]

    def last(self) -> list[int]:
        return self.present() + [landmark(id) for id in range(1, len(self.anchors) + 1)]

    def add(self, noise: Any, keys: Sequence[int], error: Callable[..., np.ndarray]) -> None:
        def evaluate(this: Any, values: Any, jacobians: Any) -> np.ndarray:
            x = [value_of(values, key) for key in keys]
            for i, block in enumerate([] if jacobians is None else derivatives(error, x)):
                jacobians[i] = np.asfortranarray(block)
            return error(*x)

        self.graph.add(gtsam.CustomFactor(noise, keys, evaluate))


def landmark(id: int) -> int:
    return int(gtsam.symbol("l", id))


def value_of(values: Any, key: int) -> Any:
    return values.atRot3(key) if gtsam.Symbol(key).chr() == ord("r") else values.atPoint3(key)


def turn(R_A: Any, R_B: Any) -> np.ndarray:
    """Log(R_B R_A^T) (3,)."""
    return gtsam.Rot3.Logmap(R_B.compose(R_A.inverse()))


def rates(dt: float, R_A: Any, p_A: np.ndarray, R_B: Any, p_B: np.ndarray) -> np.ndarray:
    """Velocity and angular velocity (6,) at the pose B, ``dt`` seconds after A."""
    return np.concatenate((p_B - p_A, turn(R_A, R_B))) / dt


def quaternion(R_WC: Any) -> np.ndarray:
    q = R_WC.toQuaternion()
    return np.array((q.w(), q.x(), q.y(), q.z()))


def derivatives(f: Callable[..., np.ndarray], x: list[Any]) -> list[np.ndarray]:
    """d f / d e of each variable, R Exp(e) or p + e."""

    def moved(i: int, e: np.ndarray) -> np.ndarray:
        return f(*x[:i], x[i] + e if isinstance(x[i], np.ndarray) else x[i].retract(e), *x[i + 1 :])

    steps = 1e-6 * np.eye(3)
    return [np.stack([(moved(i, d) - moved(i, -d)) / 2e-6 for d in steps], axis=1) for i in range(len(x))]


if __name__ == "__main__":
    env: Any = gym.make("ActiveSLAM-v0", scenario={"association": "known"}, estimator=Smoother, duration=5.0)
    run = run_episode(env, baselines.make("mi-mi", env), seed=0)
    print(f"log score {run.log_score[-1]:.0f} bits, position error {100 * run.position_error[-1]:.1f} cm")
