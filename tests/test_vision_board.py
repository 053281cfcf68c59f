"""The lens from pictures of a board, a live camera, and the ablation's arithmetic."""

import json

import numpy as np
import pytest

cv2 = pytest.importorskip("cv2", reason="the extra `vision` is not installed")

from activeslam_gym.__main__ import main  # noqa: E402
from activeslam_gym.camera import camera_of, pixel_from_camera_point  # noqa: E402
from activeslam_gym.geometry import quaternion_exp, rotation_matrix  # noqa: E402
from activeslam_gym.vision.ablation import aligned_rmse  # noqa: E402
from activeslam_gym.vision.board import find_board, fit_lens  # noqa: E402
from activeslam_gym.vision.calibration import read_calibration  # noqa: E402
from activeslam_gym.vision.sources import SourceError, open_images  # noqa: E402

from .vision_scene import LENS, plane_points, pose_at  # noqa: E402

COLUMNS, ROWS, SQUARE = 7, 5, 0.03
TURNS = [(0.0, 0.0, 0.0), (0.5, 0.1, 0.0), (-0.4, -0.3, 0.2), (0.1, 0.5, -0.2), (0.0, -0.5, 0.4)]


def chessboard(X: np.ndarray) -> np.ndarray:
    """Grey values of the plane at X (..., 2) [m]."""
    i = np.floor(X[..., 0] / SQUARE + 0.5 * (COLUMNS + 1)).astype(int)
    j = np.floor(X[..., 1] / SQUARE + 0.5 * (ROWS + 1)).astype(int)
    on = (i >= 0) & (i <= COLUMNS) & (j >= 0) & (j <= ROWS)
    return np.where(on & ((i + j) % 2 == 0), 30.0, 220.0)


def charuco(X: np.ndarray) -> np.ndarray:
    """The same of a ChArUco board of 7 x 5 squares."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    board = cv2.aruco.CharucoBoard((COLUMNS, ROWS), 1.0, 0.75, dictionary).generateImage((COLUMNS * 40, ROWS * 40))
    i = np.floor((X[..., 0] / SQUARE + 0.5 * COLUMNS) * 40).astype(int)
    j = np.floor((0.5 * ROWS - X[..., 1] / SQUARE) * 40).astype(int)
    on = (i >= 0) & (i < COLUMNS * 40) & (j >= 0) & (j < ROWS * 40)
    return np.where(on, board[np.clip(j, 0, ROWS * 40 - 1), np.clip(i, 0, COLUMNS * 40 - 1)], 255.0)


def picture(pattern, turn) -> np.ndarray:
    """The pattern (240, 320) uint8, turned round from where it fills the image; each pixel the mean of 4 x 4 rays."""
    away = rotation_matrix(quaternion_exp(np.array(turn)))[:, 2]
    pose = pose_at(tuple(0.25 * away + (0.02, 0.01, 0.0)), turn)
    steps, total = (np.arange(4) + 0.5) / 4 - 0.5, np.zeros((240, 320))
    for dy in steps:
        for dx in steps:
            y, x = np.mgrid[:240, :320].astype(float)
            total += pattern(plane_points(pose, x + dx, y + dy))
    return np.rint(total / 16).astype(np.uint8)


@pytest.mark.parametrize(("pattern", "kind", "std"), [(chessboard, "chessboard", 0.4), (charuco, "charuco", 1.6)])
def test_the_lens_is_recovered_from_pictures_of_a_board(pattern, kind, std, tmp_path, capsys) -> None:
    """``std`` [px]: of the principal point, as the fit itself has it."""
    for k, turn in enumerate(TURNS):
        cv2.imwrite(str(tmp_path / f"{k}.png"), picture(pattern, turn))
    options = ["--kind", kind, "--columns", str(COLUMNS), "--rows", str(ROWS), "--out", str(tmp_path / "lens.json")]
    assert main(["calibrate", "--images", str(tmp_path), *options]) == 0
    found, said = read_calibration(tmp_path / "lens.json"), capsys.readouterr().out
    assert found.focal_px == pytest.approx(LENS.focal_px, rel=0.01)
    assert found.principal_x_px == pytest.approx(LENS.principal_x_px, abs=3.0 * std)
    assert found.principal_y_px == pytest.approx(LENS.principal_y_px, abs=3.0 * std)
    assert float(said.split("principal point (")[1].split()[2].rstrip(",")) < std
    assert found.distortion == pytest.approx(LENS.distortion, rel=0.05)
    assert float(said.split("residual ")[1].split()[0]) < 0.3


def test_the_fit_is_exact_on_exact_corners() -> None:
    camera, views = camera_of(LENS.scenario()), []
    points = np.stack(np.meshgrid(np.arange(7.0), np.arange(5.0)), axis=-1).reshape(-1, 2)
    for turn in TURNS:
        p = np.pad(points - (3.0, 2.0), ((0, 0), (0, 1))) @ rotation_matrix(quaternion_exp(np.array(turn))).T
        pixels = np.empty((len(p), 2))
        for z, point in zip(pixels, p + (0.0, 0.0, 5.0)):
            assert pixel_from_camera_point(camera, point * (-1.0, -1.0, 1.0), z)
        views.append((points, pixels))
    fit = fit_lens(views, 320, 240)
    np.testing.assert_allclose(fit.calibration[2:5], (195.0, 162.0, 125.0), atol=1e-3)
    assert fit.calibration.distortion == pytest.approx(1.8e-5, rel=1e-3)
    assert fit.residual_px < 1e-4


def test_too_few_pictures_of_the_board_are_refused(tmp_path, capsys) -> None:
    for k in range(3):
        cv2.imwrite(
            str(tmp_path / f"{k}.png"), picture(chessboard, TURNS[0]) if k == 0 else np.full((240, 320), 99, "u1")
        )
    arguments = ["calibrate", "--images", str(tmp_path), "--columns", "7", "--rows", "5"]
    assert main([*arguments, "--out", str(tmp_path / "lens.json")]) == 2
    assert "found in 1 pictures; 3 or more" in capsys.readouterr().err
    assert main([*arguments, "--kind", "dots", "--out", str(tmp_path / "lens.json")]) == 2
    assert "kind must be one of chessboard, charuco" in capsys.readouterr().err
    assert find_board(np.full((240, 320), 99, np.uint8), "charuco", 7, 5) is None


class Stopping:
    """A camera that gives two colour images and stops."""

    def __init__(self, number: int) -> None:
        self.left = 2 if number == 0 else 0

    def isOpened(self) -> bool:  # noqa: N802
        return self.left > 0

    def read(self):
        self.left -= 1
        return self.left >= 0, np.full((4, 6, 3), (10, 20, 30), np.uint8)

    def release(self) -> None:
        self.left = 0


def test_a_live_camera_gives_grey_images_until_it_stops(monkeypatch) -> None:
    monkeypatch.setattr(cv2, "VideoCapture", Stopping)
    frames = open_images("camera:0", 30.0)
    (first, image), (second, _) = next(frames), next(frames)
    assert image.shape == (4, 6) and first <= second
    with pytest.raises(SourceError, match="camera:0 has stopped"):
        next(frames)
    with pytest.raises(SourceError, match="camera:1 is not there"):
        open_images("camera:1", 30.0)
    with pytest.raises(SourceError, match="camera:0, camera:1"):
        open_images("camera:front", 30.0)


def test_the_aligned_error_ignores_a_rotation_and_a_shift_and_nothing_else() -> None:
    rng = np.random.default_rng(1)
    path, R = rng.standard_normal((50, 3)), rotation_matrix(quaternion_exp(np.array((0.4, -1.0, 2.0))))
    moved = path @ R.T + (1.0, 2.0, 3.0)
    assert aligned_rmse(moved, path) < 1e-12
    assert aligned_rmse(1.1 * moved, path) > 0.05
    assert aligned_rmse(moved * (1.0, 1.0, -1.0), path) > 0.5, "a mirror image is another path"
    noisy = moved + 0.01 * rng.standard_normal((50, 3))
    assert aligned_rmse(noisy, path) == pytest.approx(0.01 * np.sqrt(3.0), rel=0.25)


def test_ablate_says_what_is_wrong(tmp_path, capsys) -> None:
    (tmp_path / "lens.json").write_text(json.dumps(LENS._asdict()))
    files = ["--calibration", str(tmp_path / "lens.json"), "--target", str(tmp_path / "none.json")]
    assert main(["ablate", "--images", str(tmp_path), *files]) == 2
    assert "none.json" in capsys.readouterr().err
    assert main(["ablate", "--images", str(tmp_path), *files, "--every", "0"]) == 2
    assert "every must be a whole number" in capsys.readouterr().err
