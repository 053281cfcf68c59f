"""Joint matching, the way back out of starvation, and identified candidates: by what they must obey."""

import itertools

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from activeslam_gym.metrics import camera_error
from activeslam_gym.slam.appearance import appearance_of, associate_identified
from activeslam_gym.slam.association import Hypotheses, association_of, hypotheses, match_jointly
from activeslam_gym.slam.detection import DETECTION, NEW, REJECTED
from activeslam_gym.slam.filter import Filter, detections_of
from activeslam_gym.slam.sight import INSIDE, PREDICTED, Sight
from tests.support import CAMERA, PAPER, moved, pixel_of, random_spd, replaced, world_points

VAR = float(CAMERA.pixel_std**2)
MODEL = replaced(association_of(PAPER), new_feature_gate=1e9, nodes=1000)
"""Without a gate, so that every assignment is one, and with room for them."""
UNMAPPED = 1.5


def open_hypotheses(z: np.ndarray, S: np.ndarray, detections: np.ndarray) -> Hypotheses:
    """All are allowed; the camera's R is in ``S``."""
    points = np.zeros(len(z) // 2, PREDICTED)
    return hypotheses(points, detections, z.copy(), S - VAR * np.eye(len(z)))


def scores_of_all(z: np.ndarray, S: np.ndarray, pixels: np.ndarray, unmapped: float) -> dict[tuple[int, ...], float]:
    """The log likelihood of every assignment (detections or -1), of predictions in the middle of the image."""
    n, M = len(z) // 2, len(pixels)
    density, miss = unmapped / (PAPER.image_width * PAPER.image_height), np.log(1.0 - PAPER.detection_probability)
    scores = {}
    for answer in itertools.product(range(-1, M), repeat=n):
        paired = [a for a in range(n) if answer[a] >= 0]
        if len({answer[a] for a in paired}) == len(paired):
            rows = [2 * a + axis for a in paired for axis in range(2)]
            seen = np.array([pixels[answer[a]] for a in paired]).ravel()
            joint = multivariate_normal.logpdf(seen, z[rows], S[np.ix_(rows, rows)]) if rows else 0.0
            scores[answer] = joint - len(paired) * np.log(density) + (n - len(paired)) * miss
    return scores


def scene(seed: int, points: int, extra: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Predicted pixels in the middle with a common error, and detections: of most of them, and unmapped detections."""
    rng = np.random.default_rng(seed)
    z = np.array([160.0, 120.0] * points) + rng.uniform(-30, 30, 2 * points)
    common = np.tile(np.eye(2), (points, 1)) * rng.uniform(5.0, 15.0)
    S = common @ common.T + random_spd(rng, np.full(2 * points, 4.0)) + VAR * np.eye(2 * points)
    seen = rng.multivariate_normal(z, S).reshape(-1, 2)[: max(1, points - seed % 2)]
    return z, S, rng.permutation(np.concatenate((seen, rng.uniform((110, 70), (210, 170), (extra, 2)))))


def matched_jointly(z: np.ndarray, S: np.ndarray, pixels: np.ndarray, **model: float) -> np.ndarray:
    """(3,) the detection of each prediction or -1."""
    detections, of_point = detections_of(pixels), np.full(3, -1)
    h = open_hypotheses(z, S, detections)  # of fiducials, which have no id that is positive
    constants, worth = replaced(MODEL, **model), 0.5 * MODEL.clutter_cost - np.log(UNMAPPED)
    assert match_jointly(constants, h, worth, of_point)
    return of_point


@pytest.mark.parametrize("seed", range(40))
def test_the_search_is_that_of_all_assignments(seed: int) -> None:
    z, S, pixels = scene(seed, 3, seed % 3)
    scores = scores_of_all(z, S, pixels, UNMAPPED)
    best, of_point = max(scores, key=scores.__getitem__), matched_jointly(z, S, pixels)
    for a in range(3):
        rival = max(score for answer, score in scores.items() if answer[a] != best[a])
        assert of_point[a] == (best[a] if scores[best] - rival >= MODEL.margin else -1)


@pytest.mark.parametrize(("nodes", "found"), [(400, True), (2, False)])
def test_where_the_nodes_run_out_nothing_is_accepted(nodes: int, found: bool) -> None:
    assert (matched_jointly(*scene(1, 3, 0), nodes=nodes) >= 0).any() == found


def test_a_filter_whose_ellipses_are_all_ambiguous_finds_its_way_back() -> None:
    """Seven known points under ellipses so wide that each holds several detections, and the estimate far from true."""
    count = 0
    for seed in range(12):
        rng = np.random.default_rng(seed)
        fiducials = world_points(rng, np.array([0.0, 0, 0, 1, 0, 0, 0]), 7, (1.5, 3.0))
        filter = Filter(fiducials=fiducials, covariance=np.diag([0.2**2] * 3 + [0.08**2] * 3 + [1e-4] * 6))
        error = np.array([0.25] * 3 + [0.1] * 3 + [0.0] * 6) * rng.choice([-1, 1], 12)
        true = moved(filter.belief.state.camera, error)
        pixels = np.array([pixel_of(CAMERA, true, y) for y in fiducials]) + 2.0 * rng.standard_normal((7, 2))
        sight, detections = filter.sight(), detections_of(pixels)
        several = open_hypotheses(sight.point["z_hat"].ravel(), sight.S, detections).d2 < 9.21
        assert np.sum(several, axis=1).mean() > 2  # by its own ellipse, a prediction may be several
        found = filter.update(detections)
        used = (found != NEW) & (found != REJECTED)
        assert (found[used] == -np.arange(1, 8)[used]).all()
        left = camera_error(true, filter.belief.state.camera)[:6]
        assert left @ np.linalg.solve(filter.belief.covariance[:6, :6], left) < 22.5  # 99.9 % of 6 dimensions
        count += sum(used)
    assert count > 0.75 * 12 * 7


APPEARANCE = appearance_of(PAPER)
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
    associate_identified(APPEARANCE, sight, candidates, least)
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


def test_a_frame_may_be_searched_twice() -> None:
    """Scouts first: what they tell sharpens the others' ellipses, and both updates are of one frame."""
    filter = Filter(PAPER, covariance=1e-4 * np.eye(12))
    for pixel in PIXELS:
        filter.add_landmark(pixel)
    filter.predict()
    before = np.trace(filter.sight().S[4:, 4:])
    scouts = detections_of(PIXELS[:2] + SHIFT / 8, ids=[1, 2], log_ratios=3.0)
    assert filter.update(scouts, jointly=True).tolist() == [1, 2]
    assert np.trace(filter.sight().S[4:, 4:]) < before and filter.belief.state.frame == 1
    others = detections_of(PIXELS[2:] + SHIFT / 8, ids=[3, 4], log_ratios=3.0)
    assert filter.update(others, jointly=True).tolist() == [3, 4]
    np.linalg.cholesky(filter.points()[1])
