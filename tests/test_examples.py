"""The worked examples of the manual: each runs, and does what its page says."""

import runpy
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from activeslam_gym import SCENARIOS, Gaze, Motion
from activeslam_gym.envs.reward import REWARDS
from activeslam_gym.information import CRITERIA
from activeslam_gym.information.candidates import pose_after, propagated
from activeslam_gym.registry import Registry
from agents.policies import resolve
from examples import extend_policy, extend_sensor
from tests.support import numerical_sight, python

ROOT = Path(__file__).resolve().parents[1]
EXAMPLES = [*sorted((ROOT / "examples").glob("extend_*.py")), ROOT / "examples" / "fisher_trace.py"]
EXAMPLES += [ROOT / "examples" / "record_rerun.py"]


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_example_runs_and_says_something(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    if path.stem == "record_rerun":
        pytest.importorskip("rerun", reason="the extra `rerun` is not installed")
    if path.stem == "extend_smoother":
        pytest.importorskip("gtsam", reason="the extra `gtsam` is not installed")
    if path.stem == "extend_mesh":
        pytest.importorskip("embreex", reason="the extra `mesh` is not installed")
    assert python(path, PYTHONPATH=str(ROOT)).strip()


def test_a_scenario_of_ones_own_has_three_forms() -> None:
    from examples.extend_scenario import env, same, tunnel

    try:
        by_name = gym.make("ActiveSLAM-v0", scenario="tunnel")
    finally:
        del SCENARIOS["tunnel"]  # other tests go through all of them
    assert [one.unwrapped.scenario for one in (env, same, by_name)] == [tunnel] * 3


def run_example(name: str, registry: Registry[Any], monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """The names of an example, whose entry of the ``registry`` is there for one test: others go through all entries."""
    before = set(registry)
    names = runpy.run_path(str(ROOT / "examples" / f"{name}.py"))
    for entry in set(registry) - before:
        monkeypatch.setitem(registry, entry, registry.pop(entry))
    return names


def test_the_price_is_paid_once_a_translation_and_told(monkeypatch: pytest.MonkeyPatch) -> None:
    plain, priced = (gym.make("ActiveSLAM-v0") for _ in range(2))
    priced = run_example("extend_reward", REWARDS, monkeypatch)["PricedMotion"](priced, price=2.0)
    for env in (plain, priced):
        env.reset(seed=0)
    paid = []
    for motion in [Motion.RIGHT] * 4 + [Motion.STAY] * 2 + [Motion.LEFT] * 3:  # LEFT comes in mid-period, then counts
        paid.append(plain.step((motion, Gaze.STAY))[1] - priced.step((motion, Gaze.STAY))[1])
    np.testing.assert_allclose(paid, [2, 0, 0, 0, 0, 0, 0, 0, 2], atol=1e-9)
    *_, info = priced.step((Motion.UP, Gaze.STAY))
    assert info["reward_terms"]["price"] == 0.0


def test_the_criterion_is_the_drop_that_the_update_predicts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Against the EKF's update in full: tr(P_pp) before and after, by the features in view of each goal."""
    run_example("extend_criterion", CRITERIA, monkeypatch)
    env = gym.make("ActiveSLAM-v0")
    env.reset(seed=3)
    for _ in range(12):
        env.step((Motion.RIGHT, Gaze.LEFT))
    models, belief = env.unwrapped.setting.models, env.unwrapped.predicted_belief
    scores = env.unwrapped.motion_scores("position_variance")
    P = propagated(models.motion, belief.covariance, 0.0, 20)
    for index in Motion:
        pose = pose_after(models.motion, belief.camera, int(index), 0.0, 20)
        H = numerical_sight(models.camera, belief, pose)
        S = H @ P @ H.T + models.camera.pixel_std**2 * np.eye(len(H))
        gain = P @ H.T @ np.linalg.solve(S, H @ P)
        np.testing.assert_allclose(scores[index], np.trace(gain[:3, :3]), rtol=1e-5)


def test_the_filter_finds_what_it_is_handed() -> None:
    slam = extend_sensor.main(frames=40)
    points, P = slam.points()
    assert slam.ids.tolist() == [1]
    camera_error = slam.belief.state.camera[:3] - extend_sensor.position_at(39)
    errors = np.concatenate((camera_error, points[0] - extend_sensor.UNKNOWN))
    stds = np.sqrt(np.diag(P))[[0, 1, 2, 12, 13, 14]]
    assert (np.abs(errors) < 3.0 * stds).all() and (stds < 0.3).all()


def test_the_policy_is_bound_to_one_or_many_and_joins_the_comparison() -> None:
    one = gym.make("ActiveSLAM-v0")
    many = gym.make_vec("ActiveSLAM-v0", num_envs=3)
    for env, shape in ((one, (2,)), (many, (3, 2))):
        observation, _ = env.reset(seed=0)
        action = np.asarray(extend_policy.make(env).predict(observation)[0])
        assert action.shape == shape and np.all(action[..., 1] == Gaze.LEFT)  # everything is still expected
    same = resolve("examples.extend_policy:make", one).predict(observation := one.reset(seed=0)[0])[0]
    np.testing.assert_array_equal(same, extend_policy.make(one).predict(observation)[0])
