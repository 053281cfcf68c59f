"""``ActiveSLAMPixels-v0``: the same environment, and images for a sensor."""

import dataclasses
import sys
import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import activeslam_gym  # noqa: F401  (registers the environment)
from activeslam_gym import SCENARIOS
from activeslam_gym.camera import camera_point, pixel_from_camera_point
from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.motion import QUATERNION, Gaze, Motion
from tests.support import moments

pytest.importorskip("cv2")

NAME = "ActiveSLAMPixels-v0"
ACTIONS = [(Motion.LEFT, Gaze.STAY)] * 6 + [(Motion.UP, Gaze.LEFT)] * 6
LONG = {"gaze_period": 0.1, "motion_period": 0.2}


@pytest.fixture(scope="module")
def played():
    """An environment that has played all actions."""
    env = gym.make(NAME, **LONG)
    return env, *moments(env, 3, ACTIONS)


def test_it_is_a_gymnasium_environment_with_the_spaces_of_points() -> None:
    env, points = gym.make(NAME, duration=1.0).unwrapped, gym.make("ActiveSLAM-v0", scenario="pixels", duration=1.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env, skip_render_check=True)
    assert env.observation_space == points.observation_space and env.action_space == points.action_space
    env.reset(seed=4), points.reset(seed=4)
    np.testing.assert_array_equal(env.truth.position, points.unwrapped.truth.position)


def test_a_batch_is_its_single_environments_through_an_autoreset() -> None:
    arguments = {"gaze_period": 0.1, "motion_period": 0.2, "duration": 0.4}
    batch = gym.make_vec(NAME, num_envs=2, num_threads=2, **arguments)
    together = [batch.reset(seed=7)[0]] + [batch.step([action] * 2)[0] for action in ACTIONS[:8]]
    for i in range(2):
        env = gym.make(NAME, **arguments)
        alone = [*moments(env, 7 + i, ACTIONS[:8])[0], *moments(env, None, ACTIONS[5:8])[0]]
        np.testing.assert_array_equal(np.array(together)[:, i], alone[: len(together)])
    batch.close()


def test_the_images_tell_where_the_camera_is_by_matches_good_to_a_fraction_of_a_pixel(played) -> None:
    env, _, _, infos = played
    core = env.unwrapped
    run, followed, z, errors = core._run, core._perceptions[0]._followed, np.empty(2), []
    older = run.ekf.feature[: run.ekf.state.count]
    for one in run.detections[: int(run.episode.detection_count)]:
        if one["match"] in older["id"][older["born"] < run.ekf.state.frame]:
            pose, point = run.world.state.camera, followed.of(one["match"][None])[0]
            p_C = camera_point(rotation_matrix(pose[QUATERNION]), pose, point)
            assert pixel_from_camera_point(run.models.true_lens, p_C, z)
            errors.append(one["pixel"] - z)
    assert len(errors) > 4 and np.median(np.abs(errors)) < 0.3
    assert infos[-1]["position_error"] < 0.2 and infos[-1]["orientation_error"] < 0.1
    assert infos[-1]["entropy"] < infos[0]["entropy"] - 100.0, "bits"
    born, gone = (sum(info["events"][name] for info in infos[1:]) for name in ("initialised", "deletions"))
    assert born > 8 and born - gone == run.ekf.state.count
    assert sum(info["events"]["wrong_matches"] for info in infos[1:]) < 0.1 * 13 * len(infos), "a tenth of the matches"


@pytest.mark.parametrize(("field", "value"), [("start", "anywhere"), ("landmark_layout", "surfaces")])
def test_a_room_that_is_not_drawn_is_refused(field: str, value: str) -> None:
    with pytest.raises(ValueError, match=f"scenario.{field} must be .* or .* for images, got '{value}'"):
        gym.make(NAME, scenario=dataclasses.replace(SCENARIOS["pixels"], **{field: value}))


@pytest.mark.parametrize("field", ["cluster_std", "facing_angle", "new_feature_gate_probability", "door_width"])
def test_a_field_without_an_effect_on_images_is_refused(field: str) -> None:
    value = 0.9 * getattr(SCENARIOS["pixels"], field)
    with pytest.raises(ValueError, match=f"scenario.{field} must be .* for images"):
        gym.make(NAME, scenario=dataclasses.replace(SCENARIOS["pixels"], **{field: value}))


@pytest.mark.parametrize("start", ["corner", "wall"])
def test_the_camera_knows_where_it_is_from_a_start_at_a_wall(start: str) -> None:
    env = gym.make(NAME, scenario=dataclasses.replace(SCENARIOS["pixels"], start=start, room_size=(7.0, 2.4, 7.0)))
    for seed in range(3):
        env.reset(seed=seed)
        for _ in range(4):
            env.step((Motion.STAY, Gaze.STAY))
        core = env.unwrapped
        assert np.linalg.norm(core.truth.position - core.belief.position) < 0.03
        assert {-1, -2, -3, -4} <= set(core.labels.matched.tolist())
        assert core.nees()["position"] < 5.0


def test_without_opencv_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(ModuleNotFoundError, match=r"pip install -e '\.\[vision\]'"):
        gym.make(NAME)


def test_slots_of_the_score_are_the_scene_points_of_their_features(played) -> None:
    env = played[0].unwrapped
    belief, labels = env.belief, env.labels
    owned = np.flatnonzero(labels.owners >= 0)
    assert len(owned) > 5
    P = np.array([belief.covariance[12 + 3 * k : 15 + 3 * k, 12 + 3 * k : 15 + 3 * k] for k in owned])
    error = env.truth.landmarks[labels.owners[owned]] - belief.landmarks[owned]
    square = np.einsum("ki,kij,kj->k", error, np.linalg.inv(P), error)
    assert np.median(square) < 8.0, "chi squared with 3 degrees of freedom"
    right = labels.detected[labels.matched > 0]
    assert np.isin(labels.owners[owned], right - 4).any(), "detections bear their slots"
