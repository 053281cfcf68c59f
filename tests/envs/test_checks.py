"""`activeslam_gym.envs.checks`: each law that a part may break is told by the part's name."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from activeslam_gym.envs import checks
from activeslam_gym.sensors.sensor import Detections
from activeslam_gym.slam.ekf import Ekf
from activeslam_gym.slam.estimate import Estimate
from examples.extend_range_sensor import RangeSensor
from examples.extend_scene import SphereScene


class OneWay(SphereScene):
    def blocks(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return super().blocks(a, b) & (b[:, 0] > a[0])


class FarClearance(SphereScene):
    def clearance(self, p: np.ndarray, directions: np.ndarray, farthest: float) -> np.ndarray:
        return np.minimum(super().clearance(p, directions, farthest) + 0.1, farthest)


class NormalsInward(SphereScene):
    def sample(self, n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        points, normals = super().sample(n, rng)
        return points, -normals


class AnotherEachTime(SphereScene):
    def sample(self, n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        return super().sample(n, np.random.default_rng())


SCENE_LAWS = {
    OneWay: "from b to a|past their clearance",
    FarClearance: "before their clearance",
    NormalsInward: "on no surface",
    AnotherEachTime: "another one each time",
}


@pytest.mark.parametrize("wrong", SCENE_LAWS)
def test_a_scene_that_breaks_a_law(wrong: type) -> None:
    checks.check_scene(SphereScene)
    with pytest.raises(ValueError, match=f"the scene '.*:{wrong.__name__}'.*({SCENE_LAWS[wrong]})"):
        checks.check_scene(wrong)


class Turned(RangeSensor):
    def predict(self, camera: np.ndarray, point: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        z, H_x, H_y = super().predict(camera, point)
        H_x[:, 3:] *= -1.0
        return z, H_x, H_y


class Blind(RangeSensor):
    def visible(self, camera: np.ndarray, points: np.ndarray) -> np.ndarray:
        return np.zeros(len(points), bool)

    def measure(self, truth: Any, time: float) -> Detections:
        return RangeSensor(self._scenario, np.random.SeedSequence(0)).measure(truth, time)


class Precise(RangeSensor):
    def measure(self, truth: Any, time: float) -> Detections:
        values, labels = super().measure(truth, time)
        again = RangeSensor(self._scenario, np.random.SeedSequence(1)).measure(truth, time)
        return Detections(values + (again.values - [self.predict(*seen(truth, k))[0] for k in labels]), labels)


def seen(truth: Any, label: int) -> tuple[np.ndarray, np.ndarray]:
    """The true camera, and the point of a label."""
    camera = np.concatenate((truth.position, truth.quaternion, truth.velocity, truth.angular_velocity))
    return camera, np.vstack((truth.fiducials, truth.landmarks))[label]


class ByChance(RangeSensor):
    def measure(self, truth: Any, time: float) -> Detections:
        values, labels = super().measure(truth, time)
        return Detections(values + np.random.default_rng().normal(size=values.shape), labels)


SENSOR_LAWS = {
    Turned: "Jacobians",
    Blind: r"visible\(\) denies",
    Precise: "times the noise",
    ByChance: "measures something else",
}


@pytest.mark.parametrize("wrong", SENSOR_LAWS)
def test_a_sensor_that_breaks_a_law(wrong: type) -> None:
    checks.check_sensor("examples.extend_range_sensor:RangeSensor")
    with pytest.raises(ValueError, match=f"the sensor '.*{wrong.__name__}'.*{SENSOR_LAWS[wrong]}"):
        checks.check_sensor(wrong)


class Overconfident(Ekf):
    def estimate(self) -> Estimate:
        given, n = super().estimate(), 1e-4
        return dataclasses.replace(given, covariance=given.covariance * (n if len(given.ids) else 1.0))


class Negative(Ekf):
    def estimate(self) -> Estimate:
        given = super().estimate()
        P = given.covariance.copy()
        if len(given.ids):
            P[0, 1] = P[1, 0] = 2.0 * np.sqrt(P[0, 0] * P[1, 1])
        return dataclasses.replace(given, covariance=P)


class Certain(Ekf):
    def reset(self, mean: np.ndarray, covariance: np.ndarray) -> None:
        super().reset(mean, 0.01 * covariance)


ESTIMATOR_LAWS = {Overconfident: "overconfident", Negative: "not positive definite", Certain: "begins with"}


@pytest.mark.parametrize("wrong", ESTIMATOR_LAWS)
def test_an_estimator_that_breaks_a_law(wrong: type) -> None:
    checks.check_estimator(Ekf)
    with pytest.raises(ValueError, match=f"the estimator '.*:{wrong.__name__}'.*{ESTIMATOR_LAWS[wrong]}"):
        checks.check_estimator(wrong)


def test_the_package_s_own_parts_hold_the_laws() -> None:
    checks.check_scene("boxes", "office")
    checks.check_estimator("ekf")
    with pytest.raises(ValueError, match="the package's own; allowed"):
        checks.check_sensor("points")
