"""The filter: update, prediction, association, initialisation and deletion."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import block_diag

from activeslam_gym.config import INVERSE_DEPTH as BY_INVERSE_DEPTH
from activeslam_gym.config import Scenario
from activeslam_gym.geometry import so3_left_jacobian
from activeslam_gym.kernels import filled, record
from activeslam_gym.motion import MOTION, motion_of
from activeslam_gym.slam.association import associate, match_by_id, match_unknown
from activeslam_gym.slam.belief import INVERSE_DEPTH, POINT, RAY
from activeslam_gym.slam.depth_particles import follow_rays, predict_rays
from activeslam_gym.slam.detection import NEW, REJECTED, UNASSOCIATED, WAITS
from activeslam_gym.slam.filter import COUNTS, FILTER, detections_of, filter_of
from activeslam_gym.slam.kalman import predict
from activeslam_gym.slam.kalman import update as update_by_matches
from activeslam_gym.slam.map import convert_and_delete, convert_to_point, count_misses, initialise
from activeslam_gym.slam.sight import PRODUCT_FRAMES
from tests import support
from tests.support import CAMERA, NO_BOXES, PAPER, copied, dense_H, joint_covariance, random_belief, sight_of, update

MODEL = filter_of(PAPER)
GATE, NEW_FEATURE_GATE = MODEL.association.gate, MODEL.association.new_feature_gate
VAR = CAMERA.pixel_std**2
R_PAPER = VAR * np.eye(2)
MODELS = record(lens=CAMERA.dtype, motion=MOTION, filter=FILTER)


def models_of(scenario: Scenario):
    """The constants of a frame."""
    return filled(MODELS, lens=CAMERA, motion=motion_of(scenario, 1.0), filter=filter_of(scenario))


def counters():
    return np.zeros(1, COUNTS)[0]


def detections_at(pixels, **given):
    """Detections with the camera's own noise, where nothing else is ``given``."""
    return detections_of(pixels, **{"R": R_PAPER, **given})


def use(models, belief, fiducials, boxes, sight, detections, labelled: bool = False):
    """Associate and update, as a frame does; the counters."""
    counts, constants = counters(), models.filter.initialisation
    matches = associate(models, belief, boxes, sight, detections, labelled, counts)
    count_misses(constants, belief, len(fiducials), sight, matches)
    update_by_matches(models, belief, fiducials, sight, matches, detections, counts)
    convert_and_delete(constants, belief, counts)
    return counts


def assert_updated(belief, before, H, R, nu) -> None:
    """The textbook's update, with the covariance expressed about the new mean."""
    P = joint_covariance(before)
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
    np.testing.assert_allclose(support.mean_difference(belief, before), K @ nu, atol=1e-10)
    M, G = np.eye(len(P)), np.eye(len(P))
    M[:, 3:6] += support.turn_of_everything(belief) - support.turn_of_everything(before)
    G[3:6, 3:6] = so3_left_jacobian((K @ nu)[3:6])
    G = G @ M
    np.testing.assert_allclose(joint_covariance(belief), G @ (P - K @ H @ P) @ G.T, atol=1e-12)
    np.testing.assert_array_equal(joint_covariance(belief), joint_covariance(belief).T)


@pytest.mark.parametrize("kinds", [[], [POINT] * 4, [INVERSE_DEPTH, POINT, INVERSE_DEPTH]])
def test_update_is_the_textbooks(kinds: list[int]) -> None:
    rng = np.random.default_rng(len(kinds))
    belief = random_belief(PAPER, kinds, rng)
    sight, before = sight_of(belief, support.world_points(rng, belief.state.camera, 2)), copied(belief)
    H, P, nu = dense_H(sight), joint_covariance(belief), rng.standard_normal(len(sight.S))
    R = VAR * np.eye(len(H)) + block_diag(*sight.point["curvature"])
    assert (np.linalg.eigvalsh(sight.point["curvature"][2:]) > 0.0).all(axis=1)[np.array(kinds) == INVERSE_DEPTH].all()
    assert sight.point["id"].tolist() == [-1, -2, *range(1, len(kinds) + 1)]
    np.testing.assert_allclose(sight.HP, H @ P, atol=1e-12)
    np.testing.assert_allclose(sight.S, H @ P @ H.T + R, rtol=1e-12)
    assert update(belief, sight.HP.copy(), sight.S.copy(), nu.copy())
    assert_updated(belief, before, H, R, nu)


def test_every_detection_is_used_with_its_own_noise() -> None:
    """The textbook's update with blockdiag R, of the matched predictions alone, in whatever order they come."""
    rng = np.random.default_rng(7)
    belief = random_belief(PAPER, [POINT, INVERSE_DEPTH, POINT], rng)
    fiducials = support.world_points(rng, belief.state.camera, 2)
    sight, before, matched = sight_of(belief, fiducials), copied(belief), [4, 0, 3]
    nu, own = rng.standard_normal((3, 2)), np.array([support.random_spd(rng, [0.5, 2.0]) for _ in matched])
    own[2] = 100.0 * R_PAPER
    detections = detections_of(sight.point["z_hat"][matched] + nu, own, sight.point["id"][matched])
    use(models_of(PAPER), belief, fiducials, NO_BOXES, sight, detections, True)
    order = np.argsort(matched)
    H = dense_H(sight).reshape(5, 2, -1)[np.sort(matched)].reshape(6, -1)
    R = np.zeros((6, 6))
    for i, k in enumerate(order):
        lasting = PRODUCT_FRAMES * sight.point["curvature"][np.sort(matched)[i]]
        R[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = own[k] + lasting
    assert belief.feature["kind"][:3].tolist() == [POINT, INVERSE_DEPTH, POINT]  # none was converted
    assert_updated(belief, before, H, R, nu[order].ravel())


def test_ekf_is_the_kalman_filter_where_the_model_is_linear() -> None:
    """Without turning, position and velocity are a linear system: p, v against a plain Kalman filter over 20 frames."""
    scenario = replace(PAPER, orientation_std=1e-9, angular_velocity_std=1e-9, angular_acceleration_std=1e-12)
    motion, rng = motion_of(scenario, 1.0), np.random.default_rng(2)
    belief = random_belief(scenario, [], rng)
    camera, kept = belief.state.camera, np.array([0, 1, 2, 6, 7, 8])
    camera[3:7], camera[10:] = (1.0, 0.0, 0.0, 0.0), 0.0
    belief.covariance[:12, :12] = np.diag([0.1**2] * 3 + [1e-18] * 3 + [0.2**2] * 3 + [1e-18] * 3)
    x, P = camera[[0, 1, 2, 7, 8, 9]], np.diag([0.1**2] * 3 + [0.2**2] * 3)
    dt, sigma = motion.dt, motion.filter_acceleration_std
    F = np.block([[np.eye(3), dt * np.eye(3)], [np.zeros((3, 3)), np.eye(3)]])
    G = np.concatenate((dt * dt * np.eye(3), dt * np.eye(3)))
    H = np.concatenate((rng.standard_normal((2, 3)), np.zeros((2, 3))), axis=1)  # a linear measurement of position
    R = 0.01 * np.eye(2)
    for _ in range(20):
        u, z = rng.standard_normal(3), rng.standard_normal(2)
        predict(motion, belief, np.concatenate((u, np.zeros(3))), dt, False)
        x, P = F @ x + G @ u, F @ P @ F.T + sigma**2 * G @ G.T
        H_tangent = np.concatenate((H[:, :3], np.zeros((2, 9))), axis=1)
        HP = H_tangent @ belief.covariance[:12, :12]
        assert update(belief, HP.copy(), HP @ H_tangent.T + R, z - H[:, :3] @ camera[:3])
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        x, P = x + K @ (z - H @ x), P - K @ H @ P
    np.testing.assert_allclose(camera[[0, 1, 2, 7, 8, 9]], x, atol=1e-12)
    np.testing.assert_allclose(belief.covariance[np.ix_(kept, kept)], P, atol=1e-13)


def match(belief, pixels, **given):
    """(M,) what the detections are matched to, and (v,) which predictions wait."""
    sight, detections = sight_of(belief), detections_at(pixels, **given)
    matches = match_unknown(MODEL.association, sight, detections, int(belief.state.count))
    for a, i in enumerate(matches):
        assert i < 0 or detections[i]["match"] == sight.point[a]["id"]
    assert sum(matches >= 0) == sum((detections["match"] != NEW) & (detections["match"] != REJECTED))
    return detections["match"].tolist(), matches == WAITS


def two_points(separation_px: float = 60.0, std: float = 0.005, yaw_std: float = 1e-3):
    """A belief about two points side by side 2 m ahead, with the ids 1 and 2, and their predicted pixels."""
    belief = random_belief(PAPER, [POINT, POINT], np.random.default_rng(3))
    belief.state.camera[:7] = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    belief.feature["mean"][:2, :3] = (0.0, 0.0, 2.0), (-2.0 * separation_px / CAMERA.focal, 0.0, 2.0)
    belief.covariance[:18, :18] = np.diag([1e-6] * 12 + [std**2] * 6)
    belief.covariance[4, 4] = yaw_std**2
    return belief, sight_of(belief).point["z_hat"]


@pytest.mark.parametrize("scale", [0.25, 1.0, 9.0])
def test_a_detection_outside_every_gate_is_new_and_one_at_the_edge_of_the_wide_one_waits(scale: float) -> None:
    """The gates are those of its own noise: ``scale`` times the camera's."""
    belief, z = two_points()
    S = sight_of(belief).S[:2, :2] + (scale - 1.0) * R_PAPER
    for d2, expected in ((0.9 * GATE, 1), (0.9 * NEW_FEATURE_GATE, REJECTED), (1.1 * NEW_FEATURE_GATE, NEW)):
        offset = np.array([0.0, np.sqrt(d2 * S[1, 1])])
        assert match(belief, z[:1] + offset, R=scale * R_PAPER)[0] == [expected]


def test_an_ambiguous_detection_waits_unless_its_id_or_its_looks_decide() -> None:
    belief, z = two_points(3.0)
    found, waits = match(belief, z.mean(axis=0))
    assert found == [REJECTED] and waits.all()
    for id in (1, 2):
        assert match(belief, z.mean(axis=0), ids=id)[0] == [id]
    belief, z = two_points()
    pixels, enough = np.stack((z[0] + 0.5, z[0] - 0.5)), 0.6 * MODEL.association.clear_margin
    assert match(belief, pixels)[0] == [REJECTED, REJECTED]
    for ratios, expected in (([0, 1.0], [REJECTED] * 2), ([0, enough], [REJECTED, 1]), ([enough, 0], [1, REJECTED])):
        assert match(belief, pixels, ids=1, log_ratios=ratios)[0] == expected


def test_a_labelled_ray_is_weighed_by_its_own_detection_alone() -> None:
    """Bayes on the particles once the camera has moved: the weights are the textbook's likelihoods."""
    belief = random_belief(support.scenario_for([RAY]), [RAY], np.random.default_rng(4))
    pixel = predict_rays(CAMERA, belief, NO_BOXES).particle["z_hat"][0, PAPER.particle_count // 2].copy()
    ray, R = belief.feature[0], np.array([[9.0, 2.0], [2.0, 5.0]])
    ray.weighed_at[:] = 100.0
    rays, weights = predict_rays(CAMERA, belief, NO_BOXES).particle[0], belief.particles[ray.slot, :, 1]
    S = rays["S"] + R - R_PAPER
    error = pixel + 3.0 - rays["z_hat"]
    expected = np.exp(-0.5 * np.einsum("ij,ijk,ik->i", error, np.linalg.inv(S), error)) / np.sqrt(np.linalg.det(S))
    expected[expected < MODEL.particles.particle_prune * expected.mean()] = 0.0
    detections = detections_at(np.stack((pixel, pixel + 3.0)), ids=[UNASSOCIATED, 1], R=np.stack((R_PAPER, R)))
    match_by_id(sight_of(belief), detections)
    belief.state.frame = 5
    follow_rays(CAMERA, MODEL, belief, NO_BOXES, detections, True)
    assert detections["match"].tolist() == [NEW, 1]
    assert (ray.seen, ray.misses) == (5, 0)
    np.testing.assert_allclose(weights, expected / expected.sum(), rtol=1e-9, atol=1e-300)


def still_belief(scenario: Scenario = PAPER):
    """A belief without features, certain of its pose and at rest."""
    belief = support.prior_belief(scenario)
    belief.covariance[:12, :12] = np.diag([1e-8] * 12)
    return belief


def frame(belief, pixels, scenario: Scenario = PAPER):
    """Counters of one frame of a camera that stays."""
    models = models_of(replace(scenario, acceleration_std=1e-3, angular_acceleration_std=1e-3))
    detections = detections_at(pixels)
    predict(models.motion, belief, np.zeros(6), models.motion.dt, False)
    counts = use(models, belief, support.NO_FIDUCIALS, NO_BOXES, sight_of(belief), detections)
    initialise(models, belief, detections, counts)
    return counts


@pytest.mark.parametrize("initialisation, kind", [(BY_INVERSE_DEPTH, INVERSE_DEPTH), ("depth_particles", RAY)])
def test_a_feature_is_initialised_at_the_third_consecutive_detection(initialisation: str, kind: int) -> None:
    scenario, there = replace(PAPER, initialisation=initialisation), [[100.0, 100.0]]
    interrupted, belief = still_belief(scenario), still_belief(scenario)
    assert sum(frame(interrupted, pixels, scenario).initialised for pixels in (there, there, [], there, there)) == 0
    initialised = [frame(belief, there, scenario).initialised for _ in range(23)]
    assert initialised == [0, 0, 1] + [0] * 20  # no duplicate of what is known
    assert belief.feature[0].kind == kind and belief.state.initialised == 1
    assert frame(still_belief(scenario), there, replace(scenario, new_feature_detections=1)).initialised == 1


@pytest.mark.parametrize("kind, kept", [(INVERSE_DEPTH, False), (POINT, True)])
def test_a_feature_out_of_sight_is_deleted_if_it_is_no_point(kind: int, kept: bool) -> None:
    belief = still_belief()
    frames = round(PAPER.inverse_depth_memory / PAPER.frame_time)
    for _ in range(5):
        frame(belief, [[160.0, 120.0]])
    if kind == POINT:
        convert_to_point(belief, 0)
    belief.state.camera[3:7] = (0.0, 0.0, 1.0, 0.0)  # turned around
    assert sum(frame(belief, []).deletions for _ in range(frames)) == 0
    assert frame(belief, []).deletions == (0 if kept else 1)
    assert belief.state.count == int(kept)


def test_what_a_known_box_hides_is_not_expected() -> None:
    belief, _ = two_points()
    wall = np.array([[[-0.9, -1.0, 1.0], [-0.2, 1.0, 1.1]]])  # before the second
    assert sight_of(belief, boxes=wall).point["id"].tolist() == [1]
    assert sight_of(belief).point["id"].tolist() == [1, 2]
    sight = sight_of(belief, boxes=wall)
    use(models_of(PAPER), belief, support.NO_FIDUCIALS, wall, sight, detections_at([]))
    assert belief.feature["misses"][:2].tolist() == [1, 0]
