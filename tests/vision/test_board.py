"""The lens from pictures of a board, and a live camera."""

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

cv2 = pytest.importorskip("cv2", reason="the extra `vision` is not installed")


from activeslam_gym.__main__ import main
from activeslam_gym.geometry import quaternion_exp, rotation_matrix
from activeslam_gym.live import source as live_source
from activeslam_gym.live.device import Device
from activeslam_gym.live.source import GuidanceError
from activeslam_gym.vision import board
from activeslam_gym.vision.board import BOARD, BoardCalibration, View, find_board, fit_lens
from activeslam_gym.vision.calibration import Calibration
from activeslam_gym.vision.first_sight import corners_in, seen_corners
from activeslam_gym.vision.lens_files import Lens, read_lens
from activeslam_gym.vision.other_lenses import lens_from, projected_by
from activeslam_gym.vision.sources import SourceError, images_of
from activeslam_gym.vision.target import Board, printed, printed_value, target_from
from activeslam_gym.vision.views import projected
from tests import vision_scene
from tests.vision_scene import CAMERA, LENS, enlarged, photographed, pose_at

COLUMNS, ROWS, SQUARE = 7, 5, 0.03
TURNS = [(0.0, 0.0, 0.0), (0.5, 0.1, 0.0), (-0.4, -0.3, 0.2), (0.1, 0.5, -0.2), (0.0, -0.5, 0.4)]
POSES = [
    pose_at(0.25 * rotation_matrix(quaternion_exp(np.array(turn)))[:, 2] + (0.02, 0.01, 0.0), turn) for turn in TURNS
]
"""The board is turned round from where it fills the image."""
FLAT = np.full((240, 320), 99, np.uint8)


def chessboard(X: np.ndarray) -> np.ndarray:
    """Grey values of the plane at X (..., 2) [m]."""
    i = np.floor(X[..., 0] / SQUARE + 0.5 * (COLUMNS + 1)).astype(int)
    j = np.floor(X[..., 1] / SQUARE + 0.5 * (ROWS + 1)).astype(int)
    on = (i >= 0) & (i <= COLUMNS) & (j >= 0) & (j <= ROWS)
    return np.where(on & ((i + j) % 2 == 0), 30.0, 220.0)


def charuco(X: np.ndarray) -> np.ndarray:
    """The same of a ChArUco board of 7 x 5 squares."""
    board = Board("charuco", COLUMNS, ROWS, SQUARE, 0.75 * SQUARE, "DICT_4X4_50")
    return np.nan_to_num(printed_value(board, printed(board), X), nan=255.0)


@pytest.mark.parametrize(("pattern", "std"), [(chessboard, 0.4), (charuco, 1.6)])
def test_the_lens_is_recovered_from_pictures_of_a_board(pattern, std, tmp_path, capsys) -> None:
    """``std`` [px]: of the principal point, as the fit itself has it."""
    for k, pose in enumerate(POSES):
        cv2.imwrite(str(tmp_path / f"{k}.png"), photographed(pose, pattern))
    options = ["--kind", pattern.__name__, "--columns", str(COLUMNS), "--rows", str(ROWS)]
    assert main(["calibrate", "--images", str(tmp_path), *options, "--out", str(tmp_path / "lens.json")]) == 0
    found, said = lens_from(tmp_path / "lens.json")[0], capsys.readouterr().out
    assert found.focal_px == pytest.approx(LENS.focal_px, rel=0.01)
    assert found[3:5] == pytest.approx(LENS[3:5], abs=3.0 * std)
    assert float(said.split("principal point (")[1].split()[2].rstrip(",")) < std
    assert found.distortion == pytest.approx(LENS.distortion, rel=0.05)
    assert float(said.split("residual ")[1].split()[0]) < 0.3


def test_corners_of_a_tilted_charuco_board_in_a_small_picture_are_refined() -> None:
    board, errors = Board("charuco", COLUMNS, ROWS, SQUARE, 0.75 * SQUARE, "DICT_4X4_50"), list[list[float]]()
    for pose in POSES[1:]:
        image, truth = cv2.GaussianBlur(photographed(pose, charuco), (0, 0), 0.4), projected(CAMERA, pose, board.points)
        found = corners_in(image, board)[1], find_board(image, "charuco", COLUMNS, ROWS)[1]
        errors.append([float(np.mean(cKDTree(truth).query(pixels)[0] ** 2)) for pixels in found])
    rough, fine = np.sqrt(np.mean(errors, axis=0))
    assert fine < 0.9 * rough


@pytest.mark.parametrize("pose", POSES[1:])
def test_corners_of_a_tilted_chessboard_in_a_small_picture_are_not_shifted_together(pose) -> None:
    x, y = (SQUARE * (np.arange(float(n)) - 0.5 * (n - 1)) for n in (COLUMNS, ROWS))
    corners = np.stack((*np.meshgrid(x, y), np.zeros((ROWS, COLUMNS))), axis=-1).reshape(-1, 3)
    image = cv2.GaussianBlur(photographed(pose, chessboard), (0, 0), 0.7)
    _, pixels = find_board(image, "chessboard", COLUMNS, ROWS)
    errors = pixels[:, None] - projected(CAMERA, pose, corners)
    nearest = np.linalg.norm(errors, axis=2).argmin(axis=1)
    assert np.abs(errors[np.arange(len(pixels)), nearest].mean(axis=0)).max() < 0.03


POINTS = np.stack((*np.meshgrid(np.arange(7.0) - 3.0, np.arange(5.0) - 2.0), np.zeros((5, 7))), axis=-1).reshape(-1, 3)
EXACT = [
    (POINTS * (1.0, -1.0, 1.0), projected(CAMERA, np.concatenate((20.0 * pose[:3], pose[3:])), POINTS))
    for pose in POSES
]
"""Views through LENS, without noise."""


def pinhole(seed: int, noise_px: float, bend: float = 0.0, tilt: float = 0.6) -> list[View]:
    """Ten views through a lens with f = 520, u0 = 325, v0 = 236 and K = ``bend``, with drawn noise."""
    rng, views = np.random.default_rng(seed), []
    for _ in range(10):
        turn = Rotation.from_rotvec(rng.uniform(-tilt, tilt, 3))
        p = turn.apply(POINTS) + (rng.uniform(-1.5, 1.5), rng.uniform(-1, 1), rng.uniform(9, 13))
        u_c = 520.0 * p[:, :2] / p[:, 2:]
        pixels = u_c / np.sqrt(1.0 + bend * (u_c**2).sum(axis=1))[:, None] + (325.0, 236.0)
        views.append((POINTS, pixels + noise_px * rng.standard_normal(pixels.shape)))
    return views


@pytest.mark.parametrize("noise_px", [0.1, pytest.param(0.5, marks=pytest.mark.slow)])
def test_repeated_fits_spread_as_they_claim(noise_px) -> None:
    rng, lenses, stds = np.random.default_rng(7), [], []
    for _ in range(25):
        fit = fit_lens([(p, z + noise_px * rng.standard_normal(z.shape)) for p, z in EXACT], 320, 240)
        lenses.append(fit.calibration[2:])
        stds.append(fit.stds)
    ratio = np.std(lenses, axis=0, ddof=1) / np.mean(stds, axis=0)
    assert (1.0 / 1.5 < ratio).all() and (ratio < 1.5).all(), ratio


def test_deviations_hold_where_the_lens_is_not_quite_of_the_model() -> None:
    """Pixels 0.3 % longer than wide: fits of other pictures spread three to four times as independent residuals say."""
    fits = [fit_lens([(p, z * (1.0, 1.003)) for p, z in pinhole(seed, 0.1)], 640, 480) for seed in range(8)]
    spread = np.std([fit.calibration[2:5] for fit in fits], axis=0, ddof=1)
    assert (spread < 2.0 * np.mean([fit.stds[:3] for fit in fits], axis=0)).all()


def misplaced(bad: int) -> list[View]:
    """Ten views, of which so many have their lower two rows one square along."""
    views = pinhole(0, 0.1, 6e-7)
    for k in range(bad):
        pixels = views[k][1].reshape(ROWS, COLUMNS, 2)
        pixels[3:, :-1] = pixels[3:, 1:]
    return views


@pytest.mark.parametrize("bad", [1, 2])
def test_a_view_found_in_the_wrong_place_is_named_and_left_out(bad, tmp_path, monkeypatch, capsys) -> None:
    views, found = misplaced(bad), iter(misplaced(bad))
    monkeypatch.setattr(board, "find_board", lambda *_: next(found))
    for k in range(len(views)):
        cv2.imwrite(str(tmp_path / f"{k}.png"), np.zeros((480, 640), np.uint8))
    fit = board.calibrate(tmp_path, "chessboard", COLUMNS, ROWS, tmp_path / "lens.json")
    assert f" {bad - 1}.png" in capsys.readouterr().err
    assert abs(fit.calibration.focal_px - 520.0) < 3.0 * fit.stds[0]
    assert fit.kept == list(range(bad, len(views)))


def test_a_pincushion_is_fitted() -> None:
    views = pinhole(1, 0.1, -4e-7)
    fit = fit_lens(views, 640, 480)
    assert fit.calibration.distortion == pytest.approx(-4e-7, rel=0.2) and fit.stds[3] < 1e-7
    assert fit.residual_px == pytest.approx(0.1, rel=0.1)


FACING, OBLONG = pinhole(1, 0.1, 4e-7, tilt=0.0), [(points, z * (1.0, 1.09)) for points, z in pinhole(0, 0.1)]
REFUSED = [(misplaced(5), "agree on no lens"), (FACING, "tilt the board"), (OBLONG, "--model radtan")]


@pytest.mark.parametrize(("views", "word"), REFUSED)
def test_views_that_do_not_tell_the_lens_are_refused(views: list[View], word: str) -> None:
    with pytest.raises(ValueError, match=word):
        fit_lens(views, 640, 480)


@pytest.mark.parametrize("model", board.MODELS[1:])
def test_pictures_square_on_determine_no_lens_of_opencvs(model: str) -> None:
    with pytest.raises(ValueError, match="tilt the board"):
        fit_lens(FACING, 640, 480, model)


@pytest.mark.parametrize("size", [1, 2])
def test_the_bound_of_equation_1_grows_with_the_picture(size: int) -> None:
    with pytest.raises(ValueError, match="--model radtan"):
        fit_lens([(points, size * z) for points, z in OBLONG], size * 640, size * 480)
    slight = [(points, size * z * (1.0, 1.02)) for points, z in pinhole(0, 0.1)]
    assert fit_lens(slight, size * 640, size * 480).residual_px < 0.96 * size


def test_hidden_files_and_folders_are_no_images_and_other_endings_are_reported(tmp_path, capsys) -> None:
    for name in ("0.png", "1.webp", ".2.png"):
        cv2.imwrite(str(tmp_path / name), FLAT)
    (tmp_path / "._0.png").write_bytes(b"\5" * 100)
    (tmp_path / "sub.png").mkdir()
    assert len(list(images_of(tmp_path, 30.0).frames)) == 2 and capsys.readouterr().err == ""
    (tmp_path / "3.heic").write_bytes(b"")
    assert len(list(images_of(tmp_path, 30.0).frames)) == 2 and ".heic" in capsys.readouterr().err
    assert len(list(images_of(f"{tmp_path}/*.png", 30.0).frames)) == 1


def test_a_live_camera_gives_grey_images_until_it_stops(monkeypatch) -> None:
    def camera(number: int) -> SimpleNamespace:
        reads = iter([(True, np.full((4, 6, 3), (10, 20, 30), np.uint8))] * 2)
        opened, read = number == 0, lambda: next(reads, (False, None))
        return SimpleNamespace(isOpened=lambda: opened, read=read, release=lambda: None, set=asked.__setitem__)

    asked = dict[int, int]()
    monkeypatch.setattr(cv2, "VideoCapture", camera)
    frames = images_of("camera:0", 30.0, size=(6, 4)).frames
    assert asked == {cv2.CAP_PROP_FRAME_WIDTH: 6, cv2.CAP_PROP_FRAME_HEIGHT: 4}, "the calibration's size"
    (first, image), (second, _) = next(frames), next(frames)
    assert image.shape == (4, 6) and first <= second
    with pytest.raises(SourceError, match="camera:0 has stopped"):
        next(frames)
    for name, message in (("camera:1", "camera:1 is not there"), ("camera:front", "camera:0, camera:1")):
        with pytest.raises(SourceError, match=message):
            images_of(name, 30.0)


@pytest.mark.parametrize("model", ["radtan", "fisheye"])
def test_a_lens_of_opencvs_is_found_and_read_again(model, tmp_path) -> None:
    """Corners through such a lens, some of them in a wrong place; the file is OpenCV's, and its deviations hold."""
    matrix = np.array(((400.0, 0.0, 325.0), (0.0, 403.0, 236.0), (0.0, 0.0, 1.0)))
    bent = (-0.03, 0.01, -0.004, 0.001) if model == "fisheye" else (-0.25, 0.08, 0.002, -0.001)
    true = Lens((640, 480), model == "fisheye", matrix, np.array(bent))
    rng, views = np.random.default_rng(3), []
    for k in range(14):
        turn = Rotation.from_rotvec(rng.uniform(-0.6, 0.6, 3))
        p = turn.apply(POINTS) + (rng.uniform(-1.5, 1.5), rng.uniform(-1, 1), rng.uniform(5, 8))
        z = projected_by(true, p[:, :2] / p[:, 2:]) + 0.1 * rng.standard_normal((len(p), 2))
        if k == 3:
            z.reshape(ROWS, COLUMNS, 2)[3:, :-1] = z.reshape(ROWS, COLUMNS, 2)[3:, 1:].copy()
        views.append((POINTS, z))
    fit = fit_lens(views, 640, 480, model)
    assert 3 not in fit.kept and fit.residual_px == pytest.approx(0.1, rel=0.15) and fit.lens is not None
    (tmp_path / "lens.json").write_text(json.dumps(fit.lens.fields()))
    again = read_lens(tmp_path / "lens.json")
    assert again.fisheye == true.fisheye and (again.matrix == fit.lens.matrix).all()
    rays = rng.uniform((-0.6, -0.45), (0.6, 0.45), (50, 2))
    assert np.abs(projected_by(again, rays) - projected_by(true, rays)).max() < 1.0
    off = (fit.lens.matrix[[0, 0, 1], [0, 2, 2]] - true.matrix[[0, 0, 1], [0, 2, 2]]) / fit.stds[:3]
    assert np.abs(off).max() < 3.0


def test_the_legacy_pattern_of_a_charuco_board_is_found_or_named(tmp_path) -> None:
    legacy = Board("charuco", 6, 4, 0.03, 0.0225, "DICT_4X4_50", True)
    image = cv2.copyMakeBorder(printed(legacy), 60, 60, 60, 60, cv2.BORDER_CONSTANT, value=255)
    points, pixels = find_board(image, "charuco", 6, 4)
    np.testing.assert_allclose(np.diff(pixels[:5, 0]), np.full(4, pixels[1, 0] - pixels[0, 0]), atol=0.5)
    assert len(points) == 15
    fields = {"columns": 6, "rows": 4, "square": 0.03, "marker": 0.0225, "dictionary": "4x4_50"}
    assert target_from({"kind": "charuco-legacy", **fields}) == legacy
    with pytest.raises(ValueError, match='pattern of kind "charuco-legacy"'):
        seen_corners(image, CAMERA, target_from({"kind": "charuco", **fields}))


LARGE = enlarged(LENS, 2)
PICTURE = printed(BOARD)
PAGE = cv2.copyMakeBorder(PICTURE, 60, 60, 60, 60, cv2.BORDER_CONSTANT, value=255)
PLACES = {"upper left": (-1, 1), "upper right": (1, 1), "lower left": (-1, -1), "lower right": (1, -1)}
TILTS = {"left": (0, 1), "right": (0, -1), "top": (1, 0), "bottom": (-1, 0)}


def test_corners_in_a_row_are_no_view_and_no_start() -> None:
    image = PAGE.copy()
    image[60 + 2 * 80 :] = 255
    assert len(corners_in(image, BOARD)[0]) == 6 and find_board(image, "charuco", 7, 5) is None
    with pytest.raises(ValueError, match="6 of the 24 corners .* not in a row"):
        seen_corners(image, CAMERA, BOARD)


@pytest.mark.parametrize("model", board.MODELS)
def test_a_view_with_which_opencv_fails_is_left_out(model) -> None:
    views = pinhole(1, 0.1, 6e-7)
    row = (views[0][0][:COLUMNS], views[0][1][:COLUMNS])
    assert fit_lens([row, *views], 640, 480, model).kept == [*range(1, 11)]


def test_markers_of_another_size_are_a_wrong_scale_and_no_wrong_lens() -> None:
    other = printed(BOARD._replace(marker=0.5 * BOARD.pitch))
    image = cv2.copyMakeBorder(other, 60, 60, 60, 60, cv2.BORDER_CONSTANT, value=255)
    points, pixels = find_board(image, "charuco", 7, 5)
    np.testing.assert_allclose(pixels, points[:, :2] * 80 + 340 - 0.5 + (0, -80), atol=0.3)
    with pytest.raises(ValueError, match="a marker has 0.49 of a square's side, not 0.75"):
        seen_corners(image, Calibration(680, 520, 600.0, 339.5, 259.5, 0.0).camera, BOARD)


def board_from(pose: np.ndarray) -> np.ndarray:
    def grey(X: np.ndarray) -> np.ndarray:
        value = printed_value(BOARD, PICTURE, X)
        return np.where(np.isnan(value), 200.0, 30.0 + 190.0 / 255.0 * value)

    return photographed(pose, grey, 2)


def held(words: str, rng: np.random.Generator) -> np.ndarray:
    """The pose of the camera before the board that one who hears the ``words`` brings about."""
    x, y = next((0.05 * np.array(at) for name, at in PLACES.items() if name in words), rng.uniform(-0.02, 0.02, 2))
    turn = next((at for name, at in TILTS.items() if f"its {name}" in words), rng.uniform(-0.7, 0.7, 2))
    pose = pose_at((0.0, 0.0, 0.0), (*(-0.55 * np.array(turn)), 0.0))
    pose[:3] = -rotation_matrix(pose[3:]) @ (-x, y, rng.uniform(0.36, 0.42))
    return pose


def test_one_who_follows_the_guidance_calibrates_and_the_lens_is_used_at_once(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(vision_scene, "LENS", LARGE)
    monkeypatch.setattr(Device, "_warm_up", lambda self: None)
    monkeypatch.setattr(live_source, "start", lambda image, calibration, target, *_, **__: (calibration, target))
    with pytest.raises(ValueError, match="--calibrate: .* is a folder"):
        Device(None, None, 5.0, tmp_path)
    source, rng = Device(None, None, 5.0, tmp_path / "lens.json"), np.random.default_rng(2**32)
    heard, done, started = [""], 0, None
    calibration = BoardCalibration()
    calibration._keep(EXACT[0], FLAT.shape)
    assert "Turn the device back: the first views are of 320 x 240" in calibration.add(FLAT.T)
    with pytest.raises(GuidanceError, match="Calibration: Hold the board"):
        source.start(np.full((480, 640), 128, np.uint8))
    while started is None and len(heard) < 80:
        if len(heard) % 2 and done < 4:  # each pose is held for two images, until the board is put down
            image = board_from(held(heard[-1], rng))
        source._frame = (0.2 * len(heard), image)
        try:
            started = source.start(source.next()[1])
        except GuidanceError as guidance:
            heard.append(str(guidance))
            done += "Calibrated. Put the board down" in heard[-1]
    assert 13 <= done <= 15  # 2 s of rest
    assert started is not None, heard
    fit, target = started
    assert target == BOARD and lens_from(tmp_path / "lens.json")[0] == fit and not source.calibrating
    assert source.scenario.focal_px == fit.reduced(fit.scale).focal_px
    assert fit.focal_px == pytest.approx(LARGE.focal_px, rel=0.01)
    assert fit.distortion == pytest.approx(LARGE.distortion, rel=0.1)
    assert np.hypot(fit.principal_x_px - LARGE.principal_x_px, fit.principal_y_px - LARGE.principal_y_px) < 4.0
    asked = {name for name in (*PLACES, *TILTS) if any(name in one for one in heard)}
    assert asked & set(PLACES) and asked & set(TILTS)
