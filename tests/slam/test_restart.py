"""A belief that the fiducials contradict is reset, unless the scenario says no, and no other is."""

from typing import Any

import gymnasium
import numpy as np
import pytest

from activeslam_gym.config import Scenario
from activeslam_gym.evaluation import run_episode
from activeslam_gym.slam.detection import REJECTED
from activeslam_gym.slam.filter import Filter, detections_of
from baselines import Stay

FIDUCIALS = np.array([[x, y, 1.5] for x in (-0.4, 0.0, 0.4) for y in (-0.3, 0.3)])


def played(seed: int, restarts: bool, association: str) -> dict[str, float]:
    """Ten seconds of `stay`: the log score [bit], and how often the belief was reset."""
    scenario = {"association": association, "restarts": restarts}
    env: Any = gymnasium.make("ActiveSLAM-v0", scenario=scenario, gaze_period=0.25, duration=10.0, end_when_lost=False)
    run = run_episode(env, Stay(env), seed)
    return {"restarts": run.events["restarts"].sum(), "score": run.log_score[-1]}


@pytest.mark.parametrize("association", ["known", "unknown"])
def test_depths_turned_inside_out_are_given_up(association: str) -> None:
    """Room 6 000 243, with labels or without: see docs/consistency.md."""
    wrong, mended = (played(6_000_243, restarts, association) for restarts in (False, True))
    assert wrong["restarts"] == 0 and wrong["score"] < -1000.0
    assert mended["restarts"] >= 1 and mended["score"] > -100.0


def test_an_honest_belief_is_kept() -> None:
    off, on = (played(5, restarts, "unknown") for restarts in (False, True))
    assert on == off and on["restarts"] == 0


def held(scenario: Scenario, away: float, frames: int) -> tuple[Filter, np.ndarray]:
    """A filter that is sure to stand ``away`` [m] aside of where it stands, with labels; and its last answer."""
    rng = np.random.default_rng(0)
    camera = np.r_[away, 0.0, 0.0, 1.0, np.zeros(9)]
    truth = Filter(scenario, fiducials=FIDUCIALS)
    pixels = truth.sight().point["z_hat"]
    filter = Filter(scenario, fiducials=FIDUCIALS, camera=camera, covariance=1e-8 * np.eye(12))
    for _ in range(frames):
        filter.predict(dt=1e-3)
        seen = detections_of(pixels + 2.0 * rng.standard_normal(pixels.shape), ids=truth.sight().point["id"])
        answer = filter.update(seen, labelled=True)
        if filter.counts.restarts:
            break
    return filter, answer


def test_it_is_begun_anew_about_where_it_was_thought() -> None:
    scenario = Scenario()
    filter, answer = held(scenario, 0.2, 20)
    assert filter.counts.restarts == 1 and (answer == REJECTED).all() and len(filter.ids) == 0
    P = filter.points()[1]
    np.testing.assert_allclose(np.sqrt(np.diag(P)), np.repeat([0.3, 0.1, 0.3, 0.2], 3))
    assert abs(filter.belief.state.camera[0] - 0.2) < 0.05
    truth = Filter(scenario, fiducials=FIDUCIALS).sight().point
    for _ in range(5):
        filter.predict(dt=1e-3)
        filter.update(detections_of(truth["z_hat"], ids=truth["id"]), labelled=True)
    assert abs(filter.belief.state.camera[0]) < 0.03 and filter.counts.restarts == 1


def test_it_is_not_where_it_is_switched_off_or_nothing_is_wrong() -> None:
    assert held(Scenario(restarts=False), 0.2, 20)[0].counts.restarts == 0
    assert held(Scenario(), 0.0, 60)[0].counts.restarts == 0


@pytest.mark.parametrize(("maximum_distance", "restarts"), [(None, 1), (1.7, 0)])
def test_a_fiducial_that_is_not_seen_contradicts_unless_it_may_be_too_far(
    maximum_distance: float | None, restarts: int
) -> None:
    """The fiducials are 1.5 m away or more: what stands beyond 0.85 of the greatest distance may be too far."""
    filter = Filter(Scenario(maximum_distance=maximum_distance), fiducials=FIDUCIALS)
    for _ in range(30):
        filter.predict(dt=1e-3)
        filter.update(detections_of(np.empty((0, 2))))
        if filter.counts.restarts:
            break
    assert filter.counts.restarts == restarts


def test_detections_that_are_missed_by_chance_do_not_contradict() -> None:
    """Seven in a hundred of three fiducials, for nearly two minutes, where the filter reckons with it."""
    rng = np.random.default_rng(0)
    filter = Filter(Scenario(detection_probability=0.93), fiducials=FIDUCIALS[:3])
    truth = filter.sight().point.copy()
    for _ in range(3000):
        seen = rng.random(len(truth)) < 0.93
        pixels = truth["z_hat"][seen] + 2.0 * rng.standard_normal((seen.sum(), 2))
        filter.predict(dt=1e-3)
        filter.update(detections_of(pixels, ids=truth["id"][seen]), labelled=True)
    assert filter.counts.restarts == 0
