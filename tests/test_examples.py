"""The worked examples of the manual: each runs, and does what its page says."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from activeslam_gym import SCENARIOS, Gaze, Motion, information
from tests.support import numerical_sight

ROOT = Path(__file__).resolve().parents[1]
EXAMPLES = [*sorted((ROOT / "examples").glob("extend_*.py")), ROOT / "examples" / "fisher_trace.py"]


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_example_runs_and_says_something(path: Path) -> None:
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, str(path)], capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip()


def test_a_scenario_of_ones_own_has_three_forms() -> None:
    from examples.extend_scenario import corridor, env, same

    try:
        by_name = gym.make("ActiveSLAM-v0", scenario="corridor")
    finally:
        del SCENARIOS["corridor"]  # other tests go through all of them
    assert [one.unwrapped.scenario for one in (env, same, by_name)] == [corridor] * 3


def test_the_price_is_paid_once_a_translation_and_told() -> None:
    from examples.extend_reward import PricedMotion

    plain, priced = (gym.make("ActiveSLAM-v0", gaze_period=0.25) for _ in range(2))
    priced = PricedMotion(priced, price=2.0)
    for env in (plain, priced):
        env.reset(seed=0)
    paid = []
    for motion in [Motion.RIGHT] * 4 + [Motion.STAY] * 2 + [Motion.LEFT] * 3:  # LEFT comes in mid-period, then counts
        paid.append(plain.step((motion, Gaze.STAY))[1] - priced.step((motion, Gaze.STAY))[1])
    np.testing.assert_allclose(paid, [2, 0, 0, 0, 0, 0, 0, 0, 2], atol=1e-9)
    *_, info = priced.step((Motion.UP, Gaze.STAY))
    assert info["reward_terms"]["price"] == 0.0


def test_the_criterion_is_the_drop_that_the_update_predicts() -> None:
    """Against the EKF's update in full: tr(P_pp) before and after, for what is in view of each goal."""
    from examples.extend_criterion import position_variance_reduction

    env = gym.make("ActiveSLAM-v0", gaze_period=0.25)
    env.reset(seed=3)
    for _ in range(12):
        env.step((Motion.RIGHT, Gaze.LEFT))
    scores = position_variance_reduction(env)
    inner = env.unwrapped
    models, prospect = inner.setting.models, inner.prospect
    P = information.propagated(models.motion, prospect.covariance, 0.0, 20)
    for index in Motion:
        pose = information.pose_after(models.motion, prospect.camera, int(index), 0.0)
        H = numerical_sight(models.camera, prospect, pose)
        S = H @ P @ H.T + models.camera.pixel_std**2 * np.eye(len(H))
        P_after = P - P @ H.T @ np.linalg.solve(S, H @ P)
        np.testing.assert_allclose(scores[index], np.trace((P - P_after)[:3, :3]), rtol=1e-5)


@pytest.mark.parametrize("num_envs", [None, 3])
def test_the_policy_is_bound_to_one_or_many(num_envs: int | None) -> None:
    from examples.extend_policy import make

    if num_envs is None:
        env = gym.make("ActiveSLAM-v0", gaze_period=0.25)
    else:
        env = gym.make_vec("ActiveSLAM-v0", num_envs=num_envs, gaze_period=0.25)
    observation, _ = env.reset(seed=0)
    policy = make(env)
    action, _ = policy.predict(observation)
    assert np.shape(action) == ((2,) if num_envs is None else (num_envs, 2))
    assert np.all(np.asarray(action)[..., 1] == Gaze.LEFT)  # everything is still expected


def test_the_policy_joins_the_comparison() -> None:
    from agents.policies import resolve

    env = gym.make("ActiveSLAM-v0")
    assert type(resolve("examples.extend_policy:make", env)).__name__ == "LookAround"
