"""Parts that others register: a wrong answer is an error with the part's name and the frame."""

import dataclasses
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from activeslam_gym.sensors.sensor import SENSORS, Detections
from activeslam_gym.slam.estimate import Estimate
from activeslam_gym.slam.estimator import ESTIMATORS
from activeslam_gym.world.scenes import SCENES
from examples.extend_estimator import NumpyEkf
from examples.extend_range_sensor import RangeModel, RangeSensor
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
def test_ids_of_nothing_made_a_map_look_better(wrong: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(ESTIMATORS, "mine", WRONG_ESTIMATORS[wrong])
    with pytest.raises(ValueError, match="the estimator 'mine'") as told:
        flown(scenario={"estimator": "mine", **KNOWN})
    assert "in frame" in str(told.value)


def test_an_estimator_of_lists_and_single_precision_is_right(monkeypatch: pytest.MonkeyPatch) -> None:
    single = dict.fromkeys(("camera", "points", "covariance"), np.float32)
    kind = estimated(ids=list, mapped=list, **single)  # type: ignore[arg-type]
    monkeypatch.setitem(
        ESTIMATORS, "mine", type("Mine", (kind,), {"update": lambda s, m: NumpyEkf.update(s, m).tolist()})
    )
    mine, own = (flown(5, scenario={"estimator": name, **KNOWN})[-1] for name in ("mine", "numpy-ekf"))
    assert mine["entropy"] == pytest.approx(own["entropy"], abs=0.1)
    assert mine["events"] == own["events"]


def sensed(change: Callable[[Any, Any], Any]) -> type:
    return like(RangeSensor, measure=lambda found: change(*found))


def modelled(**methods: Callable[..., Any]) -> type:
    """A sensor whose model answers otherwise; ``noise`` is one of the answers."""
    noise = methods.pop("noise", lambda R: R)
    model: Any = like(RangeModel, **methods)

    def init(self: Any, scenario: Any, seed: Any) -> None:
        RangeSensor.__init__(self, scenario, seed)
        self._model = model(scenario)
        self._model.noise = noise(self._model.noise)

    return type(
        "Mine", (RangeSensor,), {"__init__": init, "measure": lambda self, *_: Detections(np.zeros((0, 3)), [])}
    )


WRONG_SENSORS = {
    "labels of nothing": sensed(lambda values, labels: (values, labels + 999)),
    "too many": sensed(lambda values, labels: (np.tile(values, (99, 1)), np.tile(labels, 99))),
    "a failing measure": like(RangeSensor, measure=fails),
    "no model": like(RangeSensor, model=lambda model: None),
    "asymmetric noise": modelled(noise=lambda R: R + np.triu(np.ones(R.shape), 1)),
    "no visibility": modelled(visible=lambda seen: None),
}


@pytest.mark.parametrize("wrong", WRONG_SENSORS)
def test_a_wrong_answer_of_a_sensor_is_told_by_name(wrong: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(SENSORS, "mine", WRONG_SENSORS[wrong])
    with pytest.raises(ValueError, match="the sensor 'mine'"):
        flown(scenario={"sensor": "mine", "estimator": "numpy-ekf", **KNOWN})


WRONG_SCENES = {
    "no bounds": type("Mine", (SphereScene,), {"bounds": None, "__init__": lambda *_: None}),
    "no clearance": like(SphereScene, clearance=lambda free: None),
    "a failing clearance": like(SphereScene, clearance=fails),
    "blocks of None": like(SphereScene, blocks=lambda hides: None),
    "no scene": lambda *_: None,
}


@pytest.mark.parametrize("wrong", WRONG_SCENES)
def test_a_wrong_answer_of_a_scene_is_told_by_name(wrong: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(SCENES, "mine", WRONG_SCENES[wrong])
    with pytest.raises(ValueError, match="the scene 'mine'"):
        flown(scenario={"scene": "mine"})
