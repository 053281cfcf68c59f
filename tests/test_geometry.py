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


def series(phi: np.ndarray) -> np.ndarray:
    """The left Jacobian, sum_n [phi]x^n / (n + 1)!."""
    total, term = np.zeros((3, 3)), np.eye(3)
    for n in range(1, 60):
        total += term
        term = term @ g.skew(phi) / (n + 1)
    return total


def test_product_is_a_groups_and_multiplies_rotations() -> None:
    a, b, c, one = quaternion(1), quaternion(2), quaternion(3), np.array([1.0, 0, 0, 0])
    left = g.quaternion_product(g.quaternion_product(a, b), c)
    np.testing.assert_allclose(left, g.quaternion_product(a, g.quaternion_product(b, c)), atol=1e-15)
    np.testing.assert_allclose(g.quaternion_product(one, a), a)
    np.testing.assert_allclose(g.quaternion_product(a * [1, -1, -1, -1], a), one, atol=1e-15)
    np.testing.assert_allclose(g.rotation_matrix(left), matrix(a) @ matrix(b) @ matrix(c), atol=1e-14)
    for q in map(quaternion, range(4)):
        np.testing.assert_allclose(g.rotation_matrix(q), matrix(q), atol=1e-14)
    np.testing.assert_allclose(g.skew(VECTORS[0]) @ VECTORS[1], np.cross(VECTORS[0], VECTORS[1]))


@pytest.mark.parametrize("angle", ANGLES)
def test_the_formulas_hold_at_every_angle(angle: float) -> None:
    """Exponentials are the matrix's, the left Jacobian is its series, the rotation error undoes a left rotation."""
    phi, q = angle * np.array([2.0, -1.0, 2.0]) / 3.0, quaternion(7)
    R = expm(g.skew(phi))
    np.testing.assert_allclose(g.so3_exp(phi), R, atol=1e-14)
    np.testing.assert_allclose(g.rotation_matrix(g.quaternion_exp(phi)), R, atol=1e-14)
    np.testing.assert_allclose(g.so3_left_jacobian(phi), series(phi), atol=1e-11)
    np.testing.assert_allclose(g.rotation_error(g.rotate_left(phi, q), q), phi, atol=1e-13)


def test_a_rotation_keeps_its_length_and_its_error_is_the_shorter_way_round() -> None:
    q = quaternion(9) * (1.0 + 1e-6)
    for phi in VECTORS:
        q = g.rotate_left(phi, q)
        assert np.linalg.norm(q) == pytest.approx(1.0, abs=1e-15)
    np.testing.assert_allclose(g.rotation_error(-q, q), 0.0, atol=1e-15)
    turned = g.rotate_left(np.array([0.0, 2.0 * np.pi - 0.1, 0.0]), q)
    np.testing.assert_allclose(g.rotation_error(turned, q), [0.0, -0.1, 0.0], atol=1e-13)
