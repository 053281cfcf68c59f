"""Calibrations of OpenCV, ROS, Kalibr and COLMAP are read, and equation 1 is fitted to their lenses."""

import re
from pathlib import Path

import numpy as np
import pytest

cv2 = pytest.importorskip("cv2", reason="the extra `vision` is not installed")

from activeslam_gym.camera import camera_of, pixel_from_camera_point  # noqa: E402
from activeslam_gym.config import Scenario  # noqa: E402
from activeslam_gym.vision.other_lenses import (  # noqa: E402
    Lens,
    _projected,
    fitted,
    lens_from,
    read_lens,
    straightening,
)

MATRIX = np.array(((500.0, 0.0, 310.0), (0.0, 502.0, 245.0), (0.0, 0.0, 1.0)))
RADIAL, FISHEYE = (0.05, -0.02, 0.001, -0.0005), (0.01, -0.003, 0.001, 0.0)


def opencv_yaml(path: Path, coefficients: tuple[float, ...]) -> None:
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for side, length in (("width", 640), ("height", 480)):
        file.write(f"image_{side}", length)
    file.write("camera_matrix", MATRIX)
    file.write("distortion_coefficients", np.array(coefficients))
    file.release()


TEXTS = {
    "ros": "image_width: 640\nimage_height: 480\ncamera_name: a\ncamera_matrix:\n  rows: 3\n  cols: 3\n"
    "  data: [500, 0, 310, 0, 502, 245, 0, 0, 1]\ndistortion_model: plumb_bob\ndistortion_coefficients:\n  rows: 1\n"
    "  cols: 5\n  data: [0.05, -0.02, 0.001, -0.0005, 0]\n",
    "kalibr": "cam0:\n  camera_model: pinhole\n  distortion_coeffs: [0.01, -0.003, 0.001, 0.0]\n"
    "  distortion_model: equidistant\n  intrinsics: [500, 502, 310, 245]\n  resolution: [640, 480]\n  rostopic: /a\n",
    "colmap": "# Camera list\n1 OPENCV 640 480 500 502 310.5 245.5 0.05 -0.02 0.001 -0.0005\n",
    "colmap-fisheye": "2 OPENCV_FISHEYE 640 480 500 502 310.5 245.5 0.01 -0.003 0.001 0\n",
}


@pytest.mark.parametrize("name", ["opencv", *TEXTS])
def test_the_same_lens_is_read_from_every_program(name: str, tmp_path: Path) -> None:
    path = tmp_path / "lens.yaml"
    if name == "opencv":
        opencv_yaml(path, RADIAL)
    else:
        path.write_text(TEXTS[name])
    lens = read_lens(path)
    assert lens.size == (640, 480) and lens.fisheye == (name in ("kalibr", "colmap-fisheye"))
    np.testing.assert_allclose(lens.matrix, MATRIX)
    np.testing.assert_allclose(lens.coefficients[:4], FISHEYE if lens.fisheye else RADIAL)


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
        ours, theirs = np.empty(2), _projected(lens, np.array((x, y)))
        assert pixel_from_camera_point(camera, (-x, -y, 1.0), ours)
        v, u = np.mgrid[:480, :640]
        spot = 200.0 * np.exp(-0.5 * ((u - theirs[0]) ** 2 + (v - theirs[1]) ** 2) / 3.0**2)
        _, image = straighten((0.0, np.rint(spot).astype(np.uint8)))
        bright = image * (image > 8.0)
        there = np.array(((bright * u).sum(), (bright * v).sum())) / bright.sum()
        np.testing.assert_allclose(there, ours, atol=0.1)


WRONG = (
    *("", "%YAML:1.0\n", "1 OPENCV 640 480 500 502\n", TEXTS["colmap"].replace("0.05", "900")),
    *(TEXTS["kalibr"].replace("310, ", ""), TEXTS["ros"].replace("502", "nan")),
)


@pytest.mark.parametrize("text", WRONG)
def test_what_is_no_lens_is_told_with_the_file(text: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    with pytest.raises(ValueError, match=re.escape(str(path))):
        lens_from(path)


CHAIN = TEXTS["kalibr"].replace("[0.01, -0.003, 0.001, 0.0]", str(list(RADIAL))).replace("equidistant", "radtan")
REST = TEXTS["kalibr"].replace("cam0", "cam1")


@pytest.mark.parametrize("text", [CHAIN, CHAIN + REST, REST + CHAIN, "# camera_model: equidistant\n" + CHAIN])
def test_the_model_of_another_camera_or_of_a_comment_is_not_taken(text: str, tmp_path: Path) -> None:
    (tmp_path / "chain.yaml").write_text(text)
    lens = read_lens(tmp_path / "chain.yaml")
    assert not lens.fisheye
    np.testing.assert_allclose(lens.coefficients, RADIAL)


def test_the_model_and_the_size_may_stand_outside_of_the_camera(tmp_path: Path) -> None:
    inside = "left:\n  K: [500, 0, 310, 0, 502, 245, 0, 0, 1]\n  D: [0.01, -0.003, 0.001, 0.0]\n"
    (tmp_path / "rig.yaml").write_text("image_width: 640\nimage_height: 480\ndistortion_model: fisheye\n" + inside)
    lens = read_lens(tmp_path / "rig.yaml")
    assert lens.fisheye and lens.size == (640, 480)


@pytest.mark.parametrize(
    ("text", "word"),
    [
        (CHAIN.replace("pinhole", "omni"), "omni"),
        (CHAIN.replace("radtan", "fov"), "fov"),
        (TEXTS["ros"].replace("[500, 0,", "[500, 7,"), "skew"),
        (TEXTS["ros"].replace("245, 0, 0, 1]", "245, 0, 0, 2]"), "camera_matrix"),
        ("model_type: MEI\n" + TEXTS["ros"], "MEI|mei"),
        ("xi: 1.2\n" + TEXTS["ros"], "xi"),
        ("# a comment\n\n1 FOV 640 480 500 500 320 240 0.9\n" + TEXTS["colmap"], "FOV"),
        (TEXTS["ros"].replace("image_width: 640", "image_width: inf"), "infinity"),
        ("[" * 5000, "YAML"),
    ],
)
def test_a_lens_that_is_not_known_is_refused_by_name(text: str, word: str, tmp_path: Path) -> None:
    (tmp_path / "lens.yaml").write_text(text)
    with pytest.raises(ValueError, match=word):
        read_lens(tmp_path / "lens.yaml")
