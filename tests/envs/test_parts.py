"""Parts of a user's own: they fly, a wrong answer has the part's name and the frame, and `check_…` finds it before."""

import pickle
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import baselines
from activeslam_gym.config import DEPTH_PARTICLES, INVERSE_DEPTH, KNOWN, UNKNOWN, Scenario
from activeslam_gym.envs import checks
from activeslam_gym.evaluation import Episode, run_episode
from activeslam_gym.information import candidates
from activeslam_gym.sensors.points import PointSensor
from activeslam_gym.sensors.sensor import Detections
from activeslam_gym.slam.detection import NEW
from activeslam_gym.slam.ekf import Ekf, new_landmark
from activeslam_gym.slam.estimate import Estimate
from examples.extend_estimator import NumpyEkf
from examples.extend_range_sensor import RangeSensor
from examples.extend_scene import SphereScene
from tests.world.test_rooms import random_scenario

NUMPY = {"estimator": NumpyEkf, "scenario": {"association": "known"}}


def flown(seed: int, seconds: float, **parts: Any) -> Episode:
    """An episode of `mi-mi`."""
    env: Any = gym.make("ActiveSLAM-v0", gaze_period=0.25, duration=seconds, **parts)
    return run_episode(env, baselines.make("mi-mi", env), seed)


@pytest.mark.parametrize("sensor", [None, RangeSensor])
def test_an_unpickled_environment_goes_on_as_the_original(sensor: Any) -> None:
    env: Any = gym.make("ActiveSLAM-v0", sensor=sensor, duration=3.0)
    env.reset(seed=5)
    twin = pickle.loads(pickle.dumps(env))
    for _ in range(4):
        (observation, reward, *_), (other, same, *_) = env.step((0, 0)), twin.step((0, 0))
        assert reward == same and np.array_equal(observation, other)


@pytest.mark.parametrize("seed", range(20))
def test_the_step_in_python_is_that_of_the_kernel(seed: int) -> None:
    """In random scenarios: the built-in filter as an object, by the predictions of `PointSensor`, runs in Python."""
    rng = np.random.default_rng(seed)
    initialisation = DEPTH_PARTICLES if seed % 4 == 3 else INVERSE_DEPTH
    association = KNOWN if seed % 5 == 4 else UNKNOWN
    scenario = replace(random_scenario(rng), initialisation=initialisation, association=association)
    scenario = replace(scenario, labelled_first_match=seed % 7 == 6)
    kernel, python = (gym.make("ActiveSLAM-v0", scenario=scenario, **own) for own in ({}, {"estimator": Ekf}))
    for env in (kernel, python):
        env.reset(seed=seed)
    for k in range(12):
        if k == 10:  # the fiducials contradict the belief: it is reset
            kernel.unwrapped._run.ekf.state.fiducial_nis = 1e3
            python.unwrapped._perceptions[0]._estimator.belief.state.fiducial_nis = 1e3
        action = k // 4 * 5 % 7, int(rng.integers(3))
        (observation, reward, *_, info), (other_observation, other, *_, other_info) = (
            env.step(action) for env in (kernel, python)
        )
        mine, theirs = (env.unwrapped.belief for env in (kernel, python))
        assert mine.ids.tolist() == theirs.ids.tolist()
        np.testing.assert_allclose(mine.camera, theirs.camera, rtol=0.0, atol=1e-9)
        np.testing.assert_allclose(mine.points, theirs.points, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(mine.covariance, theirs.covariance, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(observation, other_observation, rtol=0.0, atol=1e-6)  # single precision
        np.testing.assert_allclose((reward, info["log_score"]), (other, other_info["log_score"]), rtol=1e-9, atol=1e-6)
        assert info["events"] == other_info["events"]


def test_a_range_sensor_flies_with_the_built_in_filter_and_planner_and_tells_more_than_a_pixel() -> None:
    pixel, ranged = ([flown(seed, 10.0, sensor=sensor) for seed in range(4)] for sensor in (PointSensor, RangeSensor))
    assert np.median([run.log_score[-1] for run in ranged]) > np.median([run.log_score[-1] for run in pixel]) + 10.0
    assert not any(run.lost or run.events["wrong_matches"].sum() for run in ranged)
    assert np.mean([run.position_nees for run in ranged]) < 2.0


@pytest.mark.parametrize("parts", [{}, {"scene": SphereScene}, {"sensor": PointSensor}, {"sensor": RangeSensor}, NUMPY])
def test_a_snapshot_has_the_predictions_of_the_present_estimate(parts: dict[str, Any]) -> None:
    """With a foreign sensor they were those of the prior."""
    env: Any = gym.make("ActiveSLAM-v0", end_when_lost=False, **parts).unwrapped
    env.reset(seed=3)
    for k in range(24):
        env.step((0 if k < 12 else 3, 1))
    now = env.snapshot()
    if parts is NUMPY:
        assert len(now.predicted) == 0 and now.predicted_covariance.shape == (0, 2, 2)
        return
    innovations = now.detections[:, None] - now.predicted
    squared = np.einsum("mni,nij,mnj->mn", innovations, np.linalg.inv(now.predicted_covariance), innovations)
    assert len(now.detections) >= 5 and np.mean(squared.min(axis=1) < 16.0) > 0.6


def test_a_view_of_one_environment_of_a_batch_follows_it() -> None:
    batch = gym.make_vec("ActiveSLAMDiscrete-v0", num_envs=2, scene=SphereScene, render_mode="rgb_array").unwrapped
    one = batch.run(1)
    batch.reset(seed=0)
    assert one.truth.scene is batch._perceptions[1].scene is not None and one.render_mode == "rgb_array"
    np.testing.assert_array_equal(one.action_masks(), batch.action_masks()[1])
    for wrong in (2, 1.0):
        with pytest.raises(ValueError, match="i must be"):
            batch.run(wrong)


def test_nothing_goes_on_after_a_reset_that_failed() -> None:
    made: list[Any] = []

    def once(*arguments: Any) -> RangeSensor:
        made.append(arguments)
        return RangeSensor(*arguments) if len(made) == 1 else fails()

    env: Any = gym.make("ActiveSLAM-v0", sensor=once).unwrapped
    env.reset(seed=0)
    with pytest.raises(ValueError, match="KeyError: 'gone'"):
        env.reset(seed=1)
    for call in (lambda: env.step((0, 0)), env.snapshot):
        with pytest.raises(gym.error.ResetNeeded):
            call()


def test_an_estimator_from_outside_flies_a_whole_episode() -> None:
    run = flown(3, 35.0, **NUMPY)
    assert not run.lost and run.landmarks_mapped[-1] >= 5
    assert run.log_score[-1] > 100.0 and run.position_error[-1] < 0.1
    assert run.events["wrong_matches"].sum() == 0


def fails(*_: Any) -> Any:
    raise KeyError("gone")


def stepped(steps: int = 3, **arguments: Any) -> list[dict[str, Any]]:
    """Infos of some frames, after scores of the motions."""
    env: Any = gym.make("ActiveSLAM-v0", gaze_period=0.05, **arguments).unwrapped
    env.reset(seed=0)
    infos = [env.step((0, 0))[-1] for _ in range(steps)]
    assert np.isfinite(env.motion_scores()).all()
    return infos


def like(base: type, **methods: Callable[..., Any]) -> type:
    """A subclass each of whose ``methods`` changes the answer of the base's."""

    def changed(name: str, change: Callable[..., Any]) -> Callable[..., Any]:
        return lambda self, *arguments: change(getattr(base, name)(self, *arguments))

    return type("Mine", (base,), {name: changed(name, change) for name, change in methods.items()})


def first(array: Any, value: Any, dtype: Any) -> np.ndarray:
    """The array with another first entry."""
    out = np.array(array).astype(dtype)
    out.flat[0] = value
    return out


def estimated(base: type, **changes: Callable[[Any], Any]) -> type:
    """The estimator with other fields of its estimates, once there are landmarks."""

    def change(e: Estimate) -> Estimate:
        new = {name: function(getattr(e, name)) for name, function in changes.items()} if len(e.ids) else {}
        return replace(e, **new)

    return like(base, estimate=change)


def nothing(*_: Any) -> Detections:
    return Detections(np.zeros((0, 3)), [])  # type: ignore[arg-type]


WRONG_PARTS: dict[str, tuple[str, Any]] = {
    "an id of nothing": ("estimator", like(NumpyEkf, update=lambda m: first(m, 999, int))),
    "a failing predict": ("estimator", like(NumpyEkf, predict=fails)),
    "infinite points": ("estimator", estimated(NumpyEkf, points=lambda y: first(y, np.inf, float))),
    "a long quaternion": ("estimator", estimated(NumpyEkf, camera=lambda x: 2.0 * x)),
    "an asymmetric covariance": ("estimator", estimated(NumpyEkf, covariance=lambda P: P + np.triu(1e-3 + 0 * P, 1))),
    "labels of nothing": ("sensor", like(RangeSensor, measure=lambda found: (found.values, found.labels + 999))),
    "too many": ("sensor", like(RangeSensor, measure=lambda found: [np.repeat(one, 99, axis=0) for one in found])),
    "no visibility": ("sensor", type("Mine", (like(RangeSensor, visible=lambda _: None),), {"measure": nothing})),
    "no clearance": ("scene", like(SphereScene, clearance=lambda free: None)),
    "a failing clearance": ("scene", like(SphereScene, clearance=fails)),
    "a start outside": ("scene", type("Mine", (SphereScene,), {"start": lambda *_: (9.0, 0.0, 0.0)})),
    "no scene": ("scene", lambda *_: None),
}


@pytest.mark.parametrize("wrong", WRONG_PARTS)
def test_a_wrong_answer_of_a_part_is_an_error_with_its_name(wrong: str) -> None:
    """Ids of nothing made a map look better."""
    part, value = WRONG_PARTS[wrong]
    others = {"estimator": NumpyEkf} if part == "sensor" else {}
    with pytest.raises(ValueError, match=f"the {part} '"):
        stepped(**{**others, "scenario": {"association": "known"}, part: value})


class OneWay(SphereScene):
    def blocks(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return super().blocks(a, b) & (b[:, 0] > a[0])


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


class Angles(RangeSensor):
    def predict(self, camera: np.ndarray, point: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        z, H_x, H_y = super().predict(camera, point)
        scale = np.diag((0.005, 0.005, 1.0))  # [rad] of a pixel, about
        return scale @ z, scale @ H_x, scale @ H_y


def seen(truth: Any, label: int) -> tuple[np.ndarray, np.ndarray]:
    """The true camera, and the point of a label."""
    camera = np.concatenate((truth.position, truth.quaternion, truth.velocity, truth.angular_velocity))
    return camera, np.vstack((truth.fiducials, truth.landmarks))[label]


class Certain(Ekf):
    def reset(self, mean: np.ndarray, covariance: np.ndarray) -> None:
        super().reset(mean, 0.01 * covariance)


def row_before_column(found: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    z, H_x, H_y = found
    return z[::-1].copy(), H_x[::-1].copy(), H_y[::-1].copy()


def at_random(found: Any) -> Detections:
    return Detections(found.values + np.random.default_rng().normal(size=found.values.shape), found.labels)


class Near(PointSensor):
    def visible(self, camera: np.ndarray, points: np.ndarray) -> np.ndarray:
        return super().visible(camera, points) & (np.linalg.norm(points - camera[:3], axis=1) < 2.0)


def test_what_a_sensor_does_not_see_is_no_evidence_against_an_expected_landmark(monkeypatch) -> None:
    """The lens alone decided what had been looked at, and what the present image shows."""
    env: Any = gym.make("ActiveSLAM-v0", sensor=Near, gaze_period=0.05, end_when_lost=False).unwrapped
    env.reset(seed=0)
    visible, shown = env._perceptions[0].sensor.visible, list[np.ndarray]()
    for _ in range(60):
        before = env._run.expected["point"].copy()
        env.step((6, 1))
        left = before[(before != env._run.expected["point"]).any(axis=1)]
        assert visible(env.belief.camera, left).all()
    monkeypatch.setattr(candidates, "without_present", lambda _, belief, seen: shown.append(seen) or belief)
    env.motion_scores("net_information")
    np.testing.assert_array_equal(shown[0], visible(env.belief.camera, env.predicted_belief.points))
    assert env._run.expected["redraws"].any()


def test_a_singular_initialisation_is_no_landmark() -> None:
    """It was an error that named the estimator, where the sensor predicted nothing on the line of sight."""
    stepped(sensor=like(PointSensor, predict=row_before_column))
    sensor = like(PointSensor, predict=lambda found: (np.nan * found[0], 0.0 * found[1], 0.0 * found[2]))
    camera, scenario = np.eye(1, 13, 3)[0], Scenario()
    sensor = sensor(scenario, np.random.SeedSequence(0))
    _, _, Q = new_landmark(sensor, sensor.lens, camera, np.array((100.0, 80.0)), sensor.noise, 0.5, 0.3)
    assert np.isnan(Q[3:, 3:]).all()


class Localiser(Ekf):
    """It knows of fiducials alone: `check_estimator` demanded landmarks."""

    def add_landmark(self, value: np.ndarray, R: np.ndarray) -> int:
        return NEW


LAWS: dict[str, tuple[Callable[[Any], None], type]] = {
    "from b to a|past their clearance": (checks.check_scene, OneWay),
    "before their clearance": (checks.check_scene, like(SphereScene, clearance=lambda x: np.minimum(x + 0.1, x.max()))),
    "on no surface": (checks.check_scene, like(SphereScene, sample=lambda found: (found[0], -found[1]))),
    "pixel of the scenario's lens": (checks.check_sensor, Angles),
    "the pixel of the scenario's lens": (checks.check_sensor, like(PointSensor, predict=row_before_column)),
    "Jacobians": (checks.check_sensor, like(RangeSensor, predict=lambda found: (*found[:2], -found[2]))),
    r"visible\(\) denies": (checks.check_sensor, Blind),
    r"that visible\(\) shows": (checks.check_sensor, like(Blind, visible=lambda seen: ~seen)),
    "times the noise": (checks.check_sensor, Precise),
    "measures something else": (checks.check_sensor, like(RangeSensor, measure=at_random)),
    "overconfident": (checks.check_estimator, estimated(Ekf, covariance=lambda P: 1e-4 * P)),
    "errors of landmarks": (checks.check_estimator, estimated(Ekf, points=lambda y: y * (-1.0, 1.0, 1.0))),
    "not positive definite": (checks.check_estimator, estimated(Ekf, covariance=lambda P: P - 2.0 * np.eye(len(P)))),
    "begins with": (checks.check_estimator, Certain),
}


@pytest.mark.parametrize("law", LAWS)
def test_a_part_that_breaks_a_law_is_found(law: str) -> None:
    check, wrong = LAWS[law]
    with pytest.raises(ValueError, match=f"the (scene|sensor|estimator) '.*:{wrong.__name__}'.*({law})"):
        check(wrong)


def test_parts_that_hold_the_laws_pass() -> None:
    checks.check_scene(SphereScene)
    checks.check_scene("boxes", "office")
    checks.check_sensor("examples.extend_range_sensor:RangeSensor")
    checks.check_estimator("ekf")
    checks.check_estimator(Localiser)
    checks.check_sensor(RangeSensor, {"duration": 2.0})
    with pytest.raises(ValueError, match="the package's own; allowed"):
        checks.check_sensor("points")
