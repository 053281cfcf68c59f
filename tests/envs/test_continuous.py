"""`ActiveSLAMContinuous-v0`: the 21 actions are points of it, what lies between does what it says, and SAC runs."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import baselines
from activeslam_gym.motion import COMMANDS, motion_of
from tests.support import PAPER

NAME = "ActiveSLAMContinuous-v0"
SHORT = {"gaze_period": 0.25, "motion_period": 0.5, "duration": 3.0}
MOTION = motion_of(PAPER, 1.0)


def actions(count: int, seed: int = 0) -> np.ndarray:
    """(count, 2) of motions and gazes, all of them among them."""
    rng = np.random.default_rng(seed)
    return np.stack((rng.permutation(np.arange(count) % 7), rng.permutation(np.arange(count) % 3)), axis=1)


@pytest.mark.parametrize("scenario", ["paper", "office"])
def test_the_discrete_actions_are_points_of_it_to_the_bit(scenario: str) -> None:
    pairs, points = gym.make("ActiveSLAM-v0", scenario=scenario, **SHORT), gym.make(NAME, scenario=scenario, **SHORT)
    np.testing.assert_array_equal(pairs.reset(seed=3)[0], points.reset(seed=3)[0])
    for motion, gaze in actions(12):
        (seen, reward, *_, info), (other, same, *_, told) = (
            pairs.step((motion, gaze)),
            points.step(COMMANDS[motion, gaze].astype(np.float32)),
        )
        np.testing.assert_array_equal(seen, other)
        assert reward == same and info == told
    assert pairs.unwrapped.snapshot().motion == points.unwrapped.snapshot().motion


def moved(action: np.ndarray) -> tuple[np.ndarray, float]:
    """Displacement [m] and turn [rad] of two periods of one action from a start at rest."""
    env = gym.make(NAME, scenario={"acceleration_std": 0.0, "angular_acceleration_std": 1e-9}, gaze_period=0.25)
    env.reset(seed=0)
    before = env.unwrapped.truth
    for _ in range(8):
        env.step(action)
    after = env.unwrapped.truth
    turn = np.arctan2(after.quaternion[2], after.quaternion[0]) - np.arctan2(before.quaternion[2], before.quaternion[0])
    return after.position - before.position, 2.0 * turn


def test_half_an_action_does_half_of_it_and_a_long_one_is_shortened() -> None:
    half, full = moved(np.array([0.0, 0.0, 0.5, 0.5])), moved(np.array([0.0, 0.0, 1.0, 1.0]))
    assert half[1] == pytest.approx(0.5 * full[1], abs=0.02) and full[1] == pytest.approx(0.4, abs=0.05)
    assert np.linalg.norm(half[0]) == pytest.approx(0.5 * np.linalg.norm(full[0]), abs=0.05)
    long, _ = moved(np.array([1.0, 1.0, 1.0, 0.0]))
    assert np.linalg.norm(long) == pytest.approx(0.6, abs=0.08)
    np.testing.assert_allclose(long / np.linalg.norm(long), np.full(3, 3**-0.5), atol=0.15)


@pytest.mark.parametrize("name", ["mi-mi", "sweep", "orbit"])
def test_baselines_play_in_it(name: str) -> None:
    pairs, points = gym.make("ActiveSLAM-v0", **SHORT), gym.make(NAME, **SHORT)
    seen, other = pairs.reset(seed=1)[0], points.reset(seed=1)[0]
    policies = baselines.make(name, pairs), baselines.make(name, points)
    for _ in range(12):
        pair, point = policies[0].predict(seen)[0], policies[1].predict(other)[0]
        assert point in points.action_space
        seen, other = pairs.step(pair)[0], points.step(point)[0]
        np.testing.assert_array_equal(seen, other)


def test_gymnasium_and_sb3_take_it(recwarn: pytest.WarningsRecorder) -> None:
    check_env(gym.make(NAME, **SHORT).unwrapped, skip_render_check=True)
    sb3 = pytest.importorskip("stable_baselines3")
    from stable_baselines3.common.env_checker import check_env as check_by_sb3

    check_by_sb3(gym.make(NAME, **SHORT), warn=True)
    assert not [one for one in recwarn if "activeslam" in str(one.message).lower()]
    model = sb3.SAC("MlpPolicy", gym.make(NAME, **SHORT), learning_starts=10, batch_size=16, buffer_size=100, seed=0)
    model.learn(30)
    action, _ = model.predict(model.env.reset())
    assert action.shape == (1, 4) and (np.abs(action) <= 1.0).all()
