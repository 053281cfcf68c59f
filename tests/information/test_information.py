"""Entropy, mutual information and the other criteria, against brute force and against the updates that they predict."""

from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from scipy.linalg import block_diag

import activeslam_gym  # noqa: F401  (registers the environment)
from activeslam_gym.information import CRITERIA
from activeslam_gym.information import candidates as c
from activeslam_gym.information.candidates import UNLIMITED, SensorLimits
from activeslam_gym.information.entropy import EXPECTED, find_counting, update_expectation, waiting_count
from activeslam_gym.information.foreign import score_plans_with, sight_by
from activeslam_gym.information.net import net_of_plans
from activeslam_gym.motion import Gaze, Motion, motion_of, open_loop, turn_of
from activeslam_gym.slam.belief import INVERSE_DEPTH, POINT, Belief
from activeslam_gym.slam.map import remove_feature
from examples.extend_range_sensor import RangeSensor
from tests import support
from tests.support import CAMERA, PAPER, log2_det, numerical_sight, predicted_belief_with, random_belief, world_points

R = CAMERA.pixel_std**2
MOTION = motion_of(PAPER, 1.0)
VARIANCE = np.array(PAPER.landmark_prior_variance)
SEEDS = pytest.mark.parametrize("seed", range(4))


def case(seed: int, count: int = 5) -> tuple[c.PredictedBelief, np.ndarray]:
    """A predicted belief of points and fiducials in view, and its H by numerical differentiation."""
    rng = np.random.default_rng(seed)
    camera = support.random_camera(rng)
    points, fiducials = world_points(rng, camera, count), world_points(rng, camera, 2)
    P = support.random_spd(rng, [0.05] * 3 + [0.02] * 3 + [0.1] * 6 + [0.2] * (3 * count))
    belief = predicted_belief_with(points, P, camera, fiducials)
    return belief, numerical_sight(CAMERA, belief, camera)


def innovation_covariance(P: np.ndarray, H: np.ndarray) -> np.ndarray:
    return H @ P @ H.T + R * np.eye(len(H))


def posterior(P: np.ndarray, H: np.ndarray) -> np.ndarray:
    return P - P @ H.T @ np.linalg.solve(innovation_covariance(P, H), H @ P)


def scored(belief: c.PredictedBelief, criterion: str, pose: np.ndarray | None = None) -> float:
    P = belief.covariance
    return CRITERIA[criterion](P, c.sight_after(CAMERA, belief, P, belief.camera if pose is None else pose), R)


def drop(P: np.ndarray, after: np.ndarray, *parts: int | slice) -> float:
    """By how much the logarithm of the determinant falls, of these parts of the state [bit]."""
    at = np.ix_(*[np.r_[parts or slice(0, len(P))]] * 2)
    return 0.5 * (log2_det(P[at]) - log2_det(after[at]))


def papers_sum(P: np.ndarray, H: np.ndarray) -> np.ndarray:
    """The Fisher information of the paper, a sum over predictions."""
    S = innovation_covariance(P, H)
    pairs = [slice(2 * i, 2 * i + 2) for i in range(len(H) // 2)]
    return sum(H[two].T @ np.linalg.solve(S[two, two], H[two]) for two in pairs)


FORMULAS = {
    "mutual_information": lambda P, H, after: drop(P, after),
    "net_information": lambda P, H, after: drop(P, after),
    "mutual_information_camera": lambda P, H, after: drop(P, after, slice(0, 12)),
    "mutual_information_position_map": lambda P, H, after: drop(P, after, slice(0, 3), slice(12, len(P))),
    "fisher_trace": lambda P, H, after: np.trace(papers_sum(P, H)),
    "fisher_max_eigenvalue": lambda P, H, after: np.linalg.eigvalsh(papers_sum(P, H))[-1],
    "variance_reduction": lambda P, H, after: np.trace(P) - np.trace(after),
}


@SEEDS
def test_a_criterion_is_its_formula_and_zero_where_nothing_is_in_view(seed: int) -> None:
    assert set(FORMULAS) == set(CRITERIA)
    belief, H = case(seed)
    P, away = belief.covariance, np.array([0.0, 0, 100, 1, 0, 0, 0, *belief.camera[7:]])
    for criterion, formula in FORMULAS.items():
        rel = 1e-8 if criterion == "mutual_information" else 1e-7
        assert scored(belief, criterion) == pytest.approx(formula(P, H, posterior(P, H)), rel=rel), criterion
        assert scored(belief, criterion, away) == 0.0


@SEEDS
def test_mutual_information_is_that_of_the_update_which_it_predicts(seed: int) -> None:
    """The filter's own batch update of points and inverse-depth features, of which it promises what the line tells."""
    rng = np.random.default_rng(seed)
    belief = random_belief(PAPER, [POINT, INVERSE_DEPTH, POINT, INVERSE_DEPTH], rng)
    fiducials, n = world_points(rng, belief.state.camera, 2), int(belief.state.count)
    points, P = support.public(belief)
    promised = scored(predicted_belief_with(points, P, belief.state.camera.copy(), fiducials), "mutual_information")
    sight, before = support.sight_of(belief, fiducials), support.joint_covariance(belief)
    assert len(sight.point) == 2 + n
    S = sight.S - block_diag(*sight.point["curvature"])
    found = drop(before, before - sight.HP.T @ np.linalg.solve(S, sight.HP))
    assert promised == pytest.approx(found, abs=1e-9 * max(1.0, found))


def test_the_trace_counts_what_is_known_and_information_what_is_not() -> None:
    """PAPER's finding: the Fisher trace prefers a known landmark to an unknown one by far, mutual information not."""
    camera, point = np.eye(13)[3], np.array([[0.1, 0.0, 2.0]])
    known, unknown = (
        predicted_belief_with(point, np.diag([0.02**2] * 3 + [0.005**2] * 3 + [0.01**2] * 6 + [std**2] * 3), camera)
        for std in (0.02, 1.0)
    )
    assert scored(known, "fisher_trace") > 100 * scored(unknown, "fisher_trace")
    assert scored(unknown, "mutual_information") > 4 * scored(known, "mutual_information")


def scores_of(belief: c.PredictedBelief, plans: np.ndarray, criterion: str = "mutual_information") -> np.ndarray:
    out = np.full(len(plans), np.nan)
    if criterion == "net_information":
        net_of_plans(CAMERA, MOTION, belief, 0.0, 10**6, plans, out, np.empty(len(plans)))
        return out
    c.score_plans(CAMERA, MOTION, belief, 0.0, plans, list(CRITERIA).index(criterion), np.zeros(1, c.OPEN_LOOP), out)
    return out


def plans_of(*plans: list[tuple[int, int, int]]) -> np.ndarray:
    return np.array([[*plan] for plan in plans], c.ACTION)


@SEEDS
def test_a_plan_is_worth_the_information_of_its_measurements_and_net_information_less_the_process_noise(
    seed: int,
) -> None:
    """I(x; z1) + I(x; z2 | z1), each the drop of the log-determinant of the joint covariance by a matrix update."""
    belief, _ = case(seed)
    both = (int(Motion.LEFT), int(Gaze.LEFT), 10), (int(Motion.UP), int(Gaze.RIGHT), 4)
    P, pose, expected = belief.covariance, belief.camera, []
    for motion, gaze, frames in both:
        turn = turn_of(MOTION, gaze, 0.0)
        F, Q = np.eye(len(P)), np.zeros_like(P)
        F[:12, :12], Q[:12, :12] = open_loop(MOTION, turn, frames)
        P, pose = F @ P @ F.T + Q, c.goal_pose(MOTION, belief, pose, motion, turn, frames)
        H, before = numerical_sight(CAMERA, belief, pose), P
        if not expected:  # net information is of one measurement a frame
            net, after = scores_of(belief, plans_of(both[:1]), "net_information")[0], P
            for _ in range(frames):
                after = posterior(after, H)
            assert net == pytest.approx(drop(belief.covariance, after), rel=1e-7) and net < drop(P, after) - 1.0
        P = posterior(P, H)
        expected.append(drop(before, P))
    assert min(expected) > 0.0
    for count in (1, 2):
        np.testing.assert_allclose(scores_of(belief, plans_of(both[:count])), sum(expected[:count]), rtol=1e-7)


@pytest.mark.parametrize("limits", [UNLIMITED, SensorLimits(1.0, 8)])
@pytest.mark.parametrize("frames", [10**6, 50, 7])
def test_net_information_of_a_plan_is_the_fall_of_entropy_of_its_simulated_updates(
    frames: int, limits: SensorLimits
) -> None:
    """In information form, with expected landmarks that enter when seen, as by predictions and updates of P."""
    belief, waiting = case(3, 4)[0], 30
    expected = np.random.default_rng(3).uniform(-1.0, 1.0, (waiting, 3)) * (3.0, 1.0, 3.0)
    points = np.concatenate((belief.points, expected))
    P = block_diag(belief.covariance, *[np.diag(VARIANCE)] * waiting)
    belief = belief._replace(points=points, covariance=P, waiting=waiting, limits=limits)
    rest, plans = c.without_present(CAMERA, belief), c.held_plans(20, 5)
    assert 0 < rest.waiting < waiting == c.without_present(CAMERA, belief, np.zeros(len(points), bool)).waiting
    look = partial(c.sight_after, CAMERA, rest)
    by_updates, std = score_plans_with(look, MOTION, rest, 0.0, plans, "net_information", R, frames)
    out, position_std = np.empty((2, len(plans)))
    net_of_plans(CAMERA, MOTION, belief, 0.0, frames, plans, out, position_std)
    np.testing.assert_allclose(out, by_updates, rtol=1e-7, atol=1e-6)
    assert np.ptp(out) > 10.0 or frames == 7
    assert (position_std >= (1.0 - 1e-9) * std).all() and (position_std <= 2.6 * std).all()


def test_no_criterion_depends_on_how_a_sensor_mixes_its_numbers() -> None:
    """Three correlated numbers are one measurement; and where there is no factor, the score is NaN."""
    belief, T = case(0)[0], np.random.default_rng(0).normal(size=(3, 3))
    plain, mixed = (RangeSensor(PAPER, np.random.SeedSequence(0)) for _ in range(2))
    mixed.noise, mixed.predict = T @ plain.noise @ T.T, lambda *at: [T @ one for one in plain.predict(*at)]  # type: ignore
    P = belief.covariance
    own, other = (sight_by(sensor, belief, R, P, belief.camera) for sensor in (plain, mixed))
    for name, criterion in CRITERIA.items():
        assert criterion(P, own, R) == pytest.approx(criterion(P, other, R)), name
        assert np.isnan(criterion(np.nan * P, own._replace(S=np.nan * own.S), R)), name


@pytest.mark.parametrize("criterion", ["mutual_information", "net_information", "fisher_trace"])
def test_what_plans_share_changes_no_score(criterion: str) -> None:
    """Common beginnings, and ends with the same gaze and frames, are worked out once."""
    belief, actions = case(1)[0], {"a": (0, 1, 4), "b": (0, 1, 2), "c": (3, 1, 4), "d": (c.REMAIN, 2, 4)}
    mixed = plans_of(*([actions[one] for one in pair] for pair in "aa ac ab bb cc ac ac da dd cd".split()))
    assert len(set(scores_of(belief, mixed, criterion).tolist())) == 8
    for plans in (mixed, c.motion_plans(5), c.gaze_plans(1), c.joint_plans(5), c.sequence_plans(5, 2)[:12]):
        together = scores_of(belief, plans, criterion)
        np.testing.assert_array_equal(together, [scores_of(belief, plan[None], criterion)[0] for plan in plans])


def test_plans_are_all_actions_in_order_and_what_is_none_is_named() -> None:
    assert c.motion_plans(5)[:, 0].tolist() == [(motion, Gaze.STAY, 5) for motion in range(7)]
    assert c.gaze_plans(5)[:, 0].tolist() == [(c.REMAIN, gaze, 5) for gaze in range(3)]
    assert c.joint_plans(5)[:, 0].tolist() == [(motion, gaze, 5) for gaze in range(3) for motion in range(7)]
    assert c.sequence_plans(5, 2)["motion"].tolist() == [[i, j] for i in range(7) for j in range(7)]
    for named, wrong in (("motion", (7, 0, 1)), ("gaze", (0, 3, 1)), ("frames", (0, 0, -1))):
        with pytest.raises(ValueError, match=f"{named} of plans must be in"):
            c.checked_plans(plans_of([wrong]))


def test_remembered_motions_are_of_the_scenario_as_it_varies() -> None:
    fields = {"scenario": {"varied": (("acceleration_std", 0.05, 3.0), ("angular_acceleration_std", 0.1, 9.0))}}
    env, seen = gym.make("ActiveSLAM-v0", **fields).unwrapped, list[np.ndarray]()
    for seed in (1, 2):
        fresh = gym.make("ActiveSLAM-v0", **fields).unwrapped
        for one in (env, fresh):
            one.reset(seed=seed)
        seen.append(env.motion_scores())
        np.testing.assert_array_equal(seen[-1], fresh.motion_scores())
    assert (seen[0] != seen[1]).all()


def test_an_environments_scores_are_scores_of_plans() -> None:
    env = gym.make("ActiveSLAM-v0").unwrapped
    env.reset(seed=4)
    for _ in range(8):
        env.step((Motion.LEFT, 1))
    motion, frames, out = motion_of(env.scenario, env.motion_period), 20, np.empty(21)
    c.score_plans(
        CAMERA, motion, env.predicted_belief, env.time, c.joint_plans(frames), 0, np.zeros(1, c.OPEN_LOOP), out
    )
    np.testing.assert_array_equal(env.scores(c.joint_plans(frames), [*CRITERIA][0]), out)
    for name in CRITERIA:
        joint = env.scores(c.joint_plans(frames), name).reshape(3, 7).T
        np.testing.assert_allclose(env.joint_scores(name), joint, rtol=1e-12)
        np.testing.assert_allclose(env.motion_scores(name), env.scores(c.motion_plans(frames), name), rtol=1e-12)
        turning = max(5, round((env.scenario.gaze_horizon or 0.0) / env.scenario.frame_time))
        np.testing.assert_allclose(env.gaze_scores(name), env.scores(c.gaze_plans(turning), name), rtol=1e-12)
    one, two = env.motion_scores(), env.scores(c.sequence_plans(frames, 2), "mutual_information").reshape(7, 7)
    np.testing.assert_allclose(env.joint_scores()[:, Gaze.STAY], one)
    np.testing.assert_allclose(env.lookahead_scores(1), one, rtol=1e-10)
    np.testing.assert_allclose(env.lookahead_scores(2), two.max(axis=1), rtol=1e-12)
    assert (two.max(axis=1) >= one - 1e-9).all()
    for horizon, held in ((None, 5), (0.1, 5), (3.0, 60)):  # a candidate turn is held for the gaze horizon
        other = gym.make("ActiveSLAM-v0", scenario={"gaze_horizon": horizon}, gaze_period=0.25).unwrapped
        other.reset(seed=4)
        expected = other.scores(c.gaze_plans(held), "mutual_information")
        np.testing.assert_array_equal(other.gaze_scores("mutual_information"), expected)


def expectation(count: int, seed: int = 0) -> Any:
    """Expected landmarks (count,), all waiting."""
    expected = np.zeros(count, EXPECTED)
    expected["point"] = (np.random.default_rng(seed).random((count, 3)) - 0.5) * np.array(PAPER.room_size)
    return expected


def retired(expected: np.ndarray, belief: Belief) -> list[int]:
    """Ids of the features that have retired one, after an update."""
    estimate = support.estimate_of(belief)
    update_expectation(expected, VARIANCE, estimate)
    ids = sorted(expected["feature"][expected["feature"] > 0].tolist())
    assert support.features_of(belief)["id"][find_counting(expected, estimate)].tolist() == ids
    assert waiting_count(expected) == len(expected) - len(ids)
    return ids


def test_a_feature_that_counts_retires_the_nearest_and_brings_it_back() -> None:
    belief = random_belief(PAPER, [POINT] * 3, np.random.default_rng(6))
    expected = expectation(5)
    assert retired(expected, belief) == [1, 2, 3]
    scaled = np.sum((expected["point"] - belief.feature["mean"][0, :3]) ** 2 / VARIANCE, axis=1)
    assert expected["feature"][np.argmin(scaled)] == 1  # the marginal is small beside the prior
    remove_feature(belief, 1)
    assert retired(expected, belief) == [1, 3]
    belief = random_belief(PAPER, [POINT] * 4, np.random.default_rng(7))
    assert retired(expectation(2), belief) == [1, 2]  # the oldest
    at = int(belief.feature[1].start)
    belief.covariance[at : at + 3, at : at + 3] += 9.0 * np.eye(3)
    assert retired(expectation(5), belief) == [1, 3, 4]


def test_entropy_is_the_formula_at_constant_dimension() -> None:
    env = gym.make("ActiveSLAM-v0")
    env.reset(seed=1)
    for _ in range(20):
        _, _, _, _, info = env.step((2, 1))
    belief, P = env.unwrapped.belief, env.unwrapped.belief.covariance
    assert P.shape[0] == 12 + 3 * len(belief.landmarks)
    counting = np.flatnonzero(np.isin(belief.ids, support.simulation_of(env).expected["feature"]))
    assert len(counting) > 0
    places = (12 + 3 * counting[:, None] + np.arange(3)).ravel()
    rest = (27 - len(counting)) * np.log2(np.prod(PAPER.landmark_prior_variance))
    for part, rows, prior in (
        ("total", np.r_[0:12, places], rest),
        ("camera", np.r_[0:12], 0.0),
        ("map", places, rest),
    ):
        found = log2_det(P[np.ix_(rows, rows)]) + prior
        assert belief.log2_det(part) == pytest.approx(found, abs=1e-8)
    total = belief.log2_det("total")
    assert info["entropy"] == pytest.approx(0.5 * ((12 + 3 * 27) * np.log2(2 * np.pi * np.e) + total), abs=1e-8)
    assert total == info["log2_det"]["total"]
