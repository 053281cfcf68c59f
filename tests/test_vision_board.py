"""The lens from pictures of a board, a live camera, and the ablation's arithmetic."""

import numpy as np
import pytest

cv2 = pytest.importorskip("cv2", reason="the extra `vision` is not installed")

from activeslam_gym.__main__ import main  # noqa: E402
from activeslam_gym.geometry import quaternion_exp, rotation_matrix  # noqa: E402
from activeslam_gym.vision.ablation import aligned_rmse  # noqa: E402
from activeslam_gym.vision.board import find_board, fit_lens  # noqa: E402
from activeslam_gym.vision.calibration import read_calibration  # noqa: E402
from activeslam_gym.vision.sources import SourceError, open_images  # noqa: E402
from activeslam_gym.vision.views import projected  # noqa: E402

from .vision_scene import CAMERA, LENS, photographed, pose_at  # noqa: E402

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
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    board = cv2.aruco.CharucoBoard((COLUMNS, ROWS), 1.0, 0.75, dictionary).generateImage((COLUMNS * 40, ROWS * 40))
    i = np.floor((X[..., 0] / SQUARE + 0.5 * COLUMNS) * 40).astype(int)
    j = np.floor((0.5 * ROWS - X[..., 1] / SQUARE) * 40).astype(int)
    on = (i >= 0) & (i < COLUMNS * 40) & (j >= 0) & (j < ROWS * 40)
    return np.where(on, board[np.clip(j, 0, ROWS * 40 - 1), np.clip(i, 0, COLUMNS * 40 - 1)], 255.0)


@pytest.mark.parametrize(("pattern", "std"), [(chessboard, 0.4), (charuco, 1.6)])
def test_the_lens_is_recovered_from_pictures_of_a_board(pattern, std, tmp_path, capsys) -> None:
    """``std`` [px]: of the principal point, as the fit itself has it."""
    for k, pose in enumerate(POSES):
        cv2.imwrite(str(tmp_path / f"{k}.png"), photographed(pose, pattern))
    options = ["--kind", pattern.__name__, "--columns", str(COLUMNS), "--rows", str(ROWS)]
    assert main(["calibrate", "--images", str(tmp_path), *options, "--out", str(tmp_path / "lens.json")]) == 0
    found, said = read_calibration(tmp_path / "lens.json"), capsys.readouterr().out
    assert found.focal_px == pytest.approx(LENS.focal_px, rel=0.01)
    assert found[3:5] == pytest.approx(LENS[3:5], abs=3.0 * std)
    assert float(said.split("principal point (")[1].split()[2].rstrip(",")) < std
    assert found.distortion == pytest.approx(LENS.distortion, rel=0.05)
    assert float(said.split("residual ")[1].split()[0]) < 0.3


def test_the_fit_is_exact_on_exact_corners() -> None:
    points = np.stack((*np.meshgrid(np.arange(7.0) - 3.0, np.arange(5.0) - 2.0), np.zeros((5, 7))), axis=-1).reshape(
        -1, 3
    )
    poses = [np.concatenate((20.0 * pose[:3], pose[3:])) for pose in POSES]
    fit = fit_lens([(points * (1.0, -1.0, 1.0), projected(CAMERA, pose, points)) for pose in poses], 320, 240)
    np.testing.assert_allclose(fit.calibration[2:5], LENS[2:5], atol=1e-3)
    assert fit.calibration.distortion == pytest.approx(LENS.distortion, rel=1e-3)
    assert fit.residual_px < 1e-4


def test_too_few_pictures_of_the_board_are_refused(tmp_path, capsys) -> None:
    for k, picture in enumerate((photographed(POSES[0], chessboard), FLAT, FLAT)):
        cv2.imwrite(str(tmp_path / f"{k}.png"), picture)
    arguments = ["calibrate", "--images", str(tmp_path), "--columns", "7", "--rows", "5"]
    assert main([*arguments, "--out", str(tmp_path / "lens.json")]) == 2
    assert "found in 1 pictures; 3 or more" in capsys.readouterr().err
    assert main([*arguments, "--kind", "dots", "--out", str(tmp_path / "lens.json")]) == 2
    assert "kind must be one of chessboard, charuco" in capsys.readouterr().err
    assert find_board(FLAT, "charuco", 7, 5) is None


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
    for name, message in (("camera:1", "camera:1 is not there"), ("camera:front", "camera:0, camera:1")):
        with pytest.raises(SourceError, match=message):
            open_images(name, 30.0)


def test_the_aligned_error_ignores_a_rotation_and_a_shift_and_nothing_else() -> None:
    rng = np.random.default_rng(1)
    path, R = rng.standard_normal((50, 3)), rotation_matrix(quaternion_exp(np.array((0.4, -1.0, 2.0))))
    moved = path @ R.T + (1.0, 2.0, 3.0)
    assert aligned_rmse(moved, path) < 1e-7
    assert aligned_rmse(1.1 * moved, path) > 0.05
