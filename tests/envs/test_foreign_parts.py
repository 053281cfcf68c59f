"""A user's own parts: a wrong answer is an error with the part's name and the frame."""

import dataclasses
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from activeslam_gym.sensors.sensor import Detections
from activeslam_gym.slam.estimate import Estimate
from examples.extend_estimator import NumpyEkf
from examples.extend_range_sensor import RangeSensor
from examples.extend_scene import SphereScene

KNOWN: dict[str, Any] = {"association": "known"}


def fails(*_: Any) -> Any:
    raise KeyError("gone")


def flown(steps: int = 3, **arguments: Any) -> list[dict[str, Any]]:
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


def estimated(**changes: Callable[[Any], Any]) -> type:
    """An estimator with other fields of its estimates, once there are landmarks."""

    def change(e: Estimate) -> Estimate:
        new = {name: function(getattr(e, name)) for name, function in changes.items()} if len(e.ids) else {}
        return dataclasses.replace(e, **new)

    return like(NumpyEkf, estimate=change)


def with_landmark_of_nothing(e: Estimate) -> Estimate:
    n, P = len(e.ids), np.eye(len(e.covariance) + 3) * 1e-9
    P[:-3, :-3] = e.covariance
    yes = np.append(e.mapped, True)
    return Estimate(e.camera, np.append(e.ids, 999), np.vstack((e.points, np.ones((1, 3)))), P, yes, yes) if n else e


WRONG_ESTIMATORS = {
    "an id of nothing": like(NumpyEkf, update=lambda m: first(m, 999, int)),
    "a failing predict": like(NumpyEkf, predict=fails),
    "a landmark of nothing": like(NumpyEkf, estimate=with_landmark_of_nothing),
    "the same id twice": estimated(ids=lambda ids: np.full(len(ids), ids[0])),
    "infinite points": estimated(points=lambda y: first(y, np.inf, float)),
    "a long quaternion": estimated(camera=lambda x: 2.0 * x),
    "an asymmetric covariance": estimated(covariance=lambda P: P + np.triu(np.full(P.shape, 1e-3), 1)),
}


@pytest.mark.parametrize("wrong", WRONG_ESTIMATORS)
def test_ids_of_nothing_made_a_map_look_better(wrong: str) -> None:
    with pytest.raises(ValueError, match="the estimator '.*:Mine'") as told:
        flown(scenario=KNOWN, estimator=WRONG_ESTIMATORS[wrong])
    assert "in frame" in str(told.value)


def test_an_estimator_of_lists_and_single_precision_is_right() -> None:
    single = dict.fromkeys(("camera", "points", "covariance"), np.float32)
    kind = estimated(ids=list, mapped=list, **single)  # type: ignore[arg-type]
    lists = type("Mine", (kind,), {"update": lambda s, m: NumpyEkf.update(s, m).tolist()})
    mine, own = (flown(5, scenario=KNOWN, estimator=estimator)[-1] for estimator in (lists, NumpyEkf))
    assert mine["entropy"] == pytest.approx(own["entropy"], abs=0.1)
    assert mine["events"] == own["events"]


def sensed(change: Callable[[Any, Any], Any]) -> type:
    return like(RangeSensor, measure=lambda found: change(*found))


def noisy(change: Callable[[np.ndarray], np.ndarray]) -> type:
    """A sensor with another noise, which measures nothing."""

    def init(self: Any, scenario: Any, seed: Any) -> None:
        RangeSensor.__init__(self, scenario, seed)
        self.noise = change(self.noise)

    return type("Mine", (RangeSensor,), {"__init__": init, "measure": nothing})


def nothing(*_: Any) -> Detections:
    return Detections(np.zeros((0, 3)), [])  # type: ignore[arg-type]


WRONG_SENSORS = {
    "labels of nothing": sensed(lambda values, labels: (values, labels + 999)),
    "too many": sensed(lambda values, labels: (np.tile(values, (99, 1)), np.tile(labels, 99))),
    "a failing measure": like(RangeSensor, measure=fails),
    "no noise": noisy(lambda R: None),
    "asymmetric noise": noisy(lambda R: R + np.triu(np.ones(R.shape), 1)),
    "no visibility": type("Mine", (like(RangeSensor, visible=lambda seen: None),), {"measure": nothing}),
}


@pytest.mark.parametrize("wrong", WRONG_SENSORS)
def test_a_wrong_answer_of_a_sensor_is_told_by_name(wrong: str) -> None:
    with pytest.raises(ValueError, match="the sensor '.*:Mine'"):
        flown(scenario=KNOWN, sensor=WRONG_SENSORS[wrong], estimator=NumpyEkf)


WRONG_SCENES = {
    "no bounds": type("Mine", (SphereScene,), {"bounds": None, "__init__": lambda *_: None}),
    "no clearance": like(SphereScene, clearance=lambda free: None),
    "a failing clearance": like(SphereScene, clearance=fails),
    "blocks of None": like(SphereScene, blocks=lambda hides: None),
    "no scene": lambda *_: None,
}


@pytest.mark.parametrize("wrong", WRONG_SCENES)
def test_a_wrong_answer_of_a_scene_is_told_by_name(wrong: str) -> None:
    with pytest.raises(ValueError, match="the scene '"):
        flown(scene=WRONG_SCENES[wrong])
