"""Quaternions and so(3): the laws of the group, against scipy, and at the small angles where the formulas change."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from activeslam_gym import geometry as g

RNG = np.random.default_rng(0)
VECTORS = [RNG.uniform(-2.0, 2.0, 3) for _ in range(5)]
ANGLES = [0.0, 1e-12, 1e-7, 0.99e-4, 1.01e-4, 1e-2, 1.0, 3.0, np.pi - 1e-7]


def quaternion(seed: int) -> np.ndarray:
    return Rotation.random(random_state=seed).as_quat(scalar_first=True)


def matrix(q: np.ndarray) -> np.ndarray:
    return Rotation.from_quat(q, scalar_first=True).as_matrix()


def series(phi: np.ndarray, first: int) -> np.ndarray:
    """sum_n [phi]x^n / (n + first)!: Exp for 0, the left Jacobian for 1."""
    total, term = np.zeros((3, 3)), np.eye(3) / (1.0 if first == 0 else first)
    for n in range(1, 60):
        total += term
        term = term @ g.skew(phi) / (n + first)
    return total


def test_product_is_associative_and_multiplies_rotations() -> None:
    a, b, c = quaternion(1), quaternion(2), quaternion(3)
    left = g.quaternion_product(g.quaternion_product(a, b), c)
    np.testing.assert_allclose(left, g.quaternion_product(a, g.quaternion_product(b, c)), atol=1e-15)
    np.testing.assert_allclose(g.rotation_matrix(left), matrix(a) @ matrix(b) @ matrix(c), atol=1e-14)


def test_identity_and_inverse() -> None:
    one, q = np.array([1.0, 0, 0, 0]), quaternion(4)
    np.testing.assert_allclose(g.quaternion_product(one, q), q)
    np.testing.assert_allclose(g.quaternion_product(q * [1, -1, -1, -1], q), one, atol=1e-15)


@pytest.mark.parametrize("seed", range(4))
def test_rotation_matrix_is_scipys(seed: int) -> None:
    np.testing.assert_allclose(g.rotation_matrix(quaternion(seed)), matrix(quaternion(seed)), atol=1e-14)


@pytest.mark.parametrize("angle", ANGLES)
def test_exponentials_agree_at_every_angle(angle: float) -> None:
    phi = angle * np.array([2.0, -1.0, 2.0]) / 3.0
    R = expm(g.skew(phi))
    np.testing.assert_allclose(g.so3_exp(phi), R, atol=1e-14)
    np.testing.assert_allclose(g.rotation_matrix(g.quaternion_exp(phi)), R, atol=1e-14)


@pytest.mark.parametrize("angle", ANGLES)
def test_left_jacobian_is_its_series_at_every_angle(angle: float) -> None:
    phi = angle * np.array([2.0, -1.0, 2.0]) / 3.0
    np.testing.assert_allclose(g.so3_left_jacobian(phi), series(phi, 1), atol=1e-11)


@pytest.mark.parametrize("phi", VECTORS)
def test_left_jacobian_is_exp_times_the_right_one(phi: np.ndarray) -> None:
    """J_l(phi) = Exp(phi) J_l(-phi)."""
    np.testing.assert_allclose(g.so3_left_jacobian(phi), g.so3_exp(phi) @ g.so3_left_jacobian(-phi), atol=1e-13)


@pytest.mark.parametrize("angle", ANGLES)
def test_rotation_error_undoes_a_left_rotation(angle: float) -> None:
    phi, q = angle * np.array([1.0, 2.0, -2.0]) / 3.0, quaternion(7)
    np.testing.assert_allclose(g.rotation_error(g.rotate_left(phi, q), q), phi, atol=1e-13)


def test_rotation_error_takes_the_shorter_way_round() -> None:
    q = quaternion(8)
    np.testing.assert_allclose(g.rotation_error(-q, q), 0.0, atol=1e-15)
    turned = g.rotate_left(np.array([0.0, 2.0 * np.pi - 0.1, 0.0]), q)
    np.testing.assert_allclose(g.rotation_error(turned, q), [0.0, -0.1, 0.0], atol=1e-13)


def test_left_rotation_keeps_the_norm() -> None:
    q = quaternion(9) * (1.0 + 1e-6)
    for phi in VECTORS:
        q = g.rotate_left(phi, q)
        assert np.linalg.norm(q) == pytest.approx(1.0, abs=1e-15)


def test_skew_is_the_cross_product() -> None:
    np.testing.assert_allclose(g.skew(VECTORS[0]) @ VECTORS[1], np.cross(VECTORS[0], VECTORS[1]))
