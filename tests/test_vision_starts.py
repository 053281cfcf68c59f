"""Starts from boards of markers, and without any target."""

import json
from pathlib import Path

import numpy as np
import pytest

cv2 = pytest.importorskip("cv2", reason="the extra `vision` is not installed")

from activeslam_gym.__main__ import main  # noqa: E402
from activeslam_gym.camera import camera_of  # noqa: E402
from activeslam_gym.geometry import quaternion_exp, quaternion_product, rotation_error  # noqa: E402
from activeslam_gym.vision.calibration import Calibration  # noqa: E402
from activeslam_gym.vision.markers import Board, drawn_board, find_corners, printed, printed_value  # noqa: E402
from activeslam_gym.vision.sources import Frame  # noqa: E402
from activeslam_gym.vision.target import fiducials_among, seen_corners, start_pose, target_from  # noqa: E402
from activeslam_gym.vision.track import follow  # noqa: E402
from activeslam_gym.vision.views import projected  # noqa: E402

from .vision_scene import LENS, image_from, plane_points, pose_at, texture  # noqa: E402

CHARUCO = {"kind": "charuco", "columns": 5, "rows": 4, "square": 0.06, "marker": 0.045, "dictionary": "4x4_50"}
APRILTAG = {"kind": "apriltag", "columns": 3, "rows": 2, "tag": 0.08, "gap": 0.02, "dictionary": "36h11"}
CAMERA = camera_of(LENS.scenario())
POSES = [
    pose_at((0.03, 0.02, 0.35)),
    pose_at((-0.12, 0.06, 0.33), (0.1, -0.3, 0.1)),
    pose_at((0.0, 0.0, 0.36), (0, 0, 2.0)),
]


def board_on_the_plane(board: Board, pose: np.ndarray, samples: int = 4) -> np.ndarray:
    """The image (240, 320) uint8 of the board on a white sheet on the textured plane."""
    picture, steps = printed(board), (np.arange(samples) + 0.5) / samples - 0.5
    total = np.zeros((240, 320))
    for dy in steps:
        for dx in steps:
            y, x = np.mgrid[:240, :320].astype(float)
            X = plane_points(pose, x + dx, y + dy)
            sheet = np.all(np.abs(X) < 0.5 * board.size + 0.02, axis=-1)
            value = printed_value(board, picture, X)
            total += np.where(np.isnan(value), np.where(sheet, 220.0, texture(X)), 30.0 + 190.0 / 255.0 * value)
    return np.rint(total / samples**2).astype(np.uint8)


@pytest.mark.parametrize("fields", [CHARUCO, APRILTAG], ids=lambda fields: fields["kind"])
@pytest.mark.parametrize("pose", POSES)
def test_the_pose_is_recovered_from_a_board_that_finds_itself(fields, pose) -> None:
    board = target_from(fields)
    points, pixels = seen_corners(board_on_the_plane(board, pose), CAMERA, board)
    assert len(points) >= 6
    assert np.abs(pixels - projected(CAMERA, pose, points)).max() < 0.4
    start = start_pose(CAMERA, points, pixels, 0.35)
    error = np.concatenate((pose[:3] - start.pose[:3], rotation_error(pose[3:], start.pose[3:])))
    assert np.linalg.norm(error[:3]) < 0.004 and np.abs(error[3:]).max() < 0.012, error
    assert error @ np.linalg.solve(start.covariance, error) < 22.5, "the 99.9th percentile of 6 degrees of freedom"


def test_a_part_of_the_board_is_enough_and_a_sliver_is_not() -> None:
    board = target_from(CHARUCO)
    image = board_on_the_plane(board, POSES[0])
    half, sliver = image.copy(), image.copy()
    half[:, 190:], sliver[:, 110:] = 128, 128
    points, pixels = seen_corners(half, CAMERA, board)
    assert 6 <= len(points) < len(board.points)
    assert np.abs(pixels - projected(CAMERA, POSES[0], points)).max() < 0.4
    with pytest.raises(
        ValueError, match=r"shows \d of the 12 corners of the target, a board of kind charuco; 6 or more"
    ):
        find_corners(sliver, board)


def test_the_drawn_board_is_the_pictured_one() -> None:
    board = target_from(APRILTAG)
    image = board_on_the_plane(board, POSES[1], samples=6)
    drawn = drawn_board(image, CAMERA, board, POSES[1])
    changed = drawn != image
    assert changed.mean() > 0.1
    assert np.abs(drawn - image)[changed].mean() < 3.0, "of 190 grey levels"


def test_fiducials_are_few_and_far_apart() -> None:
    points = target_from({**CHARUCO, "columns": 9, "rows": 7}).points
    chosen = fiducials_among(points)
    assert len(points) == 48 and len(chosen) == 8
    between = np.linalg.norm(chosen[:, None] - chosen, axis=2)[np.triu_indices(8, 1)]
    assert between.min() > 0.12
    assert len(fiducials_among(points[:4])) == 4


@pytest.mark.parametrize(
    ("fields", "change", "word"),
    [
        (CHARUCO, {"kind": "circle"}, "kind must be rectangle, charuco, apriltag, got 'circle'"),
        (CHARUCO, {"kind": []}, r"kind must be rectangle, charuco, apriltag, got \[\]"),
        (CHARUCO, {"marker": 0.06}, "marker must be smaller than square"),
        (CHARUCO, {"columns": 2}, "columns must be a whole number of 3 or more"),
        (CHARUCO, {"rows": 4.0}, "rows must be a whole number"),
        (CHARUCO, {"dictionary": "9x9"}, "dictionary must be one of OpenCV's, 4x4_50"),
        (CHARUCO, {"columns": 20, "rows": 20}, "the board has 200 markers, the dictionary 4x4_50 only 50"),
        (CHARUCO, {"tag": 1.0}, "has no field 'tag'"),
        (APRILTAG, {"gap": 0.0}, "gap must be a positive number of metres"),
        (APRILTAG, {"tag": "1"}, "tag must be a positive number"),
        (APRILTAG, {"columns": 1, "rows": 1}, "two tags or more"),
        (APRILTAG, {"dictionary": 36}, "36h11 for example, got 36"),
    ],
)
def test_a_wrong_board_is_named(fields, change, word) -> None:
    with pytest.raises(ValueError, match=word):
        target_from({**fields, **change})
    lacking = {name: value for name, value in fields.items() if name != "columns"}
    with pytest.raises(ValueError, match="lacks columns"):
        target_from(lacking)


# Tracking from them -------------------------------------------------------------------------------------------------


def path(count: int) -> list[np.ndarray]:
    return [
        pose_at((0.03 + 0.05 * np.sin(0.25 * k), 0.04 * (1 - np.cos(0.2 * k)), 0.4 + 0.002 * k)) for k in range(count)
    ]


@pytest.mark.parametrize("fields", [CHARUCO, APRILTAG], ids=lambda fields: fields["kind"])
def test_a_track_from_a_board_has_scale(fields) -> None:
    board = target_from(fields)
    frames = [(k / 30.0, board_on_the_plane(board, pose, 2)) for k, pose in enumerate(path(20))]
    done = follow(frames, LENS, board, 30.0)
    truth = np.array([pose[:3] for pose in path(20)])
    assert done.metric and done.logs[-1].metric and done.trouble is None
    assert np.linalg.norm(done.cameras[5:, :3] - truth[5:], axis=1).max() < 0.006


def similarity(a: np.ndarray, b: np.ndarray) -> tuple[float, float]:
    """RMSE of ``a`` (n, 3) from ``b`` (n, 3) after the best rotation, shift and scale, and the scale."""
    a, b = a - a.mean(axis=0), b - b.mean(axis=0)
    U, D, Vt = np.linalg.svd(a.T @ b)
    signs = np.array((1.0, 1.0, np.linalg.det(U @ Vt)))
    scale = float(D @ signs / np.sum(a * a))
    return float(np.sqrt(np.sum((scale * a @ (U * signs) @ Vt - b) ** 2, axis=1).mean())), scale


@pytest.fixture(scope="module")
def free() -> list[Frame]:
    """A textured plane without a target, at twice the distance that the prior expects."""
    poses = [np.concatenate((2.0 * pose[:3], pose[3:])) for pose in path(40)]
    return [(k / 30.0, image_from(pose, samples=2)) for k, pose in enumerate(poses)]


def test_a_track_without_a_target_has_the_path_and_no_scale(free) -> None:
    done = follow(free, LENS, None, 30.0)
    truth = 2.0 * np.array([pose[:3] for pose in path(40)])
    assert not done.metric and not done.logs[-1].metric and done.trouble is None
    np.testing.assert_array_equal(done.cameras[0, :3], 0.0)
    error, scale = similarity(done.cameras[5:, :3], truth[5:])
    assert error < 0.015 and 0.3 < scale < 3.0, (error, scale)


def test_what_has_no_scale_says_so(free, tmp_path: Path, capsys) -> None:
    (tmp_path / "images").mkdir()
    for k, (_, image) in enumerate(free[:4]):
        cv2.imwrite(str(tmp_path / "images" / f"{k}.png"), image)
    (tmp_path / "lens.json").write_text(json.dumps(Calibration._asdict(LENS)))
    given = ["--images", str(tmp_path / "images"), "--calibration", str(tmp_path / "lens.json")]
    assert main(["track", *given, "--out", str(tmp_path)]) == 0
    assert "the scale is free" in capsys.readouterr().out
    lines = (tmp_path / "trajectory.tum").read_text().splitlines()
    assert lines[0].startswith("# no target: the scale is free")
    assert np.loadtxt(tmp_path / "trajectory.tum").shape == (4, 8)
    header, *rows = (line.split(",") for line in (tmp_path / "frames.csv").read_text().splitlines())
    assert {row[header.index("metric")] for row in rows} == {"0"}


def test_a_rolled_board_needs_no_guess() -> None:
    board = target_from(CHARUCO)
    for roll in np.linspace(-3.0, 3.0, 5):
        pose = np.concatenate(
            ((0.05, -0.04, 0.5), quaternion_product(pose_at((0, 0, 0))[3:], quaternion_exp(np.array((0.1, 0.2, roll)))))
        )
        start = start_pose(CAMERA, board.points, projected(CAMERA, pose, board.points), 0.3)
        np.testing.assert_allclose(start.pose[:3], pose[:3], atol=1e-6)
