"""The estimator `fixed-lag`: its Jacobians, its laws, and a short episode. Without GTSAM, its error alone."""

import sys
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import baselines
from activeslam_gym.config import TRAINING_SEED, Scenario
from activeslam_gym.evaluation import code
from activeslam_gym.geometry import rotation_error, rotation_matrix, so3_exp
from activeslam_gym.motion import QUATERNION
from activeslam_gym.sensors.points import PointModel
from activeslam_gym.slam import fixed_lag
from activeslam_gym.slam.belief import start_of
from activeslam_gym.slam.estimator import ESTIMATORS, Measurements
from activeslam_gym.slam.filter import Ekf
from activeslam_gym.slam.fixed_lag import FixedLag, Smoother

from .support import CAMERA, numerical_jacobian, random_camera, relative_error, world_points

SCENARIO = Scenario(estimator="fixed-lag", association="known")
SENSOR = PointModel(SCENARIO, np.zeros((0, 2, 3)))


def rotations(rng: np.random.Generator) -> list[np.ndarray]:
    return [rotation_matrix(random_camera(rng)[QUATERNION]) for _ in range(3)]


def turned(R_WC: np.ndarray, omega: np.ndarray) -> np.ndarray:
    return R_WC @ so3_exp(np.ascontiguousarray(omega))


def test_the_jacobian_of_a_change_of_the_turn_rate() -> None:
    A, B, C = rotations(np.random.default_rng(1))
    _, J = fixed_lag.turn_rate_change(A, B, C, 0.4, 0.7)

    def change(e: np.ndarray) -> np.ndarray:
        return fixed_lag.turn_rate_change(turned(A, e[:3]), turned(B, e[3:6]), turned(C, e[6:]), 0.4, 0.7)[0]

    assert relative_error(J, numerical_jacobian(change, 9, 1e-4)) < 1e-6


def test_the_jacobian_of_a_frame_of_measurements() -> None:
    rng = np.random.default_rng(2)
    camera = random_camera(rng)
    known = world_points(rng, camera, 2)
    sights = world_points(rng, camera, 3) - (anchors := camera[:3] + 0.1 * rng.standard_normal((3, 3)))
    depths = np.linalg.norm(sights, axis=1)
    angles = np.arctan2(sights[:, 0], sights[:, 2]), np.arcsin(sights[:, 1] / depths)
    lines, R_WC = np.stack((*angles, 1.0 / depths), axis=1), rotation_matrix(camera[QUATERNION])

    def pixels(e: np.ndarray) -> np.ndarray:
        moved = turned(R_WC, e[:3]), camera[:3] + e[3:6], known, anchors, lines + e[6:].reshape(3, 3)
        return fixed_lag.measured(CAMERA, *moved)[0].ravel()

    _, J = fixed_lag.measured(CAMERA, R_WC, camera[:3], known, anchors, lines)
    assert relative_error(J, numerical_jacobian(pixels, 15, 1e-4)) < 1e-5


def test_the_jacobian_of_a_landmarks_point() -> None:
    anchor, line, J = np.array([(1.0, 2.0, 3.0)]), np.array([(0.4, -0.3, 0.6)]), np.empty((3, 3))

    def point(e: np.ndarray) -> np.ndarray:
        found = np.empty((1, 3))
        fixed_lag.write_points(anchor, line + e, found, np.empty((3, 3)))
        return found[0]

    fixed_lag.write_points(anchor, line, np.empty((1, 3)), J)
    assert relative_error(J, numerical_jacobian(point, 3, 1e-4)) < 1e-6


def test_it_says_that_gtsam_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gtsam", None)
    with pytest.raises(ImportError, match=r"estimator 'fixed-lag' needs GTSAM: pip install gtsam"):
        gym.make("ActiveSLAM-v0", scenario=SCENARIO)


def started(estimator: Any = FixedLag, fiducials: Any = ()) -> Any:
    """An estimator after its reset."""
    pytest.importorskip("gtsam", reason="GTSAM is not installed: pip install -e '.[gtsam]'")
    made = estimator(SCENARIO, np.reshape(fiducials, (-1, 3)), SENSOR)
    made.reset(*start_of(SCENARIO))
    return made


def test_it_wants_known_association_and_pixels() -> None:
    started()
    with pytest.raises(ValueError, match="'fixed-lag' needs scenario.association 'known'"):
        gym.make("ActiveSLAM-v0", scenario={"estimator": "fixed-lag"})


def test_without_measurements_it_is_the_filters_prediction() -> None:
    """Of several lengths of time, with accelerations, and after a contact."""
    one, other = started(), started(Ekf)
    for k, dt in enumerate((0.05, 0.1, 0.05, 0.07)):
        u = np.array((0.5, -0.2, 0.3, 0.1, 0.4, -0.2))
        one.predict(u, dt, contact=k == 2)
        other.predict(u, dt, contact=k == 2)
        found, expected = one.estimate(), other.estimate()
        np.testing.assert_allclose(found.camera, expected.camera, atol=1e-9)
        np.testing.assert_allclose(found.covariance, expected.covariance, rtol=1e-4, atol=1e-8)


def test_measurements_of_one_frame_give_the_filters_update() -> None:
    """Where the prior is so narrow that the measurement is linear."""
    rng = np.random.default_rng(3)
    mean, P = start_of(SCENARIO)
    fiducials = world_points(rng, mean, 5)
    pixels = np.array([SENSOR.predict(mean, y)[0] for y in fiducials]) + 0.05 * rng.standard_normal((5, 2))
    measurements = Measurements(pixels, np.tile(0.01 * np.eye(2), (5, 1, 1)), -1 - np.arange(5))
    one, other = started(fiducials=fiducials), started(Ekf, fiducials)
    for estimator in (one, other):
        estimator.reset(mean, 1e-4 * P)
        estimator.predict(np.zeros(6), 0.05)
        np.testing.assert_array_equal(estimator.update(measurements), measurements.ids)
    found, expected = one.estimate(), other.estimate()
    assert np.abs(found.position - expected.position).max() < 1e-5
    assert np.abs(rotation_error(found.quaternion, expected.quaternion)).max() < 1e-5
    stds = np.sqrt(expected.covariance.diagonal())
    assert np.abs((found.covariance - expected.covariance) / np.outer(stds, stds)).max() < 0.01


def test_what_is_marginalised_still_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where all is linear, a lag loses nothing."""
    monkeypatch.setattr(fixed_lag, "MARGINALISED_EVERY", 0.1)
    monkeypatch.setattr(FixedLag, "lag", 0.2)
    rng, (mean, P) = np.random.default_rng(4), start_of(SCENARIO)
    fiducials, new = world_points(rng, mean, 4), world_points(rng, mean, 2)
    one, other = started(fiducials=fiducials), started(Smoother, fiducials)
    ids = np.concatenate((-1 - np.arange(4), np.zeros(2, int)))
    for estimator in (one, other):
        estimator.reset(mean, 1e-2 * P)
    for _ in range(12):
        pixels = np.array([SENSOR.predict(mean, y)[0] for y in (*fiducials, *new)])
        measurements = Measurements(pixels, np.tile(0.01 * np.eye(2), (6, 1, 1)), ids)
        for estimator in (one, other):
            estimator.predict(np.zeros(6), 0.05)
            used = estimator.update(measurements)
        ids = used
    assert one._oldest > 5 and other._oldest == 0
    found, expected = one.estimate(), other.estimate()
    np.testing.assert_allclose(found.camera, expected.camera, atol=1e-5)
    stds = np.sqrt(expected.covariance.diagonal())
    assert np.abs((found.covariance - expected.covariance) / np.outer(stds, stds)).max() < 0.02


def test_a_copy_is_independent() -> None:
    one = started()
    one.predict(np.zeros(6), 0.05)
    z = np.array([[150.0, 100.0]])
    assert one.update(Measurements(z, SENSOR.noise[None], np.zeros(1, int))) == [1]
    before, other = one.estimate(), one.copy()
    for _ in range(3):
        other.predict(np.ones(6), 0.05)
        other.update(Measurements(z + 5.0, SENSOR.noise[None], np.ones(1, int)))
    after = one.estimate()
    np.testing.assert_array_equal(after.camera, before.camera)
    np.testing.assert_allclose(after.covariance, before.covariance)
    assert other.estimate().time == pytest.approx(0.2) and after.time == pytest.approx(0.05)


def test_it_flies_an_episode_consistently() -> None:
    started()
    assert "fixed-lag" in ESTIMATORS.own
    errors, mapped = [], 0
    for seed in range(TRAINING_SEED, TRAINING_SEED + 2):
        env: Any = gym.make("ActiveSLAM-v0", scenario=SCENARIO, duration=5.0)
        observation, info = env.reset(seed=seed)
        policy, state, over = baselines.make("mi-mi", env), None, False
        while not over:
            action, state = policy.predict(observation, state)
            observation, _, terminated, truncated, info = env.step(action)
            over = terminated or truncated
            errors.append(info["position_nees"])
        mapped += info["landmarks_mapped"]
        assert not info["lost"] and info["log_score"] > 50.0 and info["events"]["wrong_matches"] == 0
    assert 0.07 < np.mean(errors) < 1.0 and mapped >= 6


def test_where_gtsam_fails_the_estimate_stays() -> None:
    one = started()
    one.predict(np.zeros(6), 0.05)
    before = one.estimate()

    class Singular:
        def update(self, *_: Any, **__: Any) -> None:
            raise RuntimeError("Indeterminate linear system")

    one._isam = Singular()
    z = np.array([[150.0, 100.0]])
    assert one.update(Measurements(z, SENSOR.noise[None], np.zeros(1, int))) == [0]
    one.predict(np.ones(6), 0.05)
    after = one.estimate()
    np.testing.assert_array_equal(after.camera, before.camera)
    assert after.time == pytest.approx(0.1)


def test_a_key_holds_the_version_of_gtsam_where_it_matters() -> None:
    assert code.declared_libraries('{"estimator": "fixed-lag"}') == ("gtsam",)
    assert code.declared_libraries('{"estimator": "ekf"}') == ()
