"""Images of other sizes, lenses and rates: settings are angles and seconds, and the search is at one level."""

from itertools import count

import numpy as np
import pytest

cv2 = pytest.importorskip("cv2", reason="the extra `vision` is not installed")

from activeslam_gym.vision.calibration import Calibration
from activeslam_gym.vision.settings import scale_of
from activeslam_gym.vision.track import follow
from activeslam_gym.vision.views import reduced
from tests.vision_scene import LENS, begun, image_from, path

IMAGES = [image_from(pose, samples=2) for pose in path(12)]


def enlarged(lens: Calibration, n: int) -> Calibration:
    """The lens of images with n x n pixels for each."""
    middle = ((at + 0.5) * n - 0.5 for at in lens[3:5])
    return Calibration(n * lens[0], n * lens[1], n * lens.focal_px, *middle, lens.distortion / n**2)


@pytest.mark.parametrize(("focal", "side", "scale"), [(440.0, 320, 1), (880.0, 640, 2), (393.0, 480, 2), (1e9, 640, 2)])
def test_an_image_of_a_narrow_lens_keeps_room_for_features(focal: float, side: int, scale: int) -> None:
    assert scale_of(focal, side) == scale


def test_a_reduced_image_is_the_mean_of_its_pixels_and_cuts_what_is_left_over() -> None:
    image = np.arange(5 * 7, dtype=np.uint8).reshape(5, 7) * 4
    np.testing.assert_array_equal(reduced(image, 2), image[:4, :6].reshape(2, 2, 3, 2).mean(axis=(1, 3)))
    assert reduced(image, 1) is image


def test_a_small_image_is_enlarged_about_the_same_rays_and_tracked() -> None:
    assert scale_of(131.0, 160) == scale_of(300.0, 239) == 0.5 and scale_of(131.0, 240) == 1
    lens, small = LENS.reduced(2), [reduced(image, 2) for image in IMAGES]
    assert lens.scale == 0.5 and lens.reduced(0.5) == pytest.approx(LENS)
    found = follow(zip(count(0.0, 1 / 30), small), lens, None, 30.0)
    large = follow(zip(count(0.0, 1 / 30), IMAGES), LENS, None, 30.0)
    assert not found.lost.any() and found.filter.camera.width == LENS.image_width
    np.testing.assert_allclose(found.cameras[:, :7], large.cameras[:, :7], atol=0.02)


def test_larger_images_of_the_same_scene_are_tracked_alike() -> None:
    small = follow(zip(count(0.0, 1 / 30), IMAGES), LENS, None, 30.0)
    found = []
    for n in (2, 4):
        large = [image.repeat(n, axis=0).repeat(n, axis=1) for image in IMAGES]
        found.append(follow(zip(count(0.0, 1 / 30), large), enlarged(LENS, n), None, 30.0))
        assert found[-1].filter.camera.width == LENS.image_width and not found[-1].lost.any()
    np.testing.assert_allclose(found[1].cameras, found[0].cameras, atol=1e-7)
    np.testing.assert_allclose(found[0].cameras[:, :7], small.cameras[:, :7], atol=0.02)


def test_the_searches_are_told_in_the_pixels_of_the_image() -> None:
    told = []
    for n in (1, 2):
        front_end = begun(IMAGES[0].repeat(n, axis=0).repeat(n, axis=1), enlarged(LENS, n))
        front_end.step(IMAGES[1].repeat(n, axis=0).repeat(n, axis=1), 1 / 30)
        told.append(front_end.searched)
    small, double = told
    np.testing.assert_allclose(double.pixel, 2.0 * (small.pixel + 0.5) - 0.5, atol=1e-4)
    np.testing.assert_allclose(double.covariance, 4.0 * small.covariance, rtol=1e-4)
