"""What a hostile user hands in: one clear error that names the argument, and never a NaN, a crash or a traceback."""

import copy
import itertools
import threading
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import pytest

import baselines
from activeslam_gym import ActiveSLAMEnv, ActiveSLAMVectorEnv, observation_layout
from activeslam_gym.information.candidates import ACTION

HUGE = 10**400
NOTHING_GOOD = (-1, 0, -HUGE, float("nan"), "bogus", "", [], True, b"x", object(), np.array([1, 2]), 1j, [("a", 1)])
BAD_VALUES: dict[str, tuple[Any, ...]] = {
    "scenario": (*NOTHING_GOOD[:-1], 5, None, {5: 3}, {"bogus": 1}, {"motion_criterion": "bogus"}),
    "gaze_period": (*NOTHING_GOOD, HUGE, 1e300, 1e-300, float("inf"), {}, 0.07),
    "motion_period": (*NOTHING_GOOD, HUGE, 1e300, float("inf"), {}, None, 0.07),
    "duration": (*NOTHING_GOOD, HUGE, 1e300, float("inf"), {}, 0.07),
    "reward": (*NOTHING_GOOD, HUGE, {}, None),
    "lost_position_error": (*NOTHING_GOOD, HUGE, {}, None),
    "render_mode": (*NOTHING_GOOD, HUGE, {}, 5),
}
BAD_VECTOR_VALUES = {
    "num_envs": (*NOTHING_GOOD, {}, 2.5, None),
    "num_threads": (*NOTHING_GOOD, {}, 2.5),
    "autoreset_mode": (*NOTHING_GOOD, {}, None),
    "max_episode_steps": (*NOTHING_GOOD, {}, 2.5),
}
BAD_ACTIONS = (None, 5, [1], [1, 2, 3], [7, 0], [0, 3], [-1, 0], [0.5, 0], [float("nan"), 0], "ab", ["a", "b"], {})
BAD_ACTIONS += ([[1, 2]], np.array([1, 2], object), [HUGE, 0], [True, False], np.array([1 + 0j, 2]))
JUST_ALLOWED: tuple[dict[str, Any], ...] = (
    *({"rate_loop_time": 0.0251}, {"controller_frequency": 16.5}, {"room_size": (1e12,) * 3}, {"clutter_rate": 200}),
    *({"pixel_std": 1e-12}, {"acceleration_std": 1e12}, {"orientation_std": 1e12}, {"inverse_depth_mean": 1e-12}),
    *({"distortion": 1e12}, {"true_distortion": -1e-7}),
    {"particle_depth": (1e-12, 1e12), "initialisation": "depth_particles"},
    {"particle_prune": 0.999, "initialisation": "depth_particles"},
)
BAD_SEEDS = (-1, 1.5, "a", object(), np.float64(3.0), True)


@pytest.fixture(scope="module")
def env() -> ActiveSLAMEnv:
    out = ActiveSLAMEnv()
    out.reset(seed=1)
    return out


@pytest.fixture(scope="module")
def batch() -> ActiveSLAMVectorEnv:
    out = ActiveSLAMVectorEnv(2)
    out.reset(seed=1)
    return out


def refuses(argument: str, call: Callable[..., Any], *values: Any, **named: Any) -> None:
    """A call fails, and names the argument."""
    with pytest.raises(ValueError) as error:
        call(*values, **named)
    assert argument in str(error.value), f"{error.value!r} does not name {argument}"


@pytest.mark.parametrize("argument", [*BAD_VALUES, *BAD_VECTOR_VALUES])
def test_a_constructor_names_the_argument(argument: str) -> None:
    for value in (BAD_VALUES | BAD_VECTOR_VALUES)[argument]:
        refuses(argument, ActiveSLAMVectorEnv, **{"num_envs": 2, argument: value})
        if argument in BAD_VALUES:
            refuses(argument, ActiveSLAMEnv, **{argument: value})


def test_actions_seeds_and_options_are_named(env: ActiveSLAMEnv, batch: ActiveSLAMVectorEnv) -> None:
    twin = copy.deepcopy(batch)
    for action in BAD_ACTIONS:
        refuses("action", env.step, action)
        refuses("action", batch.step, action)
        refuses("action", batch.step, [action, action])
    refuses("actions[1]", batch.step, [[0, 0], [7, 0]])
    np.testing.assert_array_equal(batch.step([[0, 0], [1, 1]])[0], twin.step([[0, 0], [1, 1]])[0])
    for seed in BAD_SEEDS:
        refuses("seed", env.reset, seed=seed)
        refuses("seed", batch.reset, seed=seed)
        refuses("seed", batch.reset, seed=[0, seed])
    refuses("seed", batch.reset, seed=[1, 2, 3])
    for options in (5, [], "a", True):
        refuses("options", env.reset, options=options)
        refuses("options", batch.reset, options=options)
    for mask in (5, [True, False], np.array([1, 0]), np.zeros(2, bool), np.ones(1, bool), np.ones((2, 1), bool), None):
        refuses("reset_mask", batch.reset, options={"reset_mask": mask})


def test_scores_policies_and_layouts_are_named(env: ActiveSLAMEnv, batch: ActiveSLAMVectorEnv) -> None:
    for core, criterion in itertools.product((env, batch), (5, None, [], {}, "bogus", object(), b"x", ("a",))):
        for scores in (core.motion_scores, core.gaze_scores, core.joint_scores):
            refuses("criterion", scores, criterion)
    none = ((0, 0, 10**10), (7, 0, 1), (0, 3, 1), (0, 0, -1))
    for plans in (None, 5, [], np.zeros(3), np.zeros((2, 2)), "a", *(np.array([[one]], ACTION) for one in none)):
        refuses("plans", env.scores, plans)
    refuses("seed", baselines.fixed.Random, batch, np.arange(3))
    foreign = gymnasium.make("CartPole-v1"), gymnasium.make_vec("CartPole-v1", num_envs=1)
    for other in (*foreign, None, 5, "ActiveSLAM-v0"):
        for name in baselines.names():
            refuses("env", baselines.make, name, other)
        refuses("env", observation_layout, other)
    for name in ("bogus", None, 5, ""):
        refuses("name", baselines.make, name, env)


@pytest.mark.parametrize("fields", JUST_ALLOWED)
def test_what_is_just_allowed_makes_no_nan(fields: dict[str, Any]) -> None:
    env = ActiveSLAMEnv(fields)
    env.reset(seed=3)
    for k in range(25):
        observation, reward, terminated, _, info = env.step([k % 7, k % 3])
        told = [reward, *info["reward_terms"].values(), *info["log2_det"].values(), info["entropy"], info["log_score"]]
        assert np.isfinite(observation).all() and np.isfinite(told).all()
        assert not np.isnan([value for value in info.values() if isinstance(value, float)]).any()
        if terminated:
            break


def test_points_in_a_scenario_of_images_are_a_warning(recwarn: pytest.WarningsRecorder) -> None:
    ActiveSLAMEnv("corner-pixels", sensor="points")
    assert not recwarn
    with pytest.warns(UserWarning, match="ActiveSLAMPixels-v0"):
        ActiveSLAMEnv("corner-pixels")
    for make in (gymnasium.make, gymnasium.make_vec):
        refuses("sensor", make, "ActiveSLAMPixels-v0", sensor="points")


def test_a_motion_period_in_which_no_translation_reaches_its_goal_is_a_warning(
    recwarn: pytest.WarningsRecorder,
) -> None:
    """The limit of accelerations cut 0.3 m in 0.25 s to 0.23 m, and scores were of the goal."""
    ActiveSLAMEnv(motion_period=0.5)
    assert not recwarn
    with pytest.warns(UserWarning, match="motion_period 0.25 s is too short .* of 0.3 m.* 0.416 s or more"):
        ActiveSLAMEnv(motion_period=0.25)


def test_an_unknown_argument_has_the_error_message_of_python_which_torchrl_reads() -> None:
    with pytest.raises(TypeError, match="unexpected keyword argument 'frameskip'"):
        ActiveSLAMEnv(frameskip=1)  # type: ignore[call-arg]


def test_one_environment_in_two_threads_is_an_error_and_no_crash() -> None:
    env, errors = ActiveSLAMVectorEnv(16, num_threads=1, gaze_period=1.0), []
    env.reset(seed=1)

    def step(k: int) -> None:
        for _ in range(20):
            try:
                _ = env.reset(seed=k) if k == 2 else env.step(np.zeros((16, 2), int))
            except RuntimeError as error:
                errors.append(str(error))

    threads = [threading.Thread(target=step, args=(k,)) for k in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert set(errors) == {"an environment is used by two threads at once; make one for each thread"}
    assert np.isfinite(env.step(np.zeros((16, 2), int))[1]).all()
