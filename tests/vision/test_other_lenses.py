"""Calibrations of OpenCV, ROS, Kalibr and COLMAP are read, and equation 1 is fitted to their lenses."""

from pathlib import Path

import numpy as np
import pytest

cv2 = pytest.importorskip("cv2", reason="the extra `vision` is not installed")

from activeslam_gym.camera import camera_of, pixel_from_camera_point
from activeslam_gym.config import Scenario
from activeslam_gym.vision.other_lenses import Lens, fitted, lens_from, projected_by, straightening

MATRIX = np.array(((500.0, 0.0, 310.0), (0.0, 502.0, 245.0), (0.0, 0.0, 1.0)))
RADIAL, FISHEYE = (0.05, -0.02, 0.001, -0.0005), (0.01, -0.003, 0.001, 0.0)


@pytest.mark.parametrize("fisheye", [False, True])
def test_the_residual_is_what_the_pixels_of_points_differ_by(fisheye: bool) -> None:
    lens = Lens((640, 480), fisheye, MATRIX, np.array(FISHEYE if fisheye else RADIAL))
    found, typical, greatest = fitted(lens, "here")
    points = np.random.default_rng(0).uniform((-0.5, -0.4, 1.0), (0.5, 0.4, 1.0), (200, 3))
    project = cv2.fisheye.projectPoints if fisheye else cv2.projectPoints
    theirs = project(points[:, None], np.zeros(3), np.zeros(3), MATRIX, lens.coefficients)[0].reshape(-1, 2)
    camera, ours = camera_of(Scenario(**found._asdict())), np.empty((200, 2))
    for point, pixel in zip(points, ours):
        assert pixel_from_camera_point(camera, (-point[0], -point[1], point[2]), pixel)  # x left, y up
    away = np.hypot(*(ours - theirs).T)
    assert away.max() < 1.2 * greatest and 0.3 * typical < np.sqrt(np.mean(away**2)) < 2.0 * typical
    assert typical < 2.0


def test_a_lens_of_equation_1_is_found_to_the_last_digit(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "cameras.txt").write_text("1 SIMPLE_PINHOLE 320 240 195 160.5 120.5\n")
    found, _ = lens_from(tmp_path / "cameras.txt")
    np.testing.assert_allclose(found, (320, 240, 195.0, 160.0, 120.0, 0.0), atol=1e-9)
    assert "by 0.00 px" in capsys.readouterr().err


@pytest.mark.parametrize("fisheye", [False, True])
def test_images_are_mapped_to_equation_1_to_a_tenth_of_a_pixel(fisheye: bool) -> None:
    lens = Lens(
        (640, 480), fisheye, MATRIX, np.array((-0.25, 0.08, 0.0, 0.0) if fisheye else (-0.3, 0.1, 0.002, 0.001))
    )
    calibration, _, greatest = fitted(lens, "here")
    assert greatest > 1.0  # or there would be nothing to map
    straighten, camera = straightening(lens, calibration), camera_of(Scenario(**calibration._asdict()))
    for x, y in np.random.default_rng(0).uniform((-0.45, -0.35), (0.45, 0.35), (30, 2)):
        ours, theirs = np.empty(2), projected_by(lens, np.array((x, y)))
        assert pixel_from_camera_point(camera, (-x, -y, 1.0), ours)
        v, u = np.mgrid[:480, :640]
        spot = 200.0 * np.exp(-0.5 * ((u - theirs[0]) ** 2 + (v - theirs[1]) ** 2) / 3.0**2)
        _, image = straighten((0.0, np.rint(spot).astype(np.uint8)))
        bright = image * (image > 8.0)
        there = np.array(((bright * u).sum(), (bright * v).sum())) / bright.sum()
        np.testing.assert_allclose(there, ours, atol=0.1)


@pytest.mark.parametrize(("model", "k1", "seen"), [("OPENCV", -0.4, 42.0), ("OPENCV_FISHEYE", -0.35, 56.0)])
def test_of_a_lens_that_folds_nothing_is_shown_twice(
    model: str, k1: float, seen: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "cameras.txt").write_text(f"1 {model} 640 480 520 520 320.5 240.5 {k1} 0 0 0\n")
    calibration, straighten = lens_from(tmp_path / "cameras.txt")
    assert f"black beyond {seen:.0f} degrees" in capsys.readouterr().err
    v, u = np.mgrid[:480, :640]
    darker = np.rint(250.0 - 0.5 * np.hypot(u - 320.0, v - 240.0)).astype(np.uint8)
    image = straighten((0.0, darker))[1].astype(int)
    assert image[0, 0] == 0 and image[240, 320] == 250
    around, out = np.linspace(0.0, 2.0 * np.pi, 90), np.arange(230.0)[:, None]
    rays = image[np.rint(240.0 + out * np.sin(around)).astype(int), np.rint(320.0 + out * np.cos(around)).astype(int)]
    assert (np.diff(rays, axis=0) <= 1).all()


def test_skew_moves_the_pixels() -> None:
    skewed = MATRIX + np.array(((0.0, 7.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
    for fisheye in (False, True):
        moved = [
            projected_by(Lens((640, 480), fisheye, m, np.zeros(4)), np.array((0.0, 0.3))) for m in (skewed, MATRIX)
        ]
        assert moved[0][0] - moved[1][0] == pytest.approx(7.0 * (np.arctan(0.3) if fisheye else 0.3))


def test_a_fisheye_that_looks_aside_is_straightened(tmp_path: Path) -> None:
    (tmp_path / "cameras.txt").write_text("1 OPENCV_FISHEYE 848 800 285 286 424.5 400.5 -0.01 0.02 -0.03 0.01\n")
    calibration, straighten = lens_from(tmp_path / "cameras.txt")
    assert straighten((0.0, np.full((800, 848), 200, np.uint8)))[1].min() == 200
    assert calibration.distortion > 2e-6
