"""Equation 1: which way is which, that back-projection undoes it, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from activeslam_gym.camera import camera_from_world, inside_image, pixel_from_camera_point, ray_from_pixel

from .support import CAMERA

CORNERS = [(0.0, 0.0), (320.0, 0.0), (0.0, 240.0), (320.0, 240.0)]


def project(x: float, y: float, z: float) -> np.ndarray:
    pixel = np.full(2, np.nan)
    assert pixel_from_camera_point(CAMERA, np.array([x, y, z]), pixel)
    return pixel


def test_optical_axis_meets_the_principal_point() -> None:
    np.testing.assert_array_equal(project(0.0, 0.0, 2.0), [162.0, 125.0])


def test_left_is_left_and_up_is_up() -> None:
    """Camera axes are x left, y up; u runs to the right, v downwards."""
    assert project(0.5, 0.0, 2.0)[0] < 162.0
    assert project(0.0, 0.5, 2.0)[1] < 125.0


def test_one_pixel_by_hand() -> None:
    u_c, v_c = 195.0 * 0.5 / 2.0, 195.0 * -0.25 / 2.0
    root = np.sqrt(1.0 + 1.8e-5 * (u_c**2 + v_c**2))
    np.testing.assert_allclose(project(0.5, -0.25, 2.0), [162.0 - u_c / root, 125.0 - v_c / root], rtol=1e-15)


def test_projection_and_back_projection_are_inverse_over_the_whole_image() -> None:
    worst = 0.0
    for u in np.linspace(0.0, 320.0, 65):
        for v in np.linspace(0.0, 240.0, 49):
            ray = ray_from_pixel(CAMERA, np.array([u, v]))
            for depth in (0.1, 1.0, 30.0):
                worst = max(worst, np.abs(project(*(depth * ray)) - (u, v)).max())
    assert worst < 1e-9


def test_back_projection_of_a_projected_point_is_its_line_of_sight() -> None:
    p_C = np.array([-0.7, 0.4, 1.3])
    np.testing.assert_allclose(ray_from_pixel(CAMERA, project(*p_C)), p_C / p_C[2], atol=1e-13)


def test_view_is_wide() -> None:
    """About 96 x 71 degrees."""

    def angle_between(a: tuple[float, float], b: tuple[float, float]) -> float:
        one, other = (ray_from_pixel(CAMERA, np.array(pixel)) for pixel in (a, b))
        cosine = one @ other / np.linalg.norm(one) / np.linalg.norm(other)
        return float(np.degrees(np.arccos(cosine)))

    assert angle_between((0, 125), (320, 125)) == pytest.approx(96, abs=1)
    assert angle_between((162, 0), (162, 240)) == pytest.approx(71, abs=1)


@pytest.mark.parametrize("depth", [0.0, -1.0])
def test_nothing_is_seen_behind(depth: float) -> None:
    pixel = np.array([1.0, 2.0])
    assert not pixel_from_camera_point(CAMERA, np.array([0.1, 0.1, depth]), pixel)
    np.testing.assert_array_equal(pixel, [1.0, 2.0])


def test_a_pixel_beyond_the_image_of_infinity_still_gives_a_finite_ray() -> None:
    assert np.isfinite(ray_from_pixel(CAMERA, np.array([1000.0, -500.0]))).all()


@pytest.mark.parametrize(
    ("pixel", "margin", "inside"),
    [
        ((0.0, 0.0), 0.0, True),
        ((319.9, 239.9), 0.0, True),
        ((320.0, 100.0), 0.0, False),
        ((100.0, 240.0), 0.0, False),
        ((-1.0, 100.0), 0.0, False),
        ((-1.0, 100.0), 2.0, True),
        ((1.0, 100.0), -2.0, False),
    ],
)
def test_inside_image(pixel: tuple[float, float], margin: float, inside: bool) -> None:
    assert inside_image(CAMERA, np.array(pixel), margin) is inside


def test_world_to_camera() -> None:
    R_WC = Rotation.from_rotvec([0.3, -1.2, 0.4]).as_matrix()
    v_W = np.array([1.0, 2.0, 3.0])
    np.testing.assert_allclose(camera_from_world(R_WC, v_W), R_WC.T @ v_W, atol=1e-15)
