"""Every analytic Jacobian against a numerical one."""

from collections.abc import Callable
from inspect import isfunction
from typing import NamedTuple

import numpy as np
import pytest

from activeslam_gym.camera import View, pixel_jacobian, ray_from_pixel, ray_jacobian
from activeslam_gym.geometry import quaternion_exp, rotation_error, rotation_matrix
from activeslam_gym.metrics import camera_error
from activeslam_gym.motion import motion_of, process_covariance, transition, transition_jacobian
from activeslam_gym.slam import belief as layout
from activeslam_gym.slam.belief import INVERSE_DEPTH, KIND_DIM, POINT, RAY
from activeslam_gym.slam.depth_particles import predict_rays
from activeslam_gym.slam.filter import filter_of
from activeslam_gym.slam.kalman import update_covariance
from activeslam_gym.slam.map import add_landmark
from activeslam_gym.slam.sight import inverse_depth_measurement, point_measurement
from tests import support
from tests.support import CAMERA, PAPER, joint_covariance, moved, numerical_jacobian, pixel_of, random_camera

MOTION = motion_of(PAPER, 1.0)
TOLERANCE = 1e-6
R_PAPER = CAMERA.pixel_std**2 * np.eye(2)


class Case(NamedTuple):
    """A function of a tangent vector e of ``size`` dimensions, and what the code says of its derivative at e = 0."""

    f: Callable[[np.ndarray], np.ndarray]
    analytic: np.ndarray
    step: float = 1e-3


def projection(rng: np.random.Generator) -> Case:
    p_C = np.array([rng.uniform(-1, 1), rng.uniform(-1, 1), rng.uniform(0.8, 3.0)])
    J = np.empty((2, 3))
    pixel_jacobian(CAMERA, p_C, J)
    at_origin = np.array([0.0, 0, 0, 1, 0, 0, 0] + [0] * 6)
    return Case(lambda e: pixel_of(CAMERA, at_origin, p_C + e), J)


def back_projection(rng: np.random.Generator) -> Case:
    z = rng.uniform([5, 5], [315, 235])
    return Case(lambda e: ray_from_pixel(CAMERA, z + e), ray_jacobian(CAMERA, z), 0.1)


def motion(rng: np.random.Generator, dt: float = MOTION.dt, push: float = 1.0) -> Case:
    x, u = random_camera(rng), push * rng.standard_normal(6)
    x_new = transition(x, u, dt)
    return Case(lambda e: camera_error(transition(moved(x, e), u, dt), x_new), transition_jacobian(x_new[10:], dt))


def motion_of_a_fast_turn(rng: np.random.Generator) -> Case:
    """A second at once: the angle is no longer small."""
    return motion(rng, 1.0, 2.0)


def process_noise(rng: np.random.Generator) -> Case:
    """Q = G Sigma_u G^T with G by the accelerations: as a whole, through a square root of the numerical one."""
    x, u = random_camera(rng), rng.standard_normal(6)
    x_new = transition(x, u, MOTION.dt)
    F_x = transition_jacobian(x_new[10:], MOTION.dt)
    case = Case(lambda e: camera_error(transition(x, u + e, MOTION.dt), x_new), MOTION.dt * F_x[:, 6:], 1e-2)
    model = support.replaced(MOTION, filter_acceleration_std=0.5, filter_angular_acceleration_std=0.7)
    G = numerical_jacobian(case.f, 6, case.step)
    Q = G @ np.diag([0.5**2] * 3 + [0.7**2] * 3) @ G.T
    assert support.relative_error(process_covariance(model, F_x, MOTION.dt), Q) < TOLERANCE
    return case


def recentring(rng: np.random.Generator) -> Case:
    """dtheta+ of Exp(dtheta) = Exp(dtheta+) Exp(phi) at dtheta = phi + e, read off P+ = J P J^T."""
    belief = support.random_belief(PAPER, [POINT, INVERSE_DEPTH], rng)
    P, phi = joint_covariance(belief), rng.uniform(-0.5, 0.5, 3)
    delta, J = np.concatenate((np.zeros(3), phi, np.zeros(len(P) - 6))), np.eye(len(P))
    update_covariance(belief, np.zeros((0, len(P))), delta)
    P_new, turn = joint_covariance(belief), quaternion_exp(phi)
    found = P_new[3:6, :3] @ np.linalg.inv(P[3:6, :3])
    case = Case(lambda e: rotation_error(quaternion_exp(phi + e), turn), found)
    J[3:6, 3:6] = numerical_jacobian(case.f, 3, case.step)
    assert support.relative_error(P_new, J @ P @ J.T) < TOLERANCE
    return case


def measurement(measure: Callable[..., bool], x: np.ndarray, y: np.ndarray) -> Case:
    """Of a pixel, which is checked, by the camera and the feature."""
    z, H_x, H_y = np.empty(2), np.empty((2, 6)), np.empty((2, len(y)))
    assert measure(View(CAMERA, x, rotation_matrix(x[3:7])), y, z, H_x, H_y)
    np.testing.assert_allclose(z, pixel_of(CAMERA, x, point_at(y)), atol=1e-9)
    return Case(lambda e: pixel_of(CAMERA, moved(x, e[:6]), point_at(y + e[6:])), np.hstack((H_x, H_y)))


def point(rng: np.random.Generator) -> Case:
    x = random_camera(rng)
    return measurement(point_measurement, x, support.world_points(rng, x, 1)[0])


def inverse_depth(rng: np.random.Generator) -> Case:
    belief = support.random_belief(PAPER, [INVERSE_DEPTH], rng)
    return measurement(inverse_depth_measurement, belief.state.camera, belief.feature[0].mean)


def far_inverse_depth(rng: np.random.Generator) -> Case:
    """A point a hundred metres away, where rho is almost zero."""
    belief = support.random_belief(PAPER, [INVERSE_DEPTH], rng)
    belief.feature[0].mean[5] = 0.01
    return measurement(inverse_depth_measurement, belief.state.camera, belief.feature[0].mean)


def point_at(feature: np.ndarray) -> np.ndarray:
    """anchor + m / rho, with the direction written out once more; a point is one."""
    if len(feature) == 3:
        return feature
    azimuth, elevation, rho = feature[3:6]
    m = [np.sin(azimuth) * np.cos(elevation), np.sin(elevation), np.cos(azimuth) * np.cos(elevation)]
    return feature[:3] + np.array(m) / rho


def bearing(rng: np.random.Generator) -> Case:
    angles = rng.uniform([-3, -1.4], [3, 1.4])
    return Case(lambda e: np.array(layout.bearing(*(angles + e))[0]), np.array(layout.bearing(*angles)[1:]).T)


def angles_of(rng: np.random.Generator) -> Case:
    h, J, unused = rng.standard_normal(3), np.empty((2, 3)), np.empty((2, 3))
    angles = layout.angles_of(h, J)
    np.testing.assert_allclose(layout.bearing(*angles)[0], h / np.linalg.norm(h), atol=1e-14)
    assert np.isfinite(layout.angles_of(np.array([0.0, 1.0, 0.0]), unused)).all() and np.isfinite(unused).all()
    return Case(lambda e: np.array(layout.angles_of(h + e, unused)), J, 1e-4)


def conversion_of_a_ray(rng: np.random.Generator) -> Case:
    return conversion(RAY, rng)


def conversion_of_inverse_depth(rng: np.random.Generator) -> Case:
    return conversion(INVERSE_DEPTH, rng)


def conversion(kind: int, rng: np.random.Generator) -> Case:
    belief = support.random_belief(support.scenario_for([kind]), [kind], rng)
    width, feature = KIND_DIM[kind], belief.feature[0]
    T, unused, mean = np.empty((3, 6)), np.empty((3, 6)), feature.mean.copy()
    layout.point_of(belief, 0, T)

    def f(e: np.ndarray) -> np.ndarray:
        feature.mean[:width] = mean[:width] + e
        return layout.point_of(belief, 0, unused)

    return Case(f, T[:, :width])


def new_feature_by_camera(rng: np.random.Generator) -> Case:
    """dy/dx of an initialisation, read off the cross-covariance: P_yx = J P_xx."""
    x, pixel, P_xx = random_camera(rng), rng.uniform([20, 20], [300, 220]), support.random_spd(rng, [0.1] * 12)
    P = joint_covariance(initialised(x, pixel, P_xx))
    return Case(lambda e: new_mean(moved(x, e), pixel), P[12:, :12] @ np.linalg.inv(P_xx))


def new_feature_by_pixel(rng: np.random.Generator) -> Case:
    """What an initialisation adds of its own is J_z R J_z^T in the angles, with the pixel's own R, and sigma_rho^2."""
    x, pixel, R = random_camera(rng), rng.uniform([20, 20], [300, 220]), support.random_spd(rng, [2.0, 5.0])
    Q = joint_covariance(initialised(x, pixel, np.zeros((12, 12)), R))[12:, 12:]
    J_z = numerical_jacobian(lambda e: new_mean(x, pixel + e), 2, 0.1)
    np.testing.assert_allclose(Q[5, 5], PAPER.inverse_depth_std**2)
    Q[5, 5] = 0.0
    return Case(lambda e: J_z @ R @ J_z.T @ e, Q)


def initialised(x: np.ndarray, pixel: np.ndarray, P_xx: np.ndarray, R: np.ndarray = R_PAPER):
    belief, model = support.prior_belief(), filter_of(PAPER)
    belief.state.camera[:] = x
    belief.covariance[:12, :12] = P_xx
    assert add_landmark(CAMERA, model.initialisation, model.particles, belief, pixel, R) == 1
    return belief


def new_mean(x: np.ndarray, pixel: np.ndarray) -> np.ndarray:
    return initialised(x, pixel, np.zeros((12, 12))).feature[0].mean


CASES = [f for f in vars().copy().values() if isfunction(f) and [*f.__annotations__] == ["rng", "return"]]
"""Every function above from a generator to a case."""


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("make", CASES, ids=lambda case: case.__name__)
def test_jacobian_is_the_numerical_one(make: Callable[[np.random.Generator], Case], seed: int) -> None:
    case = make(np.random.default_rng(seed))
    numerical = numerical_jacobian(case.f, case.analytic.shape[1], case.step)
    assert support.relative_error(case.analytic, numerical) < TOLERANCE


@pytest.mark.parametrize("seed", range(4))
def test_ellipse_of_a_rays_particle_is_the_numerical_one(seed: int) -> None:
    """S = H P H^T + R of each particle, with H by the camera and the ray at the particle's depth."""
    belief = support.random_belief(support.scenario_for([RAY]), [POINT, RAY], np.random.default_rng(seed))
    feature, rays = belief.feature[1], predict_rays(CAMERA, belief, support.NO_BOXES).particle[0]
    P, at = joint_covariance(belief), support.rows_of(belief, 1)
    x, ray = belief.state.camera.copy(), feature.mean[:5].copy()
    for k in (0, 50, 99):
        depth = belief.particles[feature.slot, k, 0]

        def pixel(e: np.ndarray, depth: float = depth) -> np.ndarray:
            feature = np.append(ray + e[6:], 1.0 / depth)
            return pixel_of(CAMERA, moved(x, e[:6]), point_at(feature))

        H = np.zeros((2, len(P)))
        H[:, [*range(6), *at]] = numerical_jacobian(pixel, 11, 1e-3)
        np.testing.assert_allclose(rays["z_hat"][k], pixel(np.zeros(11)), atol=1e-9)
        assert support.relative_error(rays["S"][k], H @ P @ H.T + CAMERA.pixel_std**2 * np.eye(2)) < TOLERANCE
