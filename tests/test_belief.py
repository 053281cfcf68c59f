"""Layout of the belief: appending, removing and converting leave the rest alone; the public belief is T P T^T."""

from __future__ import annotations

import numpy as np
import pytest

from activeslam_gym.config import Scenario
from activeslam_gym.motion import CAMERA_DIM
from activeslam_gym.slam import belief as layout
from activeslam_gym.slam.belief import DIM, FEATURES, FREE, INVERSE_DEPTH, KIND_DIM, POINT, RAY, Belief
from activeslam_gym.slam.prediction import propagate

from .support import (
    joint_covariance,
    mean_difference,
    random_belief,
    random_spd,
    rows_of,
    scenario_for,
    slots_of,
    turn_of_everything,
)

MIXES = [
    [],
    [POINT],
    [INVERSE_DEPTH],
    [POINT, INVERSE_DEPTH, POINT, INVERSE_DEPTH, INVERSE_DEPTH, POINT],
    [RAY, POINT, RAY, POINT],
]


def belief_of(kinds: list[int], seed: int = 0) -> Belief:
    return random_belief(scenario_for(kinds), kinds, np.random.default_rng(seed))


def public(belief: Belief) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) and covariance of the public belief."""
    F = len(belief.kind)
    points, P = np.full((F, 3), np.nan), np.full((CAMERA_DIM + 3 * F, CAMERA_DIM + 3 * F), np.nan)
    n = layout.point_belief(belief, points, P)
    return points[:n], P[: CAMERA_DIM + 3 * n, : CAMERA_DIM + 3 * n]


def conversion_matrix(belief: Belief) -> np.ndarray:
    """T (12 + 3 n, dim) of the public belief."""
    T = np.zeros((CAMERA_DIM + 3 * len(slots_of(belief)), belief.size[DIM]))
    T[:CAMERA_DIM, :CAMERA_DIM] = np.eye(CAMERA_DIM)
    for k, slot in enumerate(slots_of(belief)):
        block = np.empty((3, 6))
        layout.point_of(belief, slot, block)
        rows = rows_of(belief, slot)
        T[CAMERA_DIM + 3 * k : CAMERA_DIM + 3 * k + 3, rows] = block[:, : len(rows)]
    return T


def depth_variance(belief: Belief, slot: int) -> np.ndarray:
    """What a ray's particles add to its point's covariance, along it."""
    if belief.kind[slot] != RAY:
        return np.zeros((3, 3))
    m = layout.bearing(*belief.feature[slot, 3:5])[0]
    return belief.depth[slot, 1] * np.outer(m, m)


def assert_well_laid(belief: Belief) -> None:
    """Blocks follow each other by age, without gaps, and the covariance in use is symmetric to the bit."""
    at = CAMERA_DIM
    for slot in slots_of(belief):
        assert belief.start[slot] == at
        at += KIND_DIM[belief.kind[slot]]
    assert at == belief.size[DIM]
    assert np.sum(belief.kind != FREE) == belief.size[FEATURES]
    assert np.all(np.diff(belief.serial[slots_of(belief)]) > 0)
    P = joint_covariance(belief)
    np.testing.assert_array_equal(P, P.T)


# Kinds --------------------------------------------------------------------------------------------------------------


def test_bearing_directions() -> None:
    np.testing.assert_allclose(layout.bearing(0.0, 0.0)[0], [0, 0, 1])
    np.testing.assert_allclose(layout.bearing(np.pi / 2, 0.0)[0], [1, 0, 0], atol=1e-15)
    np.testing.assert_allclose(layout.bearing(0.3, np.pi / 2)[0], [0, 1, 0], atol=1e-15)


def test_angles_undo_the_bearing_everywhere() -> None:
    J = np.empty((2, 3))
    for azimuth in np.linspace(-3.1, 3.1, 13):
        for elevation in np.linspace(-1.5, 1.5, 7):
            angles = layout.angles_of(2.5 * layout.bearing(azimuth, elevation)[0], J)
            np.testing.assert_allclose(angles, [azimuth, elevation], atol=1e-12)


def test_straight_up_is_finite() -> None:
    J = np.empty((2, 3))
    assert np.isfinite(layout.angles_of(np.array([0.0, 1.0, 0.0]), J)).all()
    assert np.isfinite(J).all()


def test_prior_is_the_scenarios() -> None:
    scenario = Scenario(position_std=(0.1, 0.2, 0.3), orientation_std=0.4, velocity_std=0.5, angular_velocity_std=0.6)
    belief = layout.empty_belief(scenario)
    layout.reset_belief(belief, scenario)
    stds = [0.1, 0.2, 0.3] + [0.4] * 3 + [0.5] * 3 + [0.6] * 3
    np.testing.assert_allclose(joint_covariance(belief), np.diag(np.square(stds)))
    np.testing.assert_array_equal(belief.camera, [0, 0, 0, 1] + [0] * 9)


@pytest.mark.parametrize("kind", [RAY, INVERSE_DEPTH, POINT])
def test_depth_ratio_is_sigma_over_depth(kind: int) -> None:
    belief = belief_of([kind])
    (slot,) = slots_of(belief)
    P = joint_covariance(belief)[rows_of(belief, slot)][:, rows_of(belief, slot)]
    if kind == RAY:
        expected = np.sqrt(belief.depth[slot, 1]) / belief.depth[slot, 0]
    elif kind == INVERSE_DEPTH:
        expected = np.sqrt(P[5, 5]) / belief.feature[slot, 5]
    else:
        sight = belief.feature[slot, :3] - belief.camera[:3]
        distance = np.linalg.norm(sight)
        expected = np.sqrt(sight @ P @ sight) / distance / distance
    assert layout.depth_ratio(belief, slot) == pytest.approx(expected, rel=1e-12)


# Append, remove, convert --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kinds", MIXES, ids=str)
def test_a_new_feature_gets_its_covariance_and_leaves_the_rest(kinds: list[int]) -> None:
    """P_yx = J P_cx, P_yy = J P_cc J^T + Q."""
    rng = np.random.default_rng(1)
    belief = belief_of(kinds)
    before, J, Q = joint_covariance(belief), rng.standard_normal((6, 12)), random_spd(rng, [0.1] * 6)
    slot = layout.append_feature(belief, INVERSE_DEPTH, np.arange(6.0), J, Q)
    G = np.zeros((6, len(before)))
    G[:, :12] = J
    whole = np.block([[before, before @ G.T], [G @ before, G @ before @ G.T + Q]])
    np.testing.assert_array_equal(joint_covariance(belief)[: len(before), : len(before)], before)
    np.testing.assert_allclose(joint_covariance(belief), whole, rtol=1e-11, atol=1e-14)
    assert slots_of(belief)[-1] == slot and belief.kind[slot] == INVERSE_DEPTH
    np.testing.assert_array_equal(belief.feature[slot], np.arange(6.0))
    assert_well_laid(belief)


@pytest.mark.parametrize("gone", range(6))
def test_removing_a_feature_marginalises_it_out(gone: int) -> None:
    belief = belief_of(MIXES[3])
    before, slots = joint_covariance(belief), slots_of(belief)
    kept = np.setdiff1d(np.arange(len(before)), rows_of(belief, slots[gone]))
    layout.remove_feature(belief, slots[gone])
    np.testing.assert_array_equal(joint_covariance(belief), before[np.ix_(kept, kept)])
    assert slots_of(belief) == slots[:gone] + slots[gone + 1 :]
    assert_well_laid(belief)


@pytest.mark.parametrize(
    ("kinds", "which"), [(MIXES[3], 1), (MIXES[3], 4), (MIXES[4], 0), (MIXES[4], 2), ([INVERSE_DEPTH], 0)]
)
def test_converting_a_feature_is_its_jacobian_on_the_joint_covariance(kinds: list[int], which: int) -> None:
    belief = belief_of(kinds)
    slot = slots_of(belief)[which]
    block, rows, before, others = (
        np.empty((3, 6)),
        rows_of(belief, slot),
        joint_covariance(belief),
        belief.feature.copy(),
    )
    y = layout.point_of(belief, slot, block)
    T = np.eye(len(before))
    T = np.delete(T, rows[3:], axis=0)
    T[np.ix_(rows[:3], rows)] = block[:, : len(rows)]
    expected = T @ before @ T.T
    expected[np.ix_(rows[:3], rows[:3])] += depth_variance(belief, slot)
    layout.convert_to_point(belief, slot)
    np.testing.assert_allclose(joint_covariance(belief), expected, rtol=1e-11, atol=1e-14)
    np.testing.assert_allclose(belief.feature[slot, :3], y)
    others[slot] = belief.feature[slot]
    np.testing.assert_array_equal(belief.feature, others)
    assert belief.kind[slot] == POINT
    assert_well_laid(belief)


def test_a_slot_is_used_again_and_its_tenants_told_apart() -> None:
    belief = belief_of([POINT, POINT, POINT])
    first = slots_of(belief)[0]
    serial = belief.serial[first]
    layout.remove_feature(belief, first)
    again = layout.append_feature(belief, POINT, np.zeros(6), np.zeros((3, 12)), np.eye(3))
    assert again == first and belief.serial[again] > serial
    assert slots_of(belief)[-1] == again
    assert_well_laid(belief)


def test_many_births_and_deaths_keep_the_layout() -> None:
    rng = np.random.default_rng(3)
    belief = belief_of(MIXES[3])
    for _ in range(300):
        slots = slots_of(belief)
        choice = rng.integers(3)
        if choice == 0 and layout.room_for(belief, 6):
            J, Q = rng.standard_normal((6, 12)), 0.01 * np.eye(6)
            layout.append_feature(belief, INVERSE_DEPTH, np.array([0, 0, 0, 0, 0, 0.5]), J, Q)
        elif choice == 1 and slots:
            layout.remove_feature(belief, rng.choice(slots))
        elif choice == 2 and slots:
            slot = rng.choice(slots)
            if belief.kind[slot] != POINT:
                layout.convert_to_point(belief, slot)
        assert_well_laid(belief)


def test_a_full_belief_says_so() -> None:
    belief = belief_of([])
    count = 0
    while layout.room_for(belief, 6):
        layout.append_feature(belief, INVERSE_DEPTH, np.full(6, 0.5), np.zeros((6, 12)), np.eye(6))
        count += 1
    assert count >= 24
    for slot in slots_of(belief):
        layout.convert_to_point(belief, slot)
    while layout.room_for(belief, 3):
        layout.append_feature(belief, POINT, np.zeros(6), np.zeros((3, 12)), np.eye(3))
    assert belief.size[FEATURES] == len(belief.kind)
    assert_well_laid(belief)


# The public belief --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kinds", MIXES, ids=str)
def test_public_covariance_is_T_P_Tt(kinds: list[int]) -> None:  # noqa: N802
    belief = belief_of(kinds)
    points, P = public(belief)
    T = conversion_matrix(belief)
    expected = T @ joint_covariance(belief) @ T.T
    for k, slot in enumerate(slots_of(belief)):
        at = slice(12 + 3 * k, 15 + 3 * k)
        expected[at, at] += depth_variance(belief, slot)
        np.testing.assert_allclose(points[k], layout.point_of(belief, slot, np.empty((3, 6))))
    np.testing.assert_allclose(P, expected, rtol=1e-10, atol=1e-14)


@pytest.mark.parametrize("kinds", MIXES, ids=str)
def test_public_covariance_is_symmetric_positive_definite(kinds: list[int]) -> None:
    _, P = public(belief_of(kinds))
    np.testing.assert_allclose(P, P.T, rtol=1e-12, atol=1e-16)
    np.linalg.cholesky(P)


def test_conversion_does_not_change_the_public_belief() -> None:
    belief = belief_of(MIXES[3])
    points, P = public(belief)
    for slot in slots_of(belief):
        if belief.kind[slot] != POINT:
            layout.convert_to_point(belief, slot)
    points_after, P_after = public(belief)
    np.testing.assert_allclose(points_after, points, rtol=1e-14)
    np.testing.assert_allclose(P_after, P, rtol=1e-10, atol=1e-14)


# The mean and the camera's rows -------------------------------------------------------------------------------------


@pytest.mark.parametrize("kinds", MIXES, ids=str)
def test_shifting_the_mean_adds_the_tangent(kinds: list[int]) -> None:
    before, after = belief_of(kinds), belief_of(kinds)
    delta = 0.05 * np.random.default_rng(2).standard_normal(before.size[DIM])
    layout.shift_mean(after, delta)
    np.testing.assert_allclose(mean_difference(after, before), delta, atol=1e-13)


def test_an_update_leaves_an_inverse_depth_positive() -> None:
    belief = belief_of([INVERSE_DEPTH])
    delta = np.zeros(belief.size[DIM])
    delta[-1] = -10.0
    layout.shift_mean(belief, delta)
    assert belief.feature[slots_of(belief)[0], 5] == layout.MINIMUM_INVERSE_DEPTH


def test_propagation_is_the_textbooks() -> None:
    rng = np.random.default_rng(4)
    belief = belief_of(MIXES[3])
    P, F, Q = joint_covariance(belief), rng.standard_normal((12, 12)), random_spd(rng, [0.1] * 12)
    whole = np.eye(len(P))
    whole[:12, :12] = F
    expected = whole @ P @ whole.T
    expected[:12, :12] += Q
    propagate(belief.covariance, belief.size[DIM], F, Q)
    np.testing.assert_allclose(joint_covariance(belief), expected, rtol=1e-11, atol=1e-14)
    assert_well_laid(belief)


@pytest.mark.parametrize("kinds", MIXES[1:])
def test_a_turn_of_camera_and_map_stays_as_uncertain_as_it_was(kinds: list[int]) -> None:
    """A belief that knows all but such a turn knows nothing of it after a shift of its mean: P+ = N+ N+^T."""
    belief = belief_of(kinds)
    dim = belief.size[DIM]
    N = turn_of_everything(belief)
    belief.covariance[:dim, :dim] = N @ N.T
    delta = 0.1 * np.random.default_rng(1).standard_normal(dim)
    delta[3:6] = 0.0
    layout.shift_mean(belief, delta)
    layout.recentre(belief, delta)
    N = turn_of_everything(belief)
    np.testing.assert_allclose(joint_covariance(belief), N @ N.T, atol=1e-12)
