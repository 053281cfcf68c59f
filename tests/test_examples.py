"""The worked examples of the manual: each runs, and does what its page says."""

import runpy
import sys
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import baselines
from activeslam_gym import SCENARIOS, Gaze, Motion
from activeslam_gym.evaluation import run_episode
from activeslam_gym.information.candidates import goal_pose, propagate_by
from agents.policies import load
from baselines.greedy import Greedy
from examples import extend_sensor
from examples.extend_criterion import position_variance
from examples.extend_policy import look_around
from examples.extend_reward import accuracy
from tests.support import numerical_sight

ROOT = Path(__file__).resolve().parents[1]
EXAMPLES = [path for path in sorted((ROOT / "examples").glob("extend_*.py")) if "__main__" in path.read_text()]
EXAMPLES += [ROOT / "examples" / "fisher_trace.py"]
EXAMPLES += [ROOT / "examples" / "record_rerun.py"]


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_example_runs_and_says_something(path: Path, tmp_path: Path, monkeypatch: Any, capsys: Any) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [str(path)])
    if path.stem == "record_rerun":
        pytest.importorskip("rerun", reason="the extra `rerun` is not installed")
    if path.stem == "extend_smoother":
        pytest.importorskip("gtsam", reason="the extra `gtsam` is not installed")
    if path.stem == "extend_mesh":
        pytest.importorskip("embreex", reason="the extra `mesh` is not installed")
    with np.printoptions():
        runpy.run_path(str(path), run_name="__main__")
    SCENARIOS.pop("tunnel", None)
    assert capsys.readouterr().out.strip()


def test_a_scenario_of_ones_own_has_three_forms() -> None:
    from examples.extend_scenario import env, same, tunnel

    try:
        by_name = gym.make("ActiveSLAM-v0", scenario="tunnel")
    finally:
        del SCENARIOS["tunnel"]  # other tests go through all of them
    assert [one.unwrapped.scenario for one in (env, same, by_name)] == [tunnel] * 3


def test_the_criterion_is_the_drop_that_the_update_predicts() -> None:
    """Against the EKF's update in full: tr(P_pp) before and after, by the features in view of each goal."""
    env = gym.make("ActiveSLAM-v0", criterion=position_variance, reward=accuracy)
    env.reset(seed=3)
    for _ in range(12):
        env.step((Motion.RIGHT, Gaze.LEFT))
    models, belief = env.unwrapped.setting.models, env.unwrapped.predicted_belief
    scores = env.unwrapped.motion_scores(env.unwrapped.scenario.motion_criterion)
    P = belief.covariance.copy()
    propagate_by(models.motion, P, 0.0, 20)
    for index in Motion:
        pose = goal_pose(models.motion, belief, belief.camera, int(index), 0.0, 20)
        H = numerical_sight(models.lens, belief, pose)
        S = H @ P @ H.T + models.lens.pixel_std**2 * np.eye(len(H))
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


def test_the_policy_plays_one_or_many_and_joins_the_comparison() -> None:
    one = gym.make("ActiveSLAM-v0", duration=4.0)
    many = gym.make_vec("ActiveSLAM-v0", num_envs=3)
    for env, shape in ((one, (2,)), (many, (3, 2))):
        observation, _ = env.reset(seed=0)
        action = np.asarray(baselines.make(look_around, env).predict(observation)[0])
        assert action.shape == shape and np.all(action[..., 1] == Gaze.LEFT)
    named = load("examples.extend_policy:look_around", one)
    for policy in (look_around, named, lambda env: named, partial(Greedy, gaze_criterion="fisher_trace")):
        assert run_episode(one, policy, seed=0).landmarks_mapped[-1] > 0
