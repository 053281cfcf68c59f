"""Errors, NEES and trajectory files."""

from pathlib import Path

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from activeslam_gym.linalg import cholesky_in_place
from activeslam_gym.metrics import camera_error, log2_normal_of_factor, nees, write_tum
from tests.support import moved, random_camera, random_spd


def test_camera_error_is_the_tangent_vector_and_nees_its_quadratic_form() -> None:
    rng = np.random.default_rng(0)
    camera, e, P = random_camera(rng), 0.1 * rng.standard_normal(12), random_spd(rng, [1.0] * 12)
    np.testing.assert_allclose(camera_error(moved(camera, e), camera), e, atol=1e-14)
    assert nees(e, P) == pytest.approx(e @ np.linalg.solve(P, e))
    assert nees(e, -P) == np.inf
    whole = np.array([1, 2]), np.array([[4, 1], [1, 3]])
    assert nees(*whole) == pytest.approx(15.0 / 11.0)
    with pytest.raises(ValueError, match=r"error must be \(n,\)"):
        nees(np.ones(3), np.eye(2))


def test_factor_is_numpys_and_the_log_density_the_normal_distributions() -> None:
    for n in (1, 2, 3, 4, 5, 11, 12, 93):
        P = random_spd(np.random.default_rng(n), np.geomspace(1e-3, 1.0, n))
        U = P.copy()
        assert cholesky_in_place(U)
        np.testing.assert_allclose(np.triu(U).T, np.linalg.cholesky(P), rtol=1e-9, atol=1e-15)
        P[n // 2, n // 2] = -1.0
        assert not cholesky_in_place(P)
    rng = np.random.default_rng(2)
    e, P = rng.standard_normal(6), random_spd(rng, [1.0] * 6)
    U = P.copy()
    assert cholesky_in_place(U)
    for n in (6, 4):  # a factor's leading block is the marginal's
        expected = multivariate_normal(cov=P[:n, :n]).logpdf(e[:n]) / np.log(2.0)
        assert log2_normal_of_factor(e[:n].copy(), U) == pytest.approx(expected)


def test_tum_file_has_time_position_and_scalar_last_quaternion(tmp_path: Path) -> None:
    target = tmp_path / "run.tum"
    write_tum(target, np.array([0.5]), np.array([[1.0, 2.0, 3.0]]), np.array([[0.5, 0.1, 0.2, 0.3]]))
    np.testing.assert_allclose(np.loadtxt(target), [0.5, 1, 2, 3, 0.1, 0.2, 0.3, 0.5])
    assert [path.name for path in tmp_path.iterdir()] == ["run.tum"]
    with pytest.raises(ValueError, match=r"positions and quaternions must be \(2, 3\) and \(2, 4\)"):
        write_tum(target, np.zeros(2), np.zeros((1, 3)), np.zeros((1, 4)))
