"""The target and its pose, the sources' errors, and a short track of a rendered plane."""

import json
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import chain, islice, repeat
from pathlib import Path

import numpy as np
import pytest

cv2 = pytest.importorskip("cv2", reason="the extra `vision` is not installed")

from activeslam_gym.__main__ import main  # noqa: E402
from activeslam_gym.camera import camera_of, pixel_from_camera_point  # noqa: E402
from activeslam_gym.geometry import rotation_error, rotation_matrix  # noqa: E402
from activeslam_gym.vision.calibration import calibration_from, read_calibration  # noqa: E402
from activeslam_gym.vision.sources import SourceError, open_images  # noqa: E402
from activeslam_gym.vision.target import CORNERS, drawn_target, read_target, refine_corners, start_pose, target_from  # noqa: E402
from activeslam_gym.vision.track import track  # noqa: E402

from .vision_scene import LENS, TARGET, image_from, pose_at  # noqa: E402

CAMERA = camera_of(LENS.scenario())
POSES = [pose_at((0.05, 0.03, 0.69)), pose_at((-0.2, 0.1, 0.6), (0.1, -0.25, 0.1)), pose_at((0.1, -0.2, 0.9))]


def corners_from(pose: np.ndarray) -> np.ndarray:
    out = np.empty((4, 2))
    for z, point in zip(out, TARGET.fiducials):
        assert pixel_from_camera_point(CAMERA, rotation_matrix(pose[3:]).T @ (point - pose[:3]), z)
    return out


@pytest.mark.parametrize("pose", POSES)
def test_the_start_pose_is_recovered_from_exact_corners(pose) -> None:
    start = start_pose(CAMERA, TARGET.fiducials, corners_from(pose), 0.3)
    np.testing.assert_allclose(start.pose[:3], pose[:3], atol=1e-6)
    assert np.abs(rotation_error(pose[3:], start.pose[3:])).max() < 1e-6
    assert np.linalg.eigvalsh(start.covariance).min() > 0.0


def test_the_start_covariance_covers_the_errors_of_noisy_corners() -> None:
    rng, truth, nees = np.random.default_rng(1), POSES[1], []
    for _ in range(200):
        start = start_pose(CAMERA, TARGET.fiducials, corners_from(truth) + 0.2 * rng.standard_normal((4, 2)), 0.2)
        assert start.pose[2] > 0.0  # before the target, whichever of the two planar solutions is better
        error = np.concatenate((truth[:3] - start.pose[:3], rotation_error(truth[3:], start.pose[3:])))
        nees.append(error @ np.linalg.solve(start.covariance, error))
    assert 4.0 < np.median(nees) < 7.5  # chi-square of 6 dof: 5.35


@pytest.mark.parametrize("pose", POSES)
def test_corners_are_refined_below_the_pixel(pose) -> None:
    truth = corners_from(pose)
    found = refine_corners(image_from(pose, target=True, samples=8), CAMERA, np.rint(truth) + (1.0, -1.0))
    assert np.abs(found - truth).max() < 0.15  # the picture has 256 grey levels, and the texture an edge of its own


def test_no_target_is_an_error() -> None:
    with pytest.raises(ValueError, match="target"):
        refine_corners(np.full((240, 320), 90, np.uint8), CAMERA, corners_from(POSES[0]))


def test_the_drawn_target_is_the_pictured_one() -> None:
    image = image_from(POSES[1], target=True, samples=6)
    drawn, corners = drawn_target(image, CAMERA, TARGET, POSES[1])
    np.testing.assert_allclose(corners, corners_from(POSES[1]), atol=1e-9)
    assert np.abs(drawn - image).mean() < 0.1


@pytest.mark.parametrize(
    "change, word",
    [({"kind": "circle"}, "kind"), ({"width": -1.0}, "width"), ({"corners_px": {"top_left": [1, 2]}}, "top_right")],
)
def test_a_wrong_target_is_named(change, word) -> None:
    good = {"kind": "rectangle", "width": 0.2, "height": 0.1, "corners_px": dict.fromkeys(CORNERS, [1, 2])}
    assert target_from(good).fiducials.shape == (4, 3)
    with pytest.raises(ValueError, match=word):
        target_from({**good, **change})


@pytest.mark.parametrize(
    "change, word",
    [
        ({"focal_px": 0}, "focal_px"),
        ({"image_width": 1.5}, "image_width"),
        ({"distortion": 1.0}, "distortion"),
        ({"k": 1}, "k"),
    ],
)
def test_a_wrong_calibration_is_named(change, word) -> None:
    assert calibration_from(LENS._asdict()) == LENS
    with pytest.raises(ValueError, match=word):
        calibration_from({**LENS._asdict(), **change})


# Sources ----------------------------------------------------------------------------------------------------------


def write(path: Path, image: np.ndarray) -> None:
    assert cv2.imwrite(str(path), image)


def test_a_folder_and_a_pattern_give_times_and_images(tmp_path) -> None:
    for k in range(3):
        write(tmp_path / f"{k}.png", np.full((24, 32), 10 * k, np.uint8))
    for path in (tmp_path, tmp_path / "*.png"):
        frames = list(open_images(path, 10.0))
        assert [time for time, _ in frames] == [0.0, 0.1, 0.2]
        assert [int(image[0, 0]) for _, image in frames] == [0, 10, 20]


def test_a_video_is_read(tmp_path) -> None:
    path = tmp_path / "film.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"FFV1"), 30.0, (32, 24), False)
    if not writer.isOpened():
        pytest.skip("this OpenCV writes no FFV1")
    for k in range(4):
        writer.write(np.full((24, 32), 20 * k, np.uint8))
    writer.release()
    assert [int(image[3, 3]) for _, image in open_images(path, 30.0)] == [0, 20, 40, 60]


def test_what_is_wrong_with_images_is_said(tmp_path) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "film.mp4").write_bytes(b"no film")
    for path, word in (
        ("none.mp4", "there is no"),
        ("empty", "no picture"),
        ("*.bmp", "pattern"),
        ("film.mp4", "video"),
    ):
        with pytest.raises(SourceError, match=word):
            open_images(tmp_path / path, 30.0)
    with pytest.raises(ValueError, match="rate"):
        open_images(tmp_path, 0.0)


@pytest.mark.parametrize(
    "bad, word",
    [
        (np.zeros((20, 32), np.uint8), "32 x 20"),
        (np.dstack([np.full((24, 32), c, np.uint8) for c in (1, 2, 3)]), "colour"),
        (np.zeros((24, 32), np.uint16), "uint16"),
    ],
)
def test_images_before_a_bad_one_are_handed_out(tmp_path, bad, word) -> None:
    write(tmp_path / "0.png", np.zeros((24, 32), np.uint8))
    write(tmp_path / "1.png", bad)
    frames = open_images(tmp_path, 30.0)
    assert next(frames)[0] == 0.0
    with pytest.raises(SourceError, match=word):
        next(frames)


# The whole --------------------------------------------------------------------------------------------------------


def positions(count: int) -> list[np.ndarray]:
    return [
        pose_at((0.03 + 0.05 * np.sin(0.25 * k), 0.04 * (1 - np.cos(0.2 * k)), 0.7 - 0.002 * k)) for k in range(count)
    ]


@pytest.fixture(scope="module")
def sequence(tmp_path_factory) -> Path:
    """A folder with 25 images of a plane, calibration.json and target.json."""
    folder = tmp_path_factory.mktemp("sequence")
    (folder / "images").mkdir()
    poses = positions(25)
    for k, pose in enumerate(poses):
        write(folder / "images" / f"{k:03}.png", image_from(pose, target=True, samples=2))
    (folder / "calibration.json").write_text(json.dumps(LENS._asdict()))
    corners = dict(zip(CORNERS, np.rint(corners_from(poses[0])).tolist()))
    target = {"kind": "rectangle", "width": TARGET.width, "height": TARGET.height, "corners_px": corners}
    (folder / "target.json").write_text(json.dumps(target))
    assert read_calibration(folder / "calibration.json") == LENS
    np.testing.assert_allclose(read_target(folder / "target.json").corners_px, np.rint(corners_from(poses[0])))
    return folder


def test_a_rendered_plane_is_tracked_to_millimetres(sequence, tmp_path) -> None:
    done = track(sequence / "images", sequence / "calibration.json", sequence / "target.json", 30.0, tmp_path / "out")
    truth = np.array([pose[:3] for pose in positions(25)])
    assert done.trouble is None and len(done.times) == 25
    error = np.linalg.norm(done.cameras[5:, :3] - truth[5:], axis=1)
    assert error.max() < 0.015
    assert min(log.matched / log.searched for log in done.logs) > 0.8
    written = np.loadtxt(tmp_path / "out" / "trajectory.tum")
    np.testing.assert_allclose(written[:, 1:4], done.cameras[:, :3], atol=1e-6)
    assert np.abs(written[0, 4]) > 0.99  # x right, y down, z forward before the target: half a turn about X
    assert len((tmp_path / "out" / "frames.csv").read_text().splitlines()) == 25
    assert len((tmp_path / "out" / "map.csv").read_text().splitlines()) > 12


def test_a_film_shows_the_image_beside_the_map(sequence, tmp_path) -> None:
    files = [f"--{name}={sequence / name}.json" for name in ("calibration", "target")]
    assert main(["track", "--images", str(sequence / "images"), "--out", str(tmp_path), "--film", *files]) == 0
    film = cv2.VideoCapture(str(tmp_path / "film.mp4"))
    there, picture = film.read()
    assert there and picture.shape == (480, 1280, 3)
    coloured = np.ptp(picture.astype(int), axis=2) > 60
    assert coloured[:, :640].any() and (picture[:, 640:] > 200).mean() > 0.5
    assert int(film.get(cv2.CAP_PROP_FRAME_COUNT)) == len(list((sequence / "images").iterdir())) - 1


@contextmanager
def small_files(most: int) -> Iterator[None]:
    """No file may grow beyond so many bytes: as on a full disk, a write fails."""
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_film_on_a_full_disk_is_removed_and_the_track_kept(sequence, tmp_path, capsys) -> None:
    files = [f"--{name}={sequence / name}.json" for name in ("calibration", "target")]
    line = ["track", "--images", str(sequence / "images"), *files]
    assert main([*line, "--film", "--out", str(tmp_path / "whole")]) == 0
    capsys.readouterr()
    with small_files((tmp_path / "whole" / "film.mp4").stat().st_size // 2):
        assert main([*line, "--film", "--out", str(tmp_path / "full")]) == 2
    said = capsys.readouterr().err.splitlines()[-1]
    assert said.startswith(f"python -m activeslam_gym track: {tmp_path / 'full' / 'film.mp4'} cannot be written")
    assert sorted(path.name for path in (tmp_path / "full").iterdir()) == ["frames.csv", "map.csv", "trajectory.tum"]
    assert len(np.loadtxt(tmp_path / "full" / "trajectory.tum")) == 25


def test_a_track_on_a_full_disk_keeps_whole_lines(sequence, tmp_path, capsys) -> None:
    files = [f"--{name}={sequence / name}.json" for name in ("calibration", "target")]
    line = ["track", "--images", str(sequence / "images"), "--film", *files, "--out"]
    assert main([*line, str(tmp_path / "whole")]) == 0  # kernels are compiled, and written, in the meantime
    with small_files(1000):
        assert main([*line, str(tmp_path / "full")]) == 2
    assert "trajectory.tum cannot be written" in capsys.readouterr().err
    assert sorted(path.name for path in (tmp_path / "full").iterdir()) == ["frames.csv", "trajectory.tum"]
    assert 5 < len(np.loadtxt(tmp_path / "full" / "trajectory.tum")) < 25
    assert (tmp_path / "full" / "trajectory.tum").read_text().endswith("\n")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_sigterm_loses_no_track(sequence, tmp_path, number) -> None:
    """SIGTERM ends it as Ctrl-C does, with map, film and summary; even SIGKILL leaves the lines written so far."""
    there = sorted((sequence / "images").iterdir())
    (tmp_path / "images").mkdir()
    for k, path in enumerate(islice(chain.from_iterable(repeat(there + there[::-1])), 3000)):  # half a minute or more
        (tmp_path / "images" / f"{k:04}.png").symlink_to(path)
    files = [f"--{name}={sequence / name}.json" for name in ("calibration", "target")]
    line = ["track", "--images", str(tmp_path / "images"), *files, "--film", "--out", str(tmp_path / "out")]
    frames, poses = (tmp_path / "out" / name for name in ("frames.csv", "trajectory.tum"))
    command = [sys.executable, "-m", "activeslam_gym", *line]
    root = Path(__file__).resolve().parents[1]
    with subprocess.Popen(command, cwd=root, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        while process.poll() is None and not (frames.exists() and frames.read_text().count("\n") > 10):
            time.sleep(0.05)
        running = process.poll() is None
        process.send_signal(number)
        out, err = process.communicate(timeout=60)
    written = np.loadtxt(poses)
    assert running and 10 < len(written) < 3000 and poses.read_text().endswith("\n")
    assert abs(frames.read_text().count("\n") - len(written)) <= 1  # the last image may have one of the two
    if number == signal.SIGKILL:
        return
    assert process.returncode == 1 and err.endswith("track: ended early: interrupted\n")
    assert int(out.split(" images; ")[0]) - len(written) in (0, 1) and f"results in {tmp_path / 'out'}" in out
    assert len((tmp_path / "out" / "map.csv").read_text().splitlines()) > 12
    film = cv2.VideoCapture(str(tmp_path / "out" / "film.mp4"))
    assert film.isOpened() and abs(film.get(cv2.CAP_PROP_FRAME_COUNT) - len(written)) <= 2


def test_what_was_tracked_before_trouble_is_kept(sequence, tmp_path, capsys) -> None:
    folder = tmp_path / "images"
    folder.mkdir()
    for k in range(4):
        (folder / f"{k}.png").write_bytes((sequence / "images" / f"{k:03}.png").read_bytes())
    (folder / "4.png").write_bytes(b"no picture")
    given = ["--images", str(folder), "--out", str(tmp_path / "out")]
    files = [f"--{name}={sequence / name}.json" for name in ("calibration", "target")]
    assert main(["track", *given, *files]) == 1
    assert "4.png" in capsys.readouterr().err
    assert len((tmp_path / "out" / "trajectory.tum").read_text().splitlines()) == 4


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"calibration": "none.json"}, "none.json"),
        ({"target": "calibration.json"}, "lacks corners_px"),
        ({"images": "nowhere"}, "there is no"),
        ({"rate": "0"}, "rate must be a positive number of images a second, got 0.0"),
        ({"rate": "inf"}, "rate"),
        ({"out": "target.json"}, "target.json"),
        ({"images": "flat"}, "target"),
    ],
)
def test_bad_input_is_one_line_and_no_track(sequence, capsys, change, said) -> None:
    (sequence / "flat").mkdir(exist_ok=True)
    write(sequence / "flat" / "0.png", np.full((240, 320), 90, np.uint8))
    given = {"calibration": "calibration.json", "target": "target.json", "images": "images", "out": "out", **change}
    line = [f"--{name}={value if name == 'rate' else sequence / value}" for name, value in given.items()]
    assert main(["track", *line]) == 2
    error = capsys.readouterr().err
    assert error.startswith("python -m activeslam_gym track: ") and said in error and error.count("\n") == 1


def test_without_opencv_the_extra_is_named(sequence, tmp_path, capsys, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "cv2", None)
    files = [f"--{name}={sequence / name}.json" for name in ("calibration", "target")]
    assert main(["track", "--images", str(sequence / "images"), "--out", str(tmp_path / "out"), *files]) == 1
    assert capsys.readouterr().err.endswith("pip install -e '.[vision]'\n")
