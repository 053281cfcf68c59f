"""Identified candidates: those that agree are matched, looks decide where places cannot, too few are not believed."""

from dataclasses import replace

import numpy as np
import pytest

from activeslam_gym.config import DEPTH_PARTICLES, Scenario
from activeslam_gym.slam.appearance import appearance_of, associate_identified
from activeslam_gym.slam.detection import DETECTION, REJECTED, UNASSOCIATED
from activeslam_gym.slam.filter import Filter, detections_of
from activeslam_gym.slam.sight import INSIDE, PREDICTED, Sight

MODEL = appearance_of(Scenario())
PAPER = Scenario()
GRID = 40.0 * np.arange(6)[:, None] + np.zeros(2)
SHIFT = np.array((12.0, -9.0))
WRONG = np.array([(3, 4), (-5, 2), (9, 9), (-9, -1), (0, -7), (2, 8)])
"""Beside each predicted pixel."""
PIXELS = np.array([[80.0, 80.0], [240.0, 80.0], [160.0, 200.0], [100.0, 180.0]])


def sight_of_a_turn(z_hat: np.ndarray) -> Sight:
    """Predictions 1, 2, … at ``z_hat`` (n, 2) that all move with the camera: 10 px together, 1 px each."""
    points = np.zeros(len(z_hat), PREDICTED)
    points["id"], points["z_hat"], points["visibility"] = 1 + np.arange(len(z_hat)), z_hat, INSIDE
    points["R"] = np.eye(2)
    S = np.kron(np.ones((len(z_hat), len(z_hat))), 100.0 * np.eye(2)) + np.eye(2 * len(z_hat))
    return Sight(points, np.zeros((2 * len(z_hat), 12)), S)


def chosen(sight: Sight, candidates: np.ndarray, least: int = 1) -> list[bool]:
    associate_identified(MODEL, sight, candidates, least)
    assert set(candidates["match"][candidates["match"] != candidates["id"]]) <= {REJECTED}
    return (candidates["match"] == candidates["id"]).tolist()


def test_candidates_that_agree_are_matched_in_any_order_and_others_not() -> None:
    """Two detections of each of six predictions: a wrong one, nearer and more alike; the right one, moved by SHIFT."""
    pixels = np.repeat(GRID, 2, axis=0) + SHIFT
    pixels[::2] = GRID + WRONG
    shifted = detections_of(pixels, ids=np.repeat(np.arange(1, 7), 2), log_ratios=np.tile((2.0, 1.0), 6))
    order, wanted = np.random.default_rng(0).permutation(12), np.array([False, True] * 6)
    assert chosen(sight_of_a_turn(GRID), shifted.copy()) == wanted.tolist()
    assert chosen(sight_of_a_turn(GRID), shifted[order]) == wanted[order].tolist()


@pytest.mark.parametrize(("ratios", "wanted"), [((2.0, 0.0, 2.0), 0), ((0.0, 2.0, 2.0), 1)])
def test_looks_decide_where_places_cannot(ratios, wanted: int) -> None:
    sight = sight_of_a_turn(np.array(((50.0, 50.0), (90.0, 90.0))))
    candidates = detections_of([(50.5, 50.0), (49.5, 50.0), (90.0, 90.0)], ids=[1, 1, 2], log_ratios=ratios)
    found = chosen(sight, candidates)
    assert found[wanted] and found[2] and sum(found) == 2


def test_if_too_few_agree_or_nothing_is_in_sight_none_is_believed() -> None:
    sight, wrong = sight_of_a_turn(GRID), detections_of(GRID + WRONG, ids=np.arange(1, 7), log_ratios=3.0)
    agree = sum(chosen(sight, wrong.copy()))
    assert 0 < agree < 6
    assert sum(chosen(sight, wrong.copy(), agree)) == agree
    assert not any(chosen(sight, wrong.copy(), agree + 1))
    sight = sight_of_a_turn(GRID)
    assert chosen(sight, detections_of(GRID[:1], ids=[99], log_ratios=5.0)) == [False]
    assert chosen(sight, detections_of(GRID[:1], ids=[1], log_ratios=-20.0)) == [False]
    assert chosen(sight, np.zeros(0, DETECTION)) == []


def filter_with_a_map() -> Filter:
    filter = Filter(PAPER, covariance=1e-4 * np.eye(12))
    for pixel in PIXELS:
        filter.add_landmark(pixel)
    return filter


def test_a_frame_may_be_searched_twice() -> None:
    """Scouts first: what they tell sharpens the others' ellipses, and both updates are of one frame."""
    filter = filter_with_a_map()
    filter.predict()
    before = np.trace(filter.sight().S[4:, 4:])
    scouts = detections_of(PIXELS[:2] + SHIFT / 8, ids=[1, 2], log_ratios=3.0)
    assert filter.update(scouts, jointly=True).tolist() == [1, 2]
    assert np.trace(filter.sight().S[4:, 4:]) < before and filter.belief.state.frame == 1
    others = detections_of(PIXELS[2:] + SHIFT / 8, ids=[3, 4], log_ratios=3.0)
    assert filter.update(others, jointly=True).tolist() == [3, 4]
    np.linalg.cholesky(filter.points()[1])


def test_disbelieved_candidates_change_nothing_and_missing_is_the_searchers_business() -> None:
    filter = filter_with_a_map()
    filter.predict()
    P, candidates = filter.points()[1], detections_of(PIXELS[:2], ids=[1, 2], log_ratios=3.0)
    assert filter.update(candidates, jointly=True, least=3).tolist() == [REJECTED, REJECTED]
    np.testing.assert_array_equal(filter.points()[1], P)
    assert filter.counts.rejected_matches == 2
    for _ in range(PAPER.maximum_misses + 30):
        filter.predict()
        filter.update([], jointly=True)
    assert len(filter.ids) == len(PIXELS)
    np.testing.assert_array_equal(filter.positions, filter.points()[0])
    assert filter.capacity == PAPER.landmark_count + 13 and Filter().positions.shape == (0, 3)


def test_what_cannot_be_chosen_jointly_is_said() -> None:
    for given, options, message in (
        ({"ids": UNASSOCIATED}, {}, "must all bear ids"),
        ({"ids": 1}, {"labelled": True}, "which are not certain"),
        ({"ids": 1, "log_ratios": np.nan}, {}, "finite log_ratio"),
        ({"ids": 1}, {"scenario": replace(PAPER, initialisation=DEPTH_PARTICLES)}, "inverse_depth"),
    ):
        with pytest.raises(ValueError, match=message):
            filter = Filter(options.pop("scenario", PAPER))
            filter.update(detections_of([[160.0, 120.0]], **given), jointly=True, **options)
