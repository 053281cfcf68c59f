"""The seams: estimators and sensors from outside run whole episodes, and wrong ones are errors that name them."""

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import baselines
from activeslam_gym.evaluation import Episode, run_episode
from activeslam_gym.sensors.sensor import SENSORS, Detections
from examples.extend_range_sensor import RangeSensor

NUMPY = {"estimator": "numpy-ekf", "association": "known"}
RANGE = {**NUMPY, "sensor": "range-and-bearing"}


def flown(scenario: Any, seed: int, seconds: float) -> Episode:
    """An episode of `mi-mi`."""
    env: Any = gym.make("ActiveSLAM-v0", scenario=scenario, gaze_period=0.25, duration=seconds)
    return run_episode(env, baselines.make("mi-mi", env), seed)


def test_an_estimator_from_outside_flies_a_whole_episode() -> None:
    run = flown(NUMPY, 3, 35.0)
    assert not run.lost and run.landmarks_mapped[-1] >= 5
    assert run.log_score[-1] > 100.0 and run.position_error[-1] < 0.1
    assert run.events["wrong_matches"].sum() == 0


def test_a_range_tells_more_than_a_pixel_alone() -> None:
    pixel, ranged = (np.median([flown(one, seed, 5.0).log_score[-1] for seed in range(4)]) for one in (NUMPY, RANGE))
    assert ranged > pixel


def test_the_compiled_estimator_takes_the_pixels_of_a_sensor_from_outside() -> None:
    class Pixels(RangeSensor):
        """The same without its range."""

        def measure(self, truth: Any, time: float) -> Detections:
            values, labels = super().measure(truth, time)
            return Detections(values[:, :2], labels)

        def model(self) -> Any:
            return self._model._points

    with entered(SENSORS, "pixels-alone", Pixels):
        run = flown({"sensor": "pixels-alone"}, 0, 5.0)
    assert run.log_score[-1] > 50.0 and run.events["wrong_matches"].sum() == 0
    with pytest.raises(ValueError, match="'ekf' takes measurements of two numbers.*range-and-bearing.* have 3"):
        gym.make("ActiveSLAM-v0", scenario={"sensor": "range-and-bearing"}).reset(seed=0)


class entered:  # noqa: N801
    """An entry of a registry for the length of a test."""

    def __init__(self, registry: Any, name: str, entry: Any) -> None:
        self.registry, self.name = registry, name
        registry.register(name)(entry)

    def __enter__(self) -> None:
        pass

    def __exit__(self, *_: object) -> None:
        del self.registry[self.name]
