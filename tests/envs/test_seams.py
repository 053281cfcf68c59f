"""Estimators and sensors of a user's own fly whole episodes; the step in Python is that of the kernel."""

from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import baselines
from activeslam_gym.config import DEPTH_PARTICLES, INVERSE_DEPTH, KNOWN, UNKNOWN
from activeslam_gym.evaluation import Episode, run_episode
from activeslam_gym.sensors.points import PointSensor
from activeslam_gym.slam.ekf import Ekf
from examples.extend_estimator import NumpyEkf
from examples.extend_range_sensor import RangeSensor
from tests.config.test_random_scenarios import random_scenario

NUMPY = {"estimator": NumpyEkf, "scenario": {"association": "known"}}


def flown(seed: int, seconds: float, **parts: Any) -> Episode:
    """An episode of `mi-mi`."""
    env: Any = gym.make("ActiveSLAM-v0", gaze_period=0.25, duration=seconds, **parts)
    return run_episode(env, baselines.make("mi-mi", env), seed)


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


def test_a_range_sensor_flies_with_the_built_in_filter_and_planner_and_tells_more_than_a_pixel() -> None:
    pixel, ranged = ([flown(seed, 10.0, sensor=sensor) for seed in range(4)] for sensor in (PointSensor, RangeSensor))
    assert np.median([run.log_score[-1] for run in ranged]) > np.median([run.log_score[-1] for run in pixel]) + 10.0
    assert not any(run.lost or run.events["wrong_matches"].sum() for run in ranged)
    assert np.mean([run.position_nees for run in ranged]) < 2.0


def test_an_estimator_from_outside_flies_a_whole_episode() -> None:
    run = flown(3, 35.0, **NUMPY)
    assert not run.lost and run.landmarks_mapped[-1] >= 5
    assert run.log_score[-1] > 100.0 and run.position_error[-1] < 0.1
    assert run.events["wrong_matches"].sum() == 0
