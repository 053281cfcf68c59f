"""`activeslam_gym.envs.checks`: each law that a registered part may break is told by the part's name."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from activeslam_gym.envs import checks
from activeslam_gym.sensors.sensor import SENSORS, Detections
from activeslam_gym.slam.estimate import Estimate
from activeslam_gym.slam.estimator import ESTIMATORS
from activeslam_gym.slam.filter import Ekf
from activeslam_gym.world.scenes import SCENES
from examples.extend_range_sensor import RangeModel, RangeSensor
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
def test_a_scene_that_breaks_a_law(wrong: type, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(SCENES, "mine", SphereScene)
    checks.check_scene({"scene": "mine"})
    monkeypatch.setitem(SCENES, "mine", wrong)
    with pytest.raises(ValueError, match=f"the scene 'mine'.*({SCENE_LAWS[wrong]})"):
        checks.check_scene({"scene": "mine"})


class Turned(RangeModel):
    def predict(self, camera: np.ndarray, point: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        z, H_x, H_y = super().predict(camera, point)
        H_x[:, 3:] *= -1.0
        return z, H_x, H_y


class Blind(RangeModel):
    def visible(self, estimate: Estimate, camera: np.ndarray, points: np.ndarray) -> np.ndarray:
        return np.zeros(len(points), bool)


class Precise(RangeModel):
    def __init__(self, scenario: Any) -> None:
        super().__init__(scenario)
        self.noise = 0.25 * self.noise


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
def test_a_sensor_that_breaks_a_law(wrong: type, monkeypatch: pytest.MonkeyPatch) -> None:
    class OfModel(RangeSensor):
        def model(self) -> Any:
            return wrong(self.scenario)

        def __init__(self, scenario: Any, seed: Any) -> None:
            super().__init__(scenario, seed)
            self.scenario = scenario

    monkeypatch.setitem(SENSORS, "mine", RangeSensor)
    checks.check_sensor({"sensor": "mine", "estimator": "numpy-ekf", "association": "known"})
    monkeypatch.setitem(SENSORS, "mine", wrong if issubclass(wrong, RangeSensor) else OfModel)
    with pytest.raises(ValueError, match=f"the sensor 'mine'.*{SENSOR_LAWS[wrong]}"):
        checks.check_sensor({"sensor": "mine", "estimator": "numpy-ekf", "association": "known"})


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
def test_an_estimator_that_breaks_a_law(wrong: type, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(ESTIMATORS, "mine", Ekf)
    checks.check_estimator({"estimator": "mine"})
    monkeypatch.setitem(ESTIMATORS, "mine", wrong)
    with pytest.raises(ValueError, match=f"the estimator 'mine'.*{ESTIMATOR_LAWS[wrong]}"):
        checks.check_estimator({"estimator": "mine"})


def test_the_package_s_own_parts_hold_the_laws() -> None:
    checks.check_scene("office")
    checks.check_estimator("paper")
    with pytest.raises(ValueError, match="the package's own; allowed"):
        checks.check_sensor("paper")
