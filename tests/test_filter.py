"""The filter: update, prediction, association, births and deaths."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from activeslam_gym.config import INVERSE_DEPTH as BY_INVERSE_DEPTH
from activeslam_gym.config import Scenario
from activeslam_gym.envs.frame import filter_entries
from activeslam_gym.geometry import so3_left_jacobian
from activeslam_gym.motion import motion_of
from activeslam_gym.slam.association import NEW, REJECTED, associate
from activeslam_gym.slam.belief import DIM, FEATURES, INVERSE_DEPTH, POINT, RAY, SERIAL, convert_to_point, point_belief
from activeslam_gym.slam.depth_particles import follow_rays, predict_rays
from activeslam_gym.slam.filter import filter_frame
from activeslam_gym.slam.measurement import INSIDE, predict_measurements
from activeslam_gym.slam.prediction import predict, propagate
from activeslam_gym.slam.settings import filter_of
from activeslam_gym.slam.update import innovation_covariance, stack, update
from tests.support import (
    CAMERA,
    PAPER,
    copied,
    dense_H,
    joint_covariance,
    mean_difference,
    random_belief,
    random_spd,
    scenario_for,
    slots_of,
    turn_of_everything,
    world_points,
)

MODEL = filter_of(PAPER)
NO_FIDUCIALS = np.zeros((0, 3))
NOTHING_GIVEN = np.empty(0, np.int64)


def batch(belief, fiducials, rows):
    """(predictions, H P, S) of the stacked rows."""
    K = len(fiducials)
    predictions = predict_measurements(CAMERA, belief, fiducials)
    HP = stack(belief, K, rows, predictions)
    return predictions, HP, innovation_covariance(belief, K, rows, predictions, HP, CAMERA.pixel_std**2)


@pytest.mark.parametrize("kinds", [[], [POINT] * 4, [INVERSE_DEPTH, POINT, INVERSE_DEPTH]])
def test_update_is_the_textbooks(kinds: list[int]) -> None:
    rng = np.random.default_rng(len(kinds))
    belief = random_belief(PAPER, kinds, rng)
    fiducials = world_points(rng, belief.camera, 2)
    rows = np.array([1, 0, *(2 + slot for slot in slots_of(belief))])
    predictions, HP, S = batch(belief, fiducials, rows)
    nu = rng.standard_normal(2 * len(rows))
    H, P, before = dense_H(belief, 2, rows, predictions), joint_covariance(belief), copied(belief)
    np.testing.assert_allclose(HP, H @ P, atol=1e-12)
    np.testing.assert_allclose(S, H @ P @ H.T + CAMERA.pixel_std**2 * np.eye(len(H)), rtol=1e-12)
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + CAMERA.pixel_std**2 * np.eye(len(H)))
    assert update(belief, HP, S, nu.copy())
    np.testing.assert_allclose(mean_difference(belief, before), K @ nu, atol=1e-10)
    M, G = np.eye(len(P)), np.eye(len(P))  # the covariance is expressed about the new mean
    M[:, 3:6] += turn_of_everything(belief) - turn_of_everything(before)
    G[3:6, 3:6] = so3_left_jacobian((K @ nu)[3:6])
    G = G @ M
    np.testing.assert_allclose(joint_covariance(belief), G @ (P - K @ H @ P) @ G.T, atol=1e-12)
    np.testing.assert_array_equal(joint_covariance(belief), joint_covariance(belief).T)


def test_a_broken_innovation_covariance_changes_nothing() -> None:
    belief = random_belief(PAPER, [POINT], np.random.default_rng(0))
    before = copied(belief)
    assert not update(belief, np.zeros((2, belief.size[DIM])), -np.eye(2), np.ones(2))
    np.testing.assert_array_equal(belief.covariance, before.covariance)
    np.testing.assert_array_equal(belief.camera, before.camera)


def test_prediction_carries_the_cross_covariances() -> None:
    rng = np.random.default_rng(1)
    belief = random_belief(PAPER, [POINT, INVERSE_DEPTH], rng)
    P = joint_covariance(belief)
    F, Q = rng.standard_normal((12, 12)), random_spd(rng, [0.1] * 12)
    G = np.eye(len(P))
    G[:12, :12] = F
    expected = G @ P @ G.T
    expected[:12, :12] += Q
    propagate(belief.covariance, belief.size[DIM], F, Q)
    np.testing.assert_allclose(joint_covariance(belief), expected, atol=1e-12)


def test_ekf_is_the_kalman_filter_where_the_model_is_linear() -> None:
    """Without turning, position and velocity are a linear system: p, v against a plain Kalman filter over 20 frames."""
    scenario = replace(PAPER, orientation_std=1e-9, angular_velocity_std=1e-9, angular_acceleration_std=1e-12)
    motion, rng = motion_of(scenario, 1.0), np.random.default_rng(2)
    belief = random_belief(scenario, [], rng)
    belief.camera[3:7], belief.camera[10:] = (1.0, 0.0, 0.0, 0.0), 0.0
    belief.covariance[:12, :12] = np.diag([0.1**2] * 3 + [1e-18] * 3 + [0.2**2] * 3 + [1e-18] * 3)
    x, P = np.concatenate((belief.camera[:3], belief.camera[7:10])), np.diag([0.1**2] * 3 + [0.2**2] * 3)
    dt, sigma = motion.dt, motion.filter_acceleration_std
    F = np.block([[np.eye(3), dt * np.eye(3)], [np.zeros((3, 3)), np.eye(3)]])
    G = np.concatenate((dt * dt * np.eye(3), dt * np.eye(3)))
    H = np.concatenate((rng.standard_normal((2, 3)), np.zeros((2, 3))), axis=1)  # a linear measurement of position
    R = 0.01 * np.eye(2)
    for _ in range(20):
        u, z = rng.standard_normal(3), rng.standard_normal(2)
        predict(motion, belief, np.concatenate((u, np.zeros(3))))
        x, P = F @ x + G @ u, F @ P @ F.T + sigma**2 * G @ G.T
        H_tangent = np.concatenate((H[:, :3], np.zeros((2, 9))), axis=1)
        HP = H_tangent @ belief.covariance[:12, :12]
        assert update(belief, HP.copy(), HP @ H_tangent.T + R, z - H[:, :3] @ belief.camera[:3])
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        x, P = x + K @ (z - H @ x), P - K @ H @ P
    np.testing.assert_allclose(np.concatenate((belief.camera[:3], belief.camera[7:10])), x, atol=1e-12)
    kept = np.array([0, 1, 2, 6, 7, 8])
    np.testing.assert_allclose(belief.covariance[np.ix_(kept, kept)], P, atol=1e-13)


# Association --------------------------------------------------------------------------------------------------------


def match(belief, pixels, fiducials=NO_FIDUCIALS):
    """(M,) matches of the pixels, and (rows,) which rows wait."""
    predictions = predict_measurements(CAMERA, belief, fiducials)
    rows = np.flatnonzero(predictions.visibility)
    _, _, S = batch(belief, fiducials, rows)
    waits = np.zeros(len(predictions.visibility), np.bool_)
    return associate(MODEL, rows, predictions, S, np.reshape(pixels, (-1, 2)), waits), waits


def two_points(separation_px: float, std: float):
    """A belief about two points side by side 2 m ahead, and their predicted pixels."""
    belief = random_belief(PAPER, [POINT, POINT], np.random.default_rng(3))
    belief.camera[:3], belief.camera[3:7] = 0.0, (1.0, 0.0, 0.0, 0.0)
    belief.feature[0, :3], belief.feature[1, :3] = (0.0, 0.0, 2.0), (-2.0 * separation_px / CAMERA.focal, 0.0, 2.0)
    belief.covariance[:18, :18] = np.diag([1e-6] * 12 + [std**2] * 6)
    return belief, predict_measurements(CAMERA, belief, NO_FIDUCIALS).z_hat[:2]


def test_clear_matches_are_made_in_any_order() -> None:
    belief, z = two_points(60.0, 0.005)
    np.testing.assert_array_equal(match(belief, z + 1.0)[0], [0, 1])
    np.testing.assert_array_equal(match(belief, z[::-1] + 1.0)[0], [1, 0])


def test_a_detection_outside_every_gate_is_new_and_between_the_gates_rejected() -> None:
    belief, z = two_points(60.0, 0.005)
    S = predict_measurements(CAMERA, belief, NO_FIDUCIALS).S[0]
    for d2, expected in ((0.9 * MODEL.gate, 0), (1.1 * MODEL.gate, REJECTED), (1.1 * MODEL.birth_gate, NEW)):
        offset = np.array([0.0, np.sqrt(d2 * S[1, 1])])
        assert match(belief, z[:1] + offset)[0].tolist() == [expected]


def test_an_ambiguous_detection_waits() -> None:
    belief, z = two_points(3.0, 0.005)
    found, waits = match(belief, z.mean(axis=0))
    assert found.tolist() == [REJECTED]
    assert waits[:2].all()


def test_a_vague_row_is_matched_only_with_support() -> None:
    """Two points that the camera's rotation makes vague together: one detection waits, both explain each other."""
    belief, z = two_points(60.0, 0.002)
    belief.covariance[4, 4] = np.radians(3.0) ** 2  # yaw: about 10 px, for both alike
    shift = np.array([8.0, 0.0])
    assert match(belief, z[:1] + shift)[0].tolist() == [REJECTED]
    np.testing.assert_array_equal(match(belief, z + shift)[0], [0, 1])


def test_a_vague_row_at_the_edge_of_the_image_needs_more_support_than_one_inside() -> None:
    """The same pair, once in the middle of the image and once where its ellipses reach over the edge."""
    belief, z = two_points(60.0, 0.002)
    belief.covariance[4, 4] = np.radians(3.0) ** 2
    shift = np.array([8.0, 0.0])
    assert (match(belief, z + shift)[0] >= 0).all()
    belief.feature[:2, 1] -= 2.0 * (CAMERA.height - 10.0 - z[0, 1]) / CAMERA.focal
    z = predict_measurements(CAMERA, belief, NO_FIDUCIALS).z_hat[:2]
    assert (match(belief, z + shift)[0] == REJECTED).all()


def test_a_ray_is_matched_along_its_particles() -> None:
    scenario = scenario_for([RAY])
    belief = random_belief(scenario, [RAY], np.random.default_rng(4))
    rays = predict_rays(CAMERA, belief)
    pixel = rays.z_hat[0, rays.z_hat.shape[1] // 2]
    found = np.array([REJECTED, NEW, NEW])
    follow_rays(CAMERA, MODEL, belief, 0, np.stack((pixel, pixel, pixel + 150.0)), found)
    assert found.tolist() == [REJECTED, 0, NEW]


# Births and deaths --------------------------------------------------------------------------------------------------


def still_belief(scenario: Scenario = PAPER):
    """A belief without features, sure of its pose and at rest."""
    belief = random_belief(scenario, [], np.random.default_rng(5))
    belief.camera[:] = 0.0
    belief.camera[3] = 1.0
    belief.covariance[:12, :12] = np.diag([1e-8] * 12)
    return belief


def frame(belief, pixels, scenario: Scenario = PAPER):
    """Counters of one frame of a camera that stays."""
    counters = np.zeros(6, np.int64)
    quiet = replace(scenario, acceleration_std=1e-3, angular_acceleration_std=1e-3)
    z = np.reshape(np.array(pixels, float), (-1, 2))
    arguments = (NO_FIDUCIALS, np.zeros(6), z, NOTHING_GIVEN, np.zeros(len(z), np.int64), counters)
    rays = filter_entries(with_rays=True).follow_rays
    filter_frame(CAMERA, motion_of(quiet, 1.0), filter_of(scenario), belief, *arguments, rays)
    return counters


@pytest.mark.parametrize("initialisation, kind", [(BY_INVERSE_DEPTH, INVERSE_DEPTH), ("depth_particles", RAY)])
def test_a_feature_is_born_at_the_third_consecutive_detection(initialisation: str, kind: int) -> None:
    scenario = replace(PAPER, initialisation=initialisation)
    belief = still_belief(scenario)
    births = [frame(belief, [[100.0, 100.0]], scenario)[0] for _ in range(3)]
    assert births == [0, 0, 1]
    assert belief.kind[belief.order[0]] == kind
    for _ in range(20):
        assert frame(belief, [[100.0, 100.0]], scenario)[0] == 0  # no duplicate of what is known
    assert belief.size[SERIAL] == 1


def test_an_interrupted_candidate_starts_anew() -> None:
    belief = still_belief()
    pixels = [[[100.0, 100.0]], [[100.0, 100.0]], [], [[100.0, 100.0]], [[100.0, 100.0]]]
    assert sum(frame(belief, p)[0] for p in pixels) == 0


def test_a_feature_that_should_be_seen_and_is_not_is_deleted() -> None:
    belief = still_belief()
    for _ in range(5):
        frame(belief, [[160.0, 120.0]])
    deletions = [frame(belief, [])[2] for _ in range(PAPER.maximum_misses)]
    assert deletions == [0] * (PAPER.maximum_misses - 1) + [1]
    assert belief.size[FEATURES] == 0
    assert belief.size[DIM] == 12


@pytest.mark.parametrize("kind, kept", [(INVERSE_DEPTH, False), (POINT, True)])
def test_a_feature_out_of_sight_is_forgotten_if_it_is_no_point(kind: int, kept: bool) -> None:
    belief = still_belief()
    frames = round(PAPER.inverse_depth_memory / PAPER.frame_time)
    for _ in range(5):
        frame(belief, [[160.0, 120.0]])
    if kind == POINT:
        convert_to_point(belief, belief.order[0])
    belief.camera[3:7] = (0.0, 0.0, 1.0, 0.0)  # turned around
    assert sum(frame(belief, [])[2] for _ in range(frames)) == 0
    assert frame(belief, [])[2] == (0 if kept else 1)
    assert belief.size[FEATURES] == int(kept)


def test_a_full_map_gives_no_birth_and_no_error() -> None:
    belief = still_belief()
    grid = [[20.0 + 24.0 * i, 20.0 + 28.0 * j] for i in range(12) for j in range(8)]
    for _ in range(5):
        frame(belief, grid)
    assert belief.size[FEATURES] <= len(belief.kind)
    frame(belief, [[5.0, 5.0]])


def test_predictions_know_what_is_well_inside_the_image() -> None:
    belief, _ = two_points(60.0, 0.005)
    assert (predict_measurements(CAMERA, belief, NO_FIDUCIALS).visibility[:2] == INSIDE).all()


def test_public_covariance_is_symmetric_positive_definite_after_births() -> None:
    belief = still_belief()
    for _ in range(10):
        frame(belief, [[80.0, 80.0], [240.0, 80.0], [160.0, 200.0]])
    points, P = np.empty((len(belief.kind), 3)), np.empty((12 + 3 * len(belief.kind),) * 2)
    n = point_belief(belief, points, P)
    assert n == 3
    used = P[: 12 + 3 * n, : 12 + 3 * n]
    np.testing.assert_allclose(used, used.T, rtol=1e-12)
    np.linalg.cholesky(used)
