"""Equation 1: which way is which, that back-projection undoes it, and what is refused."""

import itertools

import numpy as np
import pytest

from activeslam_gym import camera
from activeslam_gym.config import Scenario
from activeslam_gym.geometry import rotation_matrix
from tests.support import CAMERA, NO_BOXES, pixel_of, random_camera


def project(x: float, y: float, z: float) -> np.ndarray:
    pixel = np.full(2, np.nan)
    assert camera.pixel_from_camera_point(CAMERA, np.array([x, y, z]), pixel)
    return pixel


def test_left_is_left_up_is_up_and_the_view_is_wide() -> None:
    """Camera axes are x left, y up; u runs to the right, v downwards; the optical axis meets the principal point."""
    np.testing.assert_array_equal(project(0.0, 0.0, 2.0), [162.0, 125.0])
    assert project(0.5, 0.0, 2.0)[0] < 162.0 and project(0.0, 0.5, 2.0)[1] < 125.0
    u_c, v_c = 195.0 * 0.5 / 2.0, 195.0 * -0.25 / 2.0
    root = np.sqrt(1.0 + 1.8e-5 * (u_c**2 + v_c**2))
    np.testing.assert_allclose(project(0.5, -0.25, 2.0), [162.0 - u_c / root, 125.0 - v_c / root], rtol=1e-15)
    for a, b, degrees in (((0, 125), (320, 125), 96), ((162, 0), (162, 240), 71)):
        one, other = (camera.ray_from_pixel(CAMERA, np.array(pixel, float)) for pixel in (a, b))
        cosine = one @ other / np.linalg.norm(one) / np.linalg.norm(other)
        assert np.degrees(np.arccos(cosine)) == pytest.approx(degrees, abs=1)


def test_projection_and_back_projection_are_inverse_over_the_whole_image() -> None:
    for pixel in itertools.product(np.linspace(0.0, 320.0, 65), np.linspace(0.0, 240.0, 49)):
        ray = camera.ray_from_pixel(CAMERA, np.array(pixel))
        assert max(np.abs(project(*(depth * ray)) - pixel).max() for depth in (0.1, 1.0, 30.0)) < 1e-9
    p_C = np.array([-0.7, 0.4, 1.3])
    np.testing.assert_allclose(camera.ray_from_pixel(CAMERA, project(*p_C)), p_C / p_C[2], atol=1e-13)
    assert np.isfinite(camera.ray_from_pixel(CAMERA, np.array([1000.0, -500.0]))).all()  # beyond infinity's image


def test_a_pincushion_bends_outwards_and_has_its_inverse_and_jacobian() -> None:
    lens, z, J = camera.camera_of(Scenario(distortion=-4e-6)), np.empty(2), np.empty((2, 3))
    for pixel in itertools.product(np.linspace(0.0, 320.0, 9), np.linspace(0.0, 240.0, 7)):
        ray = camera.ray_from_pixel(lens, np.array(pixel))
        assert camera.pixel_from_camera_point(lens, 2.0 * ray, z) and np.abs(z - pixel).max() < 1e-9
        camera.pixel_jacobian(lens, ray, J)
        np.testing.assert_allclose(J @ camera.ray_jacobian(lens, np.array(pixel)), np.eye(2), atol=1e-9)
    assert not camera.pixel_from_camera_point(lens, np.array([3.0, 0.0, 1.0]), z)  # K_d u_c^2 < -1


def test_nothing_is_seen_behind_or_nearer_than_the_minimum_depth() -> None:
    pixel, pose, z = np.array([1.0, 2.0]), np.array([0.0, 0, 0, 1, 0, 0, 0]), np.empty(2)
    for depth in (0.0, -1.0):
        assert not camera.pixel_from_camera_point(CAMERA, np.array([0.1, 0.1, depth]), pixel)
        np.testing.assert_array_equal(pixel, [1.0, 2.0])
    for depth, expected in ((0.99, False), (1.01, True)):
        y = np.array([0.0, 0.0, depth * CAMERA.minimum_depth])
        assert camera.visible(camera.View(CAMERA, pose, np.eye(3)), y, 0.0, z) == expected


CUBE = np.array([[[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]]])


@pytest.mark.parametrize(
    ("p", "y", "expected"),
    [
        pytest.param((0, 0, 2), (0, 0, 3), False, id="box behind the camera"),
        pytest.param((0, 1, -3), (0, 1, 3), False, id="along a face"),
        pytest.param((0, 1.5, 0), (1.5, 0, 0), True, id="through an edge"),
        pytest.param((0, 0, -3), (0.3, 0.4, -1), False, id="on the near face"),
        pytest.param((0, 0, -3), (0.3, 0.4, 1), True, id="on the far face"),
        pytest.param((0, 0, 0), (0, 0, 0.5), True, id="both inside"),
    ],
)
def test_a_box_hides_what_is_behind_it(p: tuple, y: tuple, expected: bool) -> None:
    p, y = np.array(p, float), np.array(y, float)
    elsewhere = np.array([[[8.0, 8.0, 8.0], [9.0, 9.0, 9.0]]])
    for boxes in (CUBE, np.concatenate((elsewhere, CUBE))):
        assert camera.hidden(boxes, p, y) is camera.hidden(boxes, y, p) is expected
    assert not camera.hidden(NO_BOXES, p, y)


def test_hidden_is_what_sampling_along_the_way_says() -> None:
    """Of random boxes and ways, but for the few that only graze a corner; and it is the same from both ends."""
    rng, t, found = np.random.default_rng(0), np.linspace(0.0, 1.0, 4001)[:, None], []
    for _ in range(400):
        boxes = np.sort(rng.uniform(-1.0, 1.0, (rng.integers(1, 3), 2, 3)), axis=1)
        p, y = rng.uniform(-1.5, 1.5, (2, 3))
        way = (p + t * (y - p))[:, None]
        share = ((boxes[:, 0] < way) & (way < boxes[:, 1])).all(axis=2).sum(axis=0).max()
        assert camera.hidden(boxes, p, y) == camera.hidden(boxes, y, p)
        assert camera.hidden(boxes, p, y) or share == 0
        if share != 0 or not camera.hidden(boxes, p, y):
            found.append(share > 0)
    assert len(found) > 395 and 50 < sum(found) < 350


@pytest.mark.parametrize("seed", range(20))
def test_visible_is_in_front_inside_the_image_and_not_hidden(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pose, y, z = random_camera(rng), rng.uniform(-3.0, 3.0, 3), np.empty(2)
    R_WC, box = rotation_matrix(pose[3:7]), np.sort(rng.uniform(-3.0, 3.0, (1, 2, 3)), axis=1)
    view, size = camera.View(CAMERA, pose, R_WC), (CAMERA.width, CAMERA.height)
    for margin in (-30.0, 0.0, 50.0, 1e9):
        inside = camera.camera_point(R_WC, pose, y)[2] >= CAMERA.minimum_depth
        if inside:
            pixel = pixel_of(CAMERA, pose, y)
            inside = bool(((-margin <= pixel) & (pixel < np.add(size, margin))).all())
        assert camera.visible(view, y, margin, z) == inside
        assert camera.visible(view._replace(boxes=box), y, margin, z) == (inside and not camera.hidden(box, pose, y))
        if inside:
            np.testing.assert_allclose(z, pixel, atol=1e-12)
