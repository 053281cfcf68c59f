"""Layout of the belief: appending, removing and converting leave the rest alone; the public belief is T P T^T."""

import numpy as np
import pytest

from activeslam_gym.linalg import add_symmetric_product
from activeslam_gym.motion import CAMERA_DIM
from activeslam_gym.slam import belief as layout
from activeslam_gym.slam.belief import INVARIANT, INVERSE_DEPTH, KIND_DIM, PLAIN, POINT, RAY, Belief
from activeslam_gym.slam.kalman import MINIMUM_INVERSE_DEPTH, propagate, shift_mean, update_covariance
from activeslam_gym.slam.map import append_feature, convert_to_point, remove_feature, room_for
from tests import support
from tests.support import copied, dense_H, features_of, joint_covariance, rows_of, sight_of, turn_of_everything

MIXES = [
    [],
    [POINT],
    [INVERSE_DEPTH],
    [POINT, INVERSE_DEPTH, POINT, INVERSE_DEPTH, INVERSE_DEPTH, POINT],
    [RAY, POINT, RAY, POINT],
]
every_mix = pytest.mark.parametrize("kinds", MIXES, ids=str)


def belief_of(kinds: list[int], seed: int = 0) -> Belief:
    return support.random_belief(support.scenario_for(kinds), kinds, np.random.default_rng(seed))


def as_point(belief: Belief, k: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Feature ``k`` as a point (3,), its Jacobian (3, width), and what a ray's particles add along it (3, 3)."""
    feature, T = belief.feature[k], np.empty((3, 6))
    y = layout.point_of(belief, k, T)
    m = layout.bearing(*feature.mean[3:5])[0]
    along = feature.depth_var * np.outer(m, m) if feature.kind == RAY else np.zeros((3, 3))
    return y, T[:, : KIND_DIM[feature.kind]], along


def assert_well_laid(belief: Belief) -> None:
    """Blocks follow each other by age, without gaps, and the covariance in use is symmetric to the bit."""
    features = features_of(belief)
    widths = [KIND_DIM[kind] for kind in features["kind"]]
    assert features["start"].tolist() == [CAMERA_DIM + sum(widths[:k]) for k in range(len(widths))]
    assert belief.state.dim == CAMERA_DIM + sum(widths)
    assert (np.diff(features["id"]) > 0).all() and (features["id"] <= belief.state.initialised).all()
    assert len(set(features["slot"]) & set(range(len(belief.feature)))) == len(features)
    P = joint_covariance(belief)
    np.testing.assert_array_equal(P, P.T)


@pytest.mark.parametrize("gone", range(6))
def test_removing_a_feature_marginalises_it_out(gone: int) -> None:
    belief = belief_of(MIXES[3])
    before, rest = joint_covariance(belief), np.delete(features_of(belief), gone)
    kept = np.setdiff1d(np.arange(len(before)), rows_of(belief, gone))
    remove_feature(belief, gone)
    np.testing.assert_array_equal(joint_covariance(belief), before[np.ix_(kept, kept)])
    assert_well_laid(belief)
    rest["start"] = features_of(belief)["start"]
    np.testing.assert_array_equal(features_of(belief), rest)


@pytest.mark.parametrize(
    ("kinds", "which"), [(MIXES[3], 1), (MIXES[3], 4), (MIXES[4], 0), (MIXES[4], 2), ([INVERSE_DEPTH], 0)]
)
def test_converting_a_feature_is_its_jacobian_on_the_joint_covariance(kinds: list[int], which: int) -> None:
    belief = belief_of(kinds)
    rows, before, means = rows_of(belief, which), joint_covariance(belief), features_of(belief)["mean"].copy()
    y, block, along = as_point(belief, which)
    T = np.delete(np.eye(len(before)), rows[3:], axis=0)
    T[np.ix_(rows[:3], rows)] = block
    expected = T @ before @ T.T
    expected[np.ix_(rows[:3], rows[:3])] += along
    convert_to_point(belief, which)
    np.testing.assert_allclose(joint_covariance(belief), expected, rtol=1e-11, atol=1e-14)
    means[which] = [*y, 0, 0, 0]
    np.testing.assert_allclose(features_of(belief)["mean"], means, rtol=1e-15)
    assert belief.feature[which].kind == POINT
    assert_well_laid(belief)


def test_many_features_that_come_and_go_keep_the_layout() -> None:
    rng = np.random.default_rng(3)
    belief = belief_of(MIXES[3])
    for _ in range(300):
        choice, count = rng.integers(3), int(belief.state.count)
        if choice == 0 and room_for(belief, 6):
            mean, J = np.array((0, 0, 0, 0, 0, 0.5)), rng.standard_normal((6, 12))
            append_feature(belief, INVERSE_DEPTH, mean, J, 0.01 * np.eye(6))
        elif choice == 1 and count:
            remove_feature(belief, rng.integers(count))
        elif choice == 2 and count:
            k = rng.integers(count)
            if belief.feature[k].kind != POINT:
                convert_to_point(belief, k)
        assert_well_laid(belief)


@every_mix
def test_public_covariance_is_T_P_Tt(kinds: list[int]) -> None:  # noqa: N802
    belief = belief_of(kinds)
    points, P = support.public(belief)
    T, extra = np.zeros((len(P), belief.state.dim)), np.zeros(P.shape)
    T[:CAMERA_DIM, :CAMERA_DIM] = np.eye(CAMERA_DIM)
    for k in range(len(kinds)):
        at, P_y = slice(12 + 3 * k, 15 + 3 * k), np.empty((3, 3))
        y, T[at, rows_of(belief, k)], extra[at, at] = as_point(belief, k)
        np.testing.assert_allclose(points[k], y)
        np.testing.assert_allclose(layout.point_marginal(belief, k, P_y), y)
        np.testing.assert_allclose(P_y, P[at, at], rtol=1e-10, atol=1e-14)
    np.testing.assert_allclose(P, T @ joint_covariance(belief) @ T.T + extra, rtol=1e-10, atol=1e-14)
    np.testing.assert_allclose(P, P.T, rtol=1e-12, atol=1e-16)
    np.linalg.cholesky(P)


@every_mix
def test_shifting_the_mean_adds_the_tangent_but_leaves_an_inverse_depth_positive(kinds: list[int]) -> None:
    before = belief_of(kinds)
    after, delta = copied(before), 0.05 * np.random.default_rng(2).standard_normal(before.state.dim)
    shift_mean(after, delta)
    np.testing.assert_allclose(support.mean_difference(after, before), delta, atol=1e-13)
    for feature in features_of(after)[features_of(after)["kind"] == INVERSE_DEPTH]:
        delta[feature["start"] + 5] = -10.0
    shift_mean(after, delta)
    features = features_of(after)
    assert (features["mean"][features["kind"] == INVERSE_DEPTH, 5] == MINIMUM_INVERSE_DEPTH).all()


@every_mix
def test_propagation_is_the_textbooks(kinds: list[int]) -> None:
    """The camera's rows by F and Q, the cross-covariances by F, and the map left alone."""
    rng = np.random.default_rng(4)
    belief = belief_of(kinds)
    P, F, Q = joint_covariance(belief), rng.standard_normal((12, 12)), support.random_spd(rng, [0.1] * 12)
    whole = np.eye(len(P))
    whole[:12, :12] = F
    expected = whole @ P @ whole.T
    expected[:12, :12] += Q
    propagate(belief.covariance, belief.state.dim, F, Q)
    np.testing.assert_allclose(joint_covariance(belief), expected, rtol=1e-11, atol=1e-14)
    assert_well_laid(belief)


def test_a_symmetric_product_adds_in_order_to_the_lower_triangle() -> None:
    """To the bit: covariances that differ in the last digit above and below their diagonal once changed image runs."""
    rng = np.random.default_rng(0)
    F, P = rng.standard_normal((5, 7)) * (rng.random((5, 7)) < 0.5), support.random_spd(rng, [1.0] * 7)
    A, out = F @ P, rng.standard_normal((5, 5))
    expected = out.copy()
    for i in range(5):
        for j in range(i + 1):
            for k in range(7):
                expected[i, j] += A[i, k] * F[j, k]
            expected[j, i] = expected[i, j]
    add_symmetric_product(A, F, out)
    np.testing.assert_array_equal(out, expected)


SHIFT = 0.03


def variant_of(variant: int) -> Belief:
    """A belief of the paper's scenario."""
    belief = belief_of([POINT, INVERSE_DEPTH, INVERSE_DEPTH, POINT])
    belief.state.variant = variant
    return belief


def test_a_turn_of_camera_and_map_is_not_measured_and_stays_as_uncertain_as_it_was() -> None:
    belief = variant_of(INVARIANT)
    dim, N = belief.state.dim, turn_of_everything(belief)
    np.testing.assert_allclose(dense_H(sight_of(belief)) @ N, 0.0, atol=1e-9)
    belief.covariance[:dim, :dim] = N @ N.T
    delta = SHIFT * np.random.default_rng(1).standard_normal(dim)
    delta[3:6] = 0.0
    shift_mean(belief, delta)
    update_covariance(belief, np.zeros((0, dim)), delta)
    N = turn_of_everything(belief)
    np.testing.assert_allclose(joint_covariance(belief), N @ N.T, atol=1e-12)
    np.testing.assert_allclose(dense_H(sight_of(belief)) @ N, 0.0, atol=1e-9)


def test_the_plain_filter_keeps_the_covariance_and_so_measures_a_turn() -> None:
    belief = variant_of(PLAIN)
    before, N = joint_covariance(belief), turn_of_everything(belief)
    delta = SHIFT * np.random.default_rng(1).standard_normal(len(before))
    shift_mean(belief, delta)
    update_covariance(belief, np.zeros((0, len(delta))), delta)
    np.testing.assert_allclose(joint_covariance(belief), before, rtol=1e-14)
    assert np.abs(dense_H(sight_of(belief)) @ N).max() > 1.0
