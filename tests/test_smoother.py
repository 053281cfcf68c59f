"""The example of an estimator by GTSAM: its laws, and a short episode."""

from typing import Any

import numpy as np
import pytest

from activeslam_gym.config import Scenario
from activeslam_gym.geometry import rotation_error
from activeslam_gym.sensors.points import PointSensor
from activeslam_gym.slam.belief import start_of
from activeslam_gym.slam.ekf import Ekf
from activeslam_gym.slam.estimate import Measurements
from tests.support import world_points

pytest.importorskip("gtsam", reason="GTSAM is not installed: pip install -e '.[gtsam]'")

from examples.extend_smoother import Smoother  # noqa: E402

SCENARIO = Scenario(estimator=Smoother, association="known")
SENSOR = PointSensor(SCENARIO, np.random.SeedSequence(0))


def started(estimator: Any, fiducials: Any = (), narrow: float = 1.0) -> Any:
    """An estimator after its reset, to a prior with a share of the covariance."""
    made, (mean, P) = estimator(SCENARIO, np.reshape(fiducials, (-1, 3)), SENSOR), start_of(SCENARIO)
    made.reset(mean, narrow * P)
    return made


def test_without_measurements_it_is_the_filters_prediction() -> None:
    """Of several lengths of time, with accelerations, and after a contact."""
    one, other = started(Smoother), started(Ekf)
    for k, dt in enumerate((0.05, 0.1, 0.05, 0.07)):
        for estimator in (one, other):
            estimator.predict(np.array((0.5, -0.2, 0.3, 0.1, 0.4, -0.2)), dt, contact=k == 2)
        found, expected = one.estimate(), other.estimate()
        np.testing.assert_allclose(found.camera, expected.camera, atol=1e-8)
        np.testing.assert_allclose(found.covariance, expected.covariance, rtol=1e-4, atol=1e-8)


def test_measurements_of_one_frame_give_the_filters_update() -> None:
    """Where the prior is so narrow that the measurement is linear."""
    rng, (mean, _) = np.random.default_rng(3), start_of(SCENARIO)
    fiducials = world_points(rng, mean, 5)
    pixels = np.array([SENSOR.predict(mean, y)[0] for y in fiducials]) + 0.05 * rng.standard_normal((5, 2))
    measurements = Measurements(pixels, np.tile(0.01 * np.eye(2), (5, 1, 1)), -1 - np.arange(5))
    one, other = started(Smoother, fiducials, 1e-4), started(Ekf, fiducials, 1e-4)
    for estimator in (one, other):
        estimator.predict(np.zeros(6), 0.05)
        np.testing.assert_array_equal(estimator.update(measurements), measurements.ids)
    found, expected = one.estimate(), other.estimate()
    assert np.abs(found.position - expected.position).max() < 1e-5
    assert np.abs(rotation_error(found.quaternion, expected.quaternion)).max() < 1e-5
    stds = np.sqrt(expected.covariance.diagonal())
    assert np.abs((found.covariance - expected.covariance) / np.outer(stds, stds)).max() < 0.01
