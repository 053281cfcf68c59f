"""Calibrations of other programs are read to the last digit or refused by name, and equation 1 is fitted to them."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

cv2 = pytest.importorskip("cv2", reason="the extra `vision` is not installed")
pytest.importorskip("yaml", reason="the extra `vision` is not installed")

from activeslam_gym.camera import pixel_from_camera_point
from activeslam_gym.vision.lens_files import Lens, read_lens
from activeslam_gym.vision.other_lenses import Remap, fitted, lens_from, projected_by
from tests.vision_scene import LENS

MATRIX = np.array(((500.0, 0.0, 310.0), (0.0, 502.0, 245.0), (0.0, 0.0, 1.0)))
RADIAL, FISHEYE = "[0.05, -0.02, 0.001, -0.0005]", "[0.01, -0.003, 0.001, 0.0002]"


@pytest.mark.parametrize("fisheye", [False, True])
def test_the_residual_is_what_the_pixels_of_points_differ_by(fisheye: bool) -> None:
    lens = Lens((640, 480), fisheye, MATRIX, np.array(json.loads(FISHEYE if fisheye else RADIAL)))
    found, typical, greatest = fitted(lens, "here")
    points = np.random.default_rng(0).uniform((-0.5, -0.4, 1.0), (0.5, 0.4, 1.0), (200, 3))
    project = cv2.fisheye.projectPoints if fisheye else cv2.projectPoints
    theirs = project(points[:, None], np.zeros(3), np.zeros(3), MATRIX, lens.coefficients)[0].reshape(-1, 2)
    camera, ours = found.camera, np.empty((200, 2))
    for point, pixel in zip(points, ours):
        assert pixel_from_camera_point(camera, (-point[0], -point[1], point[2]), pixel)  # x left, y up
    away = np.hypot(*(ours - theirs).T)
    assert away.max() < 1.2 * greatest and 0.3 * typical < np.sqrt(np.mean(away**2)) < 2.0 * typical
    assert typical < 2.0


@pytest.mark.parametrize("f", [195.0, 8000.0])
def test_a_lens_of_equation_1_is_found_to_the_last_digit(f: float, tmp_path: Path, capsys) -> None:
    (tmp_path / "cameras.txt").write_text(f"1 SIMPLE_PINHOLE 320 240 {f} 160.5 120.5\n")
    found, _ = lens_from(tmp_path / "cameras.txt")
    np.testing.assert_allclose(found, (320, 240, f, 160.0, 120.0, 0.0), atol=1e-9)
    assert "by 0.00 px" in capsys.readouterr().err


@pytest.mark.parametrize(("fisheye", "fy"), [(False, 502.0), (True, 502.0), (False, 590.0)])
def test_images_are_mapped_to_equation_1_to_a_tenth_of_a_pixel(fisheye: bool, fy: float) -> None:
    bent = (-0.25, 0.08, 0.0, 0.0) if fisheye else (-0.3, 0.1, 0.002, 0.001)
    lens = Lens((640, 480), fisheye, MATRIX + np.diag((0.0, fy - 502.0, 0.0)), np.array(bent))
    calibration, _, greatest = fitted(lens, "here")
    assert greatest > 1.0  # or there would be nothing to map
    straighten, camera = Remap(lens, calibration), calibration.camera
    for x, y in np.random.default_rng(0).uniform((-0.45, -0.35), (0.45, 0.35), (30, 2)):
        ours, theirs = np.empty(2), projected_by(lens, np.array((x, y)))
        assert pixel_from_camera_point(camera, (-x, -y, 1.0), ours)
        np.testing.assert_allclose(straighten.pixels(theirs[None])[0], ours, atol=0.1)
        v, u = np.mgrid[:480, :640]
        spot = 200.0 * np.exp(-0.5 * ((u - theirs[0]) ** 2 + (v - theirs[1]) ** 2) / 3.0**2)
        _, image = straighten((0.0, np.rint(spot).astype(np.uint8)))
        bright = image * (image > 8.0)
        there = np.array(((bright * u).sum(), (bright * v).sum())) / bright.sum()
        np.testing.assert_allclose(there, ours, atol=0.1)


FOLDED = {
    42: "OPENCV 640 480 520 520 320.5 240.5 -0.4 0 0 0",
    56: "OPENCV_FISHEYE 640 480 520 520 320.5 240.5 -0.35 0 0 0",
    81: "OPENCV_FISHEYE 640 480 230 230 320.5 240.5 -0.02 0.01 -0.012 -0.003",
}


@pytest.mark.parametrize("seen", FOLDED)
def test_of_a_lens_that_folds_nothing_is_shown_twice(seen: int, tmp_path: Path, capsys) -> None:
    (tmp_path / "cameras.txt").write_text(f"1 {FOLDED[seen]}\n")
    calibration, straighten = lens_from(tmp_path / "cameras.txt")
    assert f"black beyond {seen} degrees" in capsys.readouterr().err
    v, u = np.mgrid[:480, :640]
    darker = np.rint(250.0 - 0.5 * np.hypot(u - 320.0, v - 240.0)).astype(np.uint8)
    image = straighten((0.0, darker))[1].astype(int)
    assert image[0, 0] == 0 and image[240, 320] == 250
    around, out = np.linspace(0.0, 2.0 * np.pi, 90), np.arange(230.0)[:, None]
    rays = image[np.rint(240.0 + out * np.sin(around)).astype(int), np.rint(320.0 + out * np.cos(around)).astype(int)]
    assert (np.diff(rays, axis=0) <= 1).all()


def test_a_file_of_calibrate_may_have_any_suffix_and_has_one_camera(tmp_path: Path) -> None:
    (tmp_path / "lens.cal").write_text(json.dumps(LENS._asdict()))
    assert lens_from(tmp_path / "lens.cal")[0] == LENS
    with pytest.raises(ValueError, match="--camera cam7 is not there; it holds 0"):
        lens_from(tmp_path / "lens.cal", "cam7")


def test_skew_moves_the_pixels() -> None:
    skewed = MATRIX + np.array(((0.0, 7.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
    for fisheye in (False, True):
        moved = [
            projected_by(Lens((640, 480), fisheye, m, np.zeros(4)), np.array((0.0, 0.3))) for m in (skewed, MATRIX)
        ]
        assert moved[0][0] - moved[1][0] == pytest.approx(7.0 * (np.arctan(0.3) if fisheye else 0.3))


K = "[500, 0, 310, 0, 502, 245, 0, 0, 1]"


def listed(numbers: str, zeros: int = 0) -> str:
    """Numbers as a block list of YAML, with so many zeros more."""
    return "".join(f"\n- {number}" for number in [*json.loads(numbers), *[0.0] * zeros])


KALIBR = "  camera_model: {}\n  distortion_model: {}\n  distortion_coeffs: {}\n  intrinsics: [500, 502, 310, 245]\n"
KALIBR += "  resolution: [640, 480]\n"
OTHER = KALIBR.format("pinhole", "equidistant", "[0.1, 0.2, 0.3, 0.4]")
EUROC = KALIBR.replace("\n  ", "\n")[2:].replace("coeffs", "coefficients")
ROS = "header: {{frame_id: a}}\nheight: 480\nwidth: 640\ndistortion_model: {}\nD: {}\nK: {}\n"
ROI = "binning_x: {}\nbinning_y: 0\nroi: {{x_offset: {}, y_offset: {}, height: {}, width: {}, do_rectify: false}}\n"
OPENCV = {"image_width": 640, "image_height": 480, "camera_matrix": {"rows": 3, "cols": 3, "data": json.loads(K)}}
OPENCV["distortion_coefficients"] = {"rows": 1, "data": [*json.loads(RADIAL), 0.0]}
XML = """<?xml version="1.0"?>
<opencv_storage><image_width>640</image_width><image_height>480</image_height>
<camera_matrix type_id="opencv-matrix"><rows>3</rows><data>500. 0. 310. 0. 502. 245. 0. 0. 1.</data></camera_matrix>
<distortion_coefficients><data>0.05 -0.02 0.001 -5e-4 0.</data></distortion_coefficients></opencv_storage>"""
CAMODOCAL = "%YAML:1.0\n---\nmodel_type: {}\nimage_width: 640\nimage_height: 480\n{}projection_parameters:\n{}"
BENT = "distortion_parameters:\n   k1: 0.05\n   k2: -0.02\n   p1: 0.001\n   p2: -0.0005\n"
FOUR = "   fx: 500\n   fy: 502\n   cx: 310\n   cy: 245\n"
KANNALA = "   k2: 0.01\n   k3: -0.003\n   k4: 0.001\n   k5: 0.0002\n   mu: 500\n   mv: 502\n   u0: 310\n   v0: 245\n"
SIZED = '%YAML:1.0\nFile.version: "1.0"\nCamera.type: "{}"\nCamera.width: 640\nCamera.height: 480\n'
ORB = SIZED.format("PinHole") + (FOUR + BENT.partition("\n")[2]).replace("   ", "Camera1.")
EIGHT = SIZED.format("KannalaBrandt8") + FOUR.replace("   ", "Camera.")
EIGHT += "Camera.k1: 0.01\nCamera.k2: -0.003\nCamera.k3: 0.001\nCamera.k4: 0.0002\n"
BASALT = (
    '{{"value0": {{"intrinsics": [{{"camera_type": "{}", "intrinsics": {{"fx": 500, "fy": 502, "cx": 310, "cy": 245, '
)
BASALT += '"k1": 0.01, "k2": -0.003, "k3": 0.001, "k4": 0.0002}}}}], "resolution": [[640, 480]], '
BASALT += '"calib_accel_bias": [0.0, 0.0]}}}}'
SIZE: dict[str, Any] = {"width": 640, "height": 480}
FX = SIZE | {"fx": 500, "fy": 502, "cx": 310, "cy": 245}
RADIAL_FILES = {
    "kalibr": "cam0:\n" + KALIBR.format("pinhole", "radtan", RADIAL),
    "kalibr, two models": f"cam0:\n{KALIBR.format('pinhole', 'radtan', RADIAL)}cam1:\n{OTHER}",
    "kalibr, out of order": f"cam1:\n{OTHER}cam0:\n{KALIBR.format('pinhole', 'radtan', RADIAL)}",
    "euroc": "sensor_type: camera\n" + EUROC.format("pinhole", "radial-tangential", RADIAL),
    "a comment": "# distortion_model: equidistant\n" + ROS.format("plumb_bob", RADIAL, K),
    "ros 1": ROS.format("plumb_bob", RADIAL.replace("]", ", 0.0]"), K) + ROI.format(0, 0, 0, 0, 0),
    "ros 2": ROS.replace("D:", "d:").replace("K:", "k:").format("plumb_bob", listed(RADIAL, 1), listed(K)),
    "ros, two messages": (ROS.format("plumb_bob", RADIAL, K) + "---\n") * 2,
    "ros, a region": ROS.replace("480", "600").replace("640", "800").format("plumb_bob", RADIAL, K)
    .replace("310", "330").replace("245", "255") + ROI.format(1, 20, 10, 480, 640),
    "fourteen": ROS.format("rational_polynomial", listed(RADIAL, 10), K),
    "opencv, JSON": json.dumps(OPENCV, indent="\t"),
    "opencv, interactive": json.dumps(
        {"cameraResolution": [640, 480], "cameraMatrix": MATRIX.tolist(), "cameraMatrix_std_dev": [[1.0]] * 4}
        | {"dist_coeffs": json.loads(RADIAL), "dist_coeffs_std_dev": [[0.1]] * 5}
    ),
    "opencv, XML": XML,
    "opencv, XML alone": XML.partition("\n")[2].replace("<camera_", "<fisheye_model>0</fisheye_model><camera_"),
    "opencv, tutorial": json.dumps(SIZE | {"mtx": MATRIX.tolist(), "dist": [[*json.loads(RADIAL), 0]]}),
    "cameras from 0": "".join(f"camera{k}:\n{KALIBR.format('pinhole', 'radtan', RADIAL)}" for k in (0, 1)),
    "no space, a comment first": "# mine\n%YAML:1.0\n---\n" + ROS.format("plumb_bob", RADIAL, K).replace("K: ", "K:"),
    "camodocal": CAMODOCAL.format("PINHOLE", BENT, FOUR),
    "orb-slam": ORB,
    "colmap": "# Camera list\n1 OPENCV 640 480 500 502 310.5 245.5 0.05 -0.02 0.001 -0.0005\n2 FOV 9 9 9 9 9 9 9\n",
}  # fmt: skip
FISHEYE_FILES = {
    "kalibr": "cam0:\n" + KALIBR.format("pinhole", "equidistant", FISHEYE),
    "ros, five numbers": ROS.format("equidistant", FISHEYE.replace("]", ", 0.0]"), K),
    "camodocal": CAMODOCAL.format("KANNALA_BRANDT", "", KANNALA),
    "orb-slam": EIGHT,
    "basalt": BASALT.format("kb4"),
    "a flag": json.dumps(FX | {"fisheye": True, "D": json.loads(FISHEYE)}),
    "a mask's flag": CAMODOCAL.format("KANNALA_BRANDT", "fisheye: 0\n", KANNALA),
    "a flag beside a pinhole": json.dumps(FX | {"model": "pinhole", "fisheye": True, "D": json.loads(FISHEYE)}),
    "gyroflow": json.dumps(SIZE | {"fisheye_params": {"camera_matrix": MATRIX.tolist(), "D": json.loads(FISHEYE)}}),
    "colmap": "2 OPENCV_FISHEYE 640 480 500 502 310.5 245.5 0.01 -0.003 0.001 0.0002\n",
}
FILES = [(False, name, text) for name, text in RADIAL_FILES.items()]
FILES += [(True, name, text) for name, text in FISHEYE_FILES.items()]


def lens_in(text: str, folder: Path, camera: str | None = None):
    """The lens in a file with this text."""
    (folder / "lens.yaml").write_text(text)
    return read_lens(folder / "lens.yaml", camera)


@pytest.mark.parametrize(("fisheye", "name", "text"), FILES, ids=[f"{n}{' fisheye' * f}" for f, n, _ in FILES])
def test_the_same_lens_is_read_from_every_program(fisheye: bool, name: str, text: str, tmp_path: Path) -> None:
    lens = lens_in(text, tmp_path)
    assert lens.size == (640, 480) and lens.fisheye == fisheye
    np.testing.assert_allclose(lens.matrix.ravel(), json.loads(K), rtol=1e-12)
    np.testing.assert_allclose(lens.coefficients, json.loads(FISHEYE if fisheye else RADIAL), rtol=1e-12)


def test_what_opencv_alone_can_hold_is_read(tmp_path: Path) -> None:
    skewed = lens_in(ROS.format("plumb_bob", RADIAL, K.replace("500, 0", "500, 0.0005")), tmp_path)
    assert skewed.matrix[0, 1] == 0.0005
    prism = lens_in(ROS.format("''", "[0.1, -0.05, 0, 0, 0.01, 0.2, -0.03, 0.004, 0.01, 0, 0, 0, 0, 0]", K), tmp_path)
    assert prism.coefficients.tolist() == [0.1, -0.05, 0.0, 0.0, 0.01, 0.2, -0.03, 0.004, 0.01, 0.0, 0.0, 0.0]
    assert lens_in("7 SIMPLE_RADIAL_FISHEYE 640 480 500 310 245 0.1", tmp_path).coefficients.tolist() == [0.1, 0, 0, 0]


@pytest.mark.parametrize("camera", ["cam1", "1"])
def test_a_camera_is_chosen_by_name_or_number(camera: str, tmp_path: Path) -> None:
    chain = RADIAL_FILES["kalibr, two models"]
    assert "cam0 of cam0, cam1" in lens_in(chain, tmp_path).note
    lens = lens_in(chain, tmp_path, camera)
    assert lens.fisheye and lens.coefficients.tolist() == [0.1, 0.2, 0.3, 0.4] and not lens.note
    assert lens_in(EIGHT + EIGHT[EIGHT.index("Camera.fx") :].replace("Camera", "Camera2"), tmp_path, "2").fisheye
    with pytest.raises(ValueError, match="--camera cam2 .* cam0, cam1"):
        lens_in(chain, tmp_path, "cam2")


@pytest.mark.parametrize(
    ("text", "word"),
    [
        *((KALIBR.format(model, "none", "[]"), model) for model in ("ds", "eucm", "omni")),
        (KALIBR.format("pinhole", "fov", "[0.9]"), "fov"),
        (KALIBR.format("pinhole", "none", RADIAL), "no distortion"),
        (KALIBR.format("pinhole", "radtan", RADIAL).replace("distortion_coeffs", "distorsion_coeffs"), "distorsion"),
        (KALIBR.format("fisheye", "radtan", RADIAL), "contradict"),
        (CAMODOCAL.format("MEI", BENT, FOUR), "MEI"),
        (EIGHT.replace("k4", "p1"), "p1"),
        (EIGHT.replace("KannalaBrandt8", "pinhole"), "must be named, fisheye or radtan"),
        (f"Camera: {json.dumps(FX)}\nLEFT: {json.dumps(FX | {'k1': 0.1})}\n", "--camera LEFT for others"),
        (ROS.format("equidistant", "[0.1, 0.1, 0.1, 0.1, 0.1]", K), "5 coefficients"),
        (ROS.format("plumb_bob", RADIAL, K) + ROI.format(2, 0, 0, 0, 0), "binning_x"),
        *((json.dumps(FX | {name: [0.1, 0.2]}), name) for name in ("distortion", "coeffs", "radial", "alpha", "t1")),
        (json.dumps(FX | {"lens_model": "fov"}), "'fov'"),
        (json.dumps(FX | {"fx": 0.78}), "focal lengths .* 0.78"),
        (json.dumps(FX | {"fx": "500,5"}), "fx must be finite numbers, got '500,5'"),
        (json.dumps(FX | {"D": [0.1, 0.1, 0, 0, 0.1, 0.1]}), "6 coefficients"),
        ('{"fx": 500, "fx": 502}', "fx is there twice"),
        (ROS.format("plumb_bob", RADIAL, K) + "---\n" + ROS.format("plumb_bob", "[]", K), "they differ"),
        ("# a comment\n\n3 SIMPLE_DIVISION 640 480 500 320 240 0.9\n" + RADIAL_FILES["colmap"], "SIMPLE_DIVISION"),
        ('{"w": 640, "h": 480, "fl_x": 500, "fl_y": 500, "cx": 320, "cy": 240, "camera_model": "OPENCV"}', "COLMAP"),
        ("a: &a [*a]\n", "recursive"),
        ("[" * 5000, "YAML"),
    ],
)  # fmt: skip
def test_what_is_not_known_is_refused_by_name(text: str, word: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=word):
        lens_in(text, tmp_path)
    (tmp_path / "lens.json").write_text(text)
    with pytest.raises(ValueError, match="lens.json"):
        lens_from(tmp_path / "lens.json")
