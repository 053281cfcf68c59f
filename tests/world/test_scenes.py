"""Registered scenes: what they hide is not detected, and what they hold stops the true camera."""

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import baselines
from activeslam_gym import Gaze, Motion, Scenario
from activeslam_gym.sensors.points import PointSensor
from activeslam_gym.world.room import draw_room
from activeslam_gym.world.scenes import BoxScene
from activeslam_gym.world.simulator import faces
from examples.extend_estimator import NumpyEkf
from examples.extend_scene import SphereScene

MARGIN = Scenario().wall_margin
BOX = ((-3.0, -1.0, 1.2), (3.0, 1.0, 1.9))


class Nothing(SphereScene):
    """Neither hides nor stops."""

    def blocks(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.zeros(len(b), bool)

    def clearance(self, p: np.ndarray, directions: np.ndarray, farthest: float) -> np.ndarray:
        return np.full(len(p), farthest)


def made(scene: Any, **fields: Any) -> Any:
    settings = {"gaze_period": 0.25, "duration": 8.0, "end_when_lost": False}
    return gym.make("ActiveSLAM-v0", scenario={"scene": scene, **fields}, **settings)


def distance_to_sphere(inner: Any) -> float:
    sphere = inner.truth.scene._scene
    return float(np.linalg.norm(inner.truth.position - sphere.centre)) - sphere.radius


@pytest.mark.parametrize("estimator", ["ekf", NumpyEkf])
def test_landmarks_behind_the_sphere_are_not_detected_under_a_policy(estimator: Any) -> None:
    """What is detected is what the camera would see, faces, and the sphere does not hide: no more and no less."""
    env = made(SphereScene, estimator=estimator, association="known", pixel_std=1e-6)
    observation, _ = env.reset(seed=2)
    inner, policy, state = env.unwrapped, baselines.make("mi-mi", env), None
    sensor = PointSensor(inner.scenario, np.random.SeedSequence(0))
    cosine, missing = np.cos(inner.scenario.facing_angle), 0
    for _ in range(24):
        action, state = policy.predict(observation, state)
        observation, *_ = env.step(action)
        truth, normals, K = inner.truth, inner._run.world.normals, inner.scenario.fiducial_count
        camera = np.concatenate((truth.position, truth.quaternion, np.zeros(6)))
        points = np.concatenate((truth.fiducials, truth.landmarks))
        shown = sensor.visible(camera, points)
        shown[K:] &= [faces(n, y, truth.position, cosine) for n, y in zip(normals, truth.landmarks)]
        blocked = truth.scene.blocks(truth.position, points)
        missing += int((shown & blocked).sum())
        assert sorted(inner.labels.detected.tolist()) == np.flatnonzero(shown & ~blocked).tolist()
    assert missing > 0


def test_noise_and_order_of_detections_do_not_depend_on_what_is_hidden() -> None:
    seen = {}
    for scene in ("sphere", "glass"):
        env = gym.make("ActiveSLAM-v0", scene=SphereScene, gaze_period=0.05)  # so that no estimate differs
        env.reset(seed=2)
        if scene == "glass":
            env.unwrapped.truth.scene._scene.blocks = lambda a, b: np.zeros(len(b), bool)
        env.step((Motion.STAY, Gaze.STAY))
        labels, pixels = env.unwrapped.labels.detected, env.unwrapped._run.detections["pixel"]
        seen[scene] = {label: tuple(pixel) for label, pixel in zip(labels.tolist(), pixels.tolist())}
    kept = {label: pixel for label, pixel in seen["glass"].items() if label in seen["sphere"]}
    assert list(kept.items()) == list(seen["sphere"].items()) and len(kept) < len(seen["glass"])


@pytest.mark.parametrize("estimator", ["ekf", NumpyEkf])
def test_a_camera_thrown_at_the_sphere_is_stopped_and_counted_and_the_estimator_told(estimator: Any) -> None:
    scenario = {"scene": SphereScene, "estimator": estimator, "association": "known"}
    env = gym.make("ActiveSLAM-v0", scenario=scenario, gaze_period=0.05, end_when_lost=False)
    env.reset(seed=0)
    inner, contacts, spread = env.unwrapped, 0, []
    inner._run.world.state.camera[7:10] = 0.2, 0.1, 7.0
    for _ in range(20):
        *_, info = env.step((Motion.STAY, Gaze.STAY))
        spread.append(float(np.trace(inner.belief.covariance[6:9, 6:9])))
        assert distance_to_sphere(inner) >= MARGIN - 1e-6
        if info["events"]["wall_contacts"]:
            out = inner.truth.position - inner.truth.scene._scene.centre
            assert inner.truth.velocity @ out / np.linalg.norm(out) > -0.2  # of 7 m/s
            if not contacts:
                assert spread[-1] > 3.0 * spread[-2]
        contacts += info["events"]["wall_contacts"]
    assert contacts > 0


class Walled(BoxScene):
    """An empty room, which is asked from places in the room alone."""

    def __init__(self, scenario: Scenario, rng: np.random.Generator) -> None:
        super().__init__(0.5 * np.array(scenario.room_size), np.zeros((0, 2, 3)))

    def clearance(self, p: np.ndarray, directions: np.ndarray, farthest: float) -> np.ndarray:
        assert (np.abs(p) <= self.half).all()
        return super().clearance(p, directions, farthest)


def test_a_camera_at_a_wall_without_a_margin_asks_a_scene_from_within_the_room() -> None:
    """Rays beside the camera began beyond the wall, where the clearance was negative."""
    env = made(Walled, wall_margin=0.0, goal_margin=0.0, acceleration_std=1.0)
    env.reset(seed=1)
    contacts = [env.step((Motion.UP, Gaze.STAY))[-1]["events"]["wall_contacts"] for _ in range(32)]
    assert sum(contacts) > 0
    scene, e = env.unwrapped.truth.scene._scene, np.eye(3)[:1]
    assert BoxScene.clearance(scene, (scene.half[0] + 1e-4) * e, e, 3.0) == 0.0


def test_the_stages_are_the_compiled_frame_to_the_bit() -> None:
    """In a scene of nothing, with the same points, the run is that of the kernel."""
    kernel = gym.make("ActiveSLAM-v0", scenario={"landmark_layout": "surfaces"}, gaze_period=0.25)
    staged = made(Nothing)
    for env in (kernel, staged):
        env.reset(seed=5)
    runs = [env.unwrapped._runs for env in (kernel, staged)]
    for name in ("state", "fiducials", "landmarks", "normals"):
        getattr(runs[1].world, name)[:] = getattr(runs[0].world, name)
    runs[1].expected[:], runs[1].episode[:] = runs[0].expected, runs[0].episode
    runs[0].models["on_surfaces"] = False
    for k in range(24):
        steps = [env.step((k // 4 % 7, k % 3)) for env in (kernel, staged)]
        assert steps[0][1] == steps[1][1]
        assert {**steps[0][4], "reward_terms": 0} == {**steps[1][4], "reward_terms": 0}
        np.testing.assert_array_equal(steps[0][0][32:], steps[1][0][39:])


def test_what_does_not_go_with_a_scene_is_an_error() -> None:
    full = type("Full", (SphereScene,), {"clearance": lambda self, p, *_: np.zeros(len(p))})
    with pytest.raises(RuntimeError, match="Full"):
        draw_room(Scenario(scene=full), np.random.default_rng(0))
    with pytest.raises(ValueError, match=r"scenario.scene must be one of boxes.*'unheard'"):
        gym.make("ActiveSLAM-v0", scenario={"scene": "unheard"})
    with pytest.raises(ValueError, match="scenario.boxes must be"):
        Scenario(scene=SphereScene, boxes=(BOX,))  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="clutter_rate must be 0"):
        gym.make("ActiveSLAM-v0", scenario="clutter", sensor=PointSensor).reset()
    with pytest.raises(ValueError, match="scenario.scene must be 'boxes'"):
        gym.make("ActiveSLAM-v0", scenario={"scene": SphereScene, "sensor": "images"})
