"""The target and its pose, the sources' errors, and a short track of a rendered plane."""

import json
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import chain, count, islice, repeat
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

cv2 = pytest.importorskip("cv2", reason="the extra `vision` is not installed")

from activeslam_gym.__main__ import main, parser
from activeslam_gym.geometry import rotation_error
from activeslam_gym.slam.belief import SPARE_FEATURES
from activeslam_gym.vision import film
from activeslam_gym.vision.calibration import Calibration
from activeslam_gym.vision.first_sight import start_pose
from activeslam_gym.vision.frontend import FrameLog
from activeslam_gym.vision.other_lenses import lens_from
from activeslam_gym.vision.report import Agreement, TrackFiles
from activeslam_gym.vision.room.camera import RoomCamera
from activeslam_gym.vision.settings import TRACK_FEATURES, FrontEndSettings
from activeslam_gym.vision.sources import Frame, images_of
from activeslam_gym.vision.target import read_target
from activeslam_gym.vision.track import follow, scenario_of, summary, track
from activeslam_gym.vision.views import projected, reduced
from studies.excerpts import _ROOM as EXCERPTS
from tests.vision_scene import (
    CAMERA,
    LENS,
    TARGET,
    covered,
    enlarged,
    image_from,
    path,
    photographed,
    pose_at,
    target_fields,
    texture,
    with_target,
)  # fmt: skip


def corners_from(pose: np.ndarray) -> np.ndarray:
    return projected(CAMERA, pose, TARGET.fiducials)


def test_the_start_covariance_covers_the_errors_of_noisy_corners() -> None:
    rng, truth, nees = np.random.default_rng(1), pose_at((-0.2, 0.1, 0.6), (0.1, -0.25, 0.1)), []
    for _ in range(200):
        corners = corners_from(truth) + 0.2 * rng.standard_normal((4, 2))
        pose, covariance = start_pose(CAMERA, TARGET.fiducials, corners, 0.2)
        assert pose[2] > 0.0  # before the target, whichever of the two planar solutions is better
        error = np.concatenate((truth[:3] - pose[:3], rotation_error(truth[3:], pose[3:])))
        nees.append(error @ np.linalg.solve(covariance, error))
    assert 4.0 < np.median(nees) < 7.5  # chi-square of 6 dof: 5.35


def write(path: Path, image: np.ndarray) -> None:
    assert cv2.imwrite(str(path), image)


def test_images_in_colour_are_read_as_grey(tmp_path) -> None:
    grey = np.arange(24 * 32, dtype=np.uint16).reshape(24, 32).astype(np.uint8)
    write(tmp_path / "0.png", np.dstack([grey] * 3))
    write(tmp_path / "1.png", np.dstack([np.full((24, 32), value, np.uint8) for value in (40, 80, 200)]))
    (_, same), (_, mixed) = images_of(tmp_path, 30.0).frames
    np.testing.assert_array_equal(same, grey)
    assert (mixed == round(0.114 * 40 + 0.587 * 80 + 0.299 * 200)).all()


@pytest.fixture(scope="module")
def sequence(tmp_path_factory) -> Path:
    """A folder with 25 images of a plane, calibration.json and target.json."""
    folder = tmp_path_factory.mktemp("sequence")
    (folder / "images").mkdir()
    for k, pose in enumerate(path(25)):
        write(folder / "images" / f"{k:03}.png", image_from(pose, target=True, samples=2))
    (folder / "calibration.json").write_text(json.dumps(LENS._asdict()))
    (folder / "target.json").write_text(json.dumps(target_fields(path(1)[0])))
    assert lens_from(folder / "calibration.json")[0] == LENS
    np.testing.assert_allclose(read_target(folder / "target.json").corners_px, np.rint(corners_from(path(1)[0])))
    return folder


def command(sequence: Path, out: Path, images: Path | None = None, *more: str) -> list[str]:
    """The command line that tracks the ``sequence`` into ``out``."""
    files = [f"--{name}={sequence / name}.json" for name in ("calibration", "target")]
    return ["track", f"--images={images or sequence / 'images'}", *files, f"--out={out}", *more]


def test_a_rendered_plane_is_tracked_to_millimetres(sequence, tmp_path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "film.mp4").write_text("of a track before")
    done, _ = track(parser().parse_args(command(sequence, tmp_path / "out")))
    assert done.trouble is None and len(done.times) == 25
    error = np.linalg.norm(done.cameras[5:, :3] - np.array(path(25))[5:, :3], axis=1)
    assert error.max() < 0.015
    assert min(log.matched / log.searched for log in done.logs) > 0.8
    assert done.filter.expected_inverse_depth[0] > 1.0  # the plane is 0.7 m away; before the first features it was 0.75
    written = np.loadtxt(tmp_path / "out" / "trajectory.tum")
    np.testing.assert_allclose(written[:, 1:4], done.cameras[:, :3], atol=1e-6)
    assert np.abs(written[0, 4]) > 0.99  # x right, y down, z forward before the target: half a turn about X
    assert len((tmp_path / "out" / "frames.csv").read_text().splitlines()) == 26
    assert len((tmp_path / "out" / "map.csv").read_text().splitlines()) > 12
    assert not (tmp_path / "out" / "film.mp4").exists()


def test_a_track_that_is_mostly_lost_says_so_and_withholds_poses(sequence, tmp_path, capsys) -> None:
    """After six images there are eight dark ones."""
    rng, darkening = np.random.default_rng(1), tmp_path / "darkening"
    darkening.mkdir()
    for k in range(6):
        (darkening / f"{k:02}.png").symlink_to(sequence / "images" / f"{k:03}.png")
    for k in range(6, 14):
        write(darkening / f"{k:02}.png", rng.integers(0, 12, (240, 320), np.uint8))
    assert main(command(sequence, tmp_path, darkening)) == 3
    said = capsys.readouterr()
    assert "lost in 8 images, first at 0.20 s" in said.out
    assert "track: lost: 6 of 14 images were tracked; a lost image is dark" in said.err.splitlines()[-1]
    header, *rows = (line.split(",") for line in (tmp_path / "frames.csv").read_text().splitlines())
    assert [row[header.index("lost")] for row in rows] == ["0"] * 6 + ["1"] * 8
    assert len(np.loadtxt(tmp_path / "trajectory.tum")) == 6
    done, _ = track(parser().parse_args(command(sequence, tmp_path, darkening, "--keep-lost")))
    assert len(np.loadtxt(tmp_path / "trajectory.tum")) == 14 and done.lost.tolist() == [False] * 6 + [True] * 8
    in_the_dark, before = (np.linalg.det(done.covariances[k, :3, :3]) for k in (13, 5))
    assert in_the_dark > 10.0**3 * before


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


def test_a_track_on_a_full_disk_keeps_whole_lines(sequence, tmp_path, capsys) -> None:
    assert main(command(sequence, tmp_path / "before", None, "--film")) == 0  # kernels are compiled, and written
    out = tmp_path / "out"
    with small_files(1000):
        assert main(command(sequence, out, None, "--film")) == 2
    assert "trajectory.tum cannot be written" in capsys.readouterr().err
    assert sorted(path.name for path in out.iterdir()) == ["frames.csv", "trajectory.tum"]
    assert 5 < len(np.loadtxt(out / "trajectory.tum")) < 25
    assert (out / "trajectory.tum").read_text().endswith("\n")


def test_sigterm_loses_no_track(sequence, tmp_path) -> None:
    """It ends a track as Ctrl-C does, with map, film and summary; what is over is on disk while the track goes on."""
    there = sorted((sequence / "images").iterdir())
    (tmp_path / "images").mkdir()
    for k, image in enumerate(islice(chain.from_iterable(repeat(there + there[::-1])), 3000)):  # half a minute or more
        (tmp_path / "images" / f"{k:04}.png").symlink_to(image)
    frames, poses = (tmp_path / "out" / name for name in ("frames.csv", "trajectory.tum"))
    line = [sys.executable, "-m", "activeslam_gym", *command(sequence, tmp_path / "out", tmp_path / "images", "--film")]
    root = Path(__file__).resolve().parents[2]
    with subprocess.Popen(line, cwd=root, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        while process.poll() is None and not (frames.exists() and frames.read_text().count("\n") > 12):
            time.sleep(0.05)
        running = process.poll() is None
        process.send_signal(signal.SIGTERM)
        out, err = process.communicate(timeout=60)
    written = np.loadtxt(poses)
    assert running and 10 < len(written) < 3000 and poses.read_text().endswith("\n")
    assert abs(frames.read_text().count("\n") - len(written)) <= 1  # the last image may have one of the two
    assert process.returncode == 1 and err.endswith("track: ended early: interrupted\n")
    assert int(out.split(" images; ")[0]) - len(written) in (0, 1) and f"results in {tmp_path / 'out'}" in out
    assert len((tmp_path / "out" / "map.csv").read_text().splitlines()) > 12
    film = cv2.VideoCapture(str(tmp_path / "out" / "film.mp4"))
    assert film.isOpened() and abs(film.get(cv2.CAP_PROP_FRAME_COUNT) - len(written)) <= 2


def test_the_track_before_trouble_is_kept(sequence, tmp_path, capsys) -> None:
    (tmp_path / "images").mkdir()
    for k in range(4):
        (tmp_path / "images" / f"{k}.png").symlink_to(sequence / "images" / f"{k:03}.png")
    (tmp_path / "images" / "4.png").write_bytes(b"no picture")
    assert main(command(sequence, tmp_path / "out", tmp_path / "images")) == 1
    assert "4.png" in capsys.readouterr().err
    assert len((tmp_path / "out" / "trajectory.tum").read_text().splitlines()) == 4


def test_the_belief_is_what_its_judge_reads(tmp_path) -> None:
    """Errors drawn from covariances in the world's axes have the NEES that `smfeval` expects of consistent ones."""
    smfeval = pytest.importorskip("smfeval.cli.main", reason="the extra `dev` is not installed")
    rng, half = np.random.default_rng(0), Rotation.from_matrix(np.diag((-1.0, -1.0, 1.0)))
    P = np.diag(np.square((0.1, 0.01, 0.03, 0.02, 0.002, 0.006)))
    P[0, 4] = P[4, 0] = 0.9 * 0.1 * 0.002
    files, truth = TrackFiles(tmp_path, metric=True, belief=True), []
    for k, turn in enumerate(Rotation.random(1000, random_state=1)):
        error, place = rng.multivariate_normal(np.zeros(6), P), rng.uniform(-1.0, 1.0, 3)
        files.add(0.1 * k, np.concatenate((place, np.roll(turn.as_quat(), 1))), None, P)
        true = Rotation.from_rotvec(error[3:]) * turn * half
        truth.append((0.1 * k, *(place + error[:3]), *true.as_quat()))
    files.close()
    np.savetxt(tmp_path / "truth.tum", truth, fmt="%.9f")
    belief, reference, report = (str(tmp_path / name) for name in ("belief.square", "truth.tum", "report.json"))
    assert not smfeval.main(["validate", "--strict", belief])
    smfeval.main(["score", belief, reference, "--ref-body-frame", "camera", "--calibration", "--json-out", report])
    judged = json.loads(Path(report).read_text())["calibration_split"]["absolute"]["translation"]
    assert judged["verdict"] == "consistent" and 2.1 < judged["nees_median"] < 2.65


def test_a_long_film_draws_a_thinned_way_to_the_present(monkeypatch) -> None:
    monkeypatch.setattr(film, "_WAY", 8)
    way = list[int]()
    for k in range(100):
        film.lengthen(way, k, k)
        assert way == [*range(0, k, 2 ** int(np.ceil(np.log2(max(k / 8, 1))))), k]


def test_times_may_begin_anywhere(sequence) -> None:
    images = [image for _, image in images_of(sequence / "images").frames][:6]
    target = read_target(sequence / "target.json")
    from_0, later = (follow(zip(count(first, 1 / 32), images), LENS, target, 32.0) for first in (0.0, 2.0**30))
    np.testing.assert_array_equal(later.cameras, from_0.cameras)
    assert not follow(zip(count(0.0, 0.5), images), LENS, target, 2.0).lost.any()


IMAGES = [image_from(pose, samples=2) for pose in path(12)]


def test_images_of_other_sizes_of_the_same_scene_are_tracked_alike() -> None:
    expected = follow(zip(count(0.0, 1 / 30), IMAGES), LENS, None, 30.0)
    small, large = [reduced(one, 2) for one in IMAGES], [one.repeat(2, axis=0).repeat(2, axis=1) for one in IMAGES]
    for lens, images in ((LENS.reduced(2), small), (enlarged(LENS, 2), large)):
        found = follow(zip(count(0.0, 1 / 30), images), lens, None, 30.0)
        assert not found.lost.any() and found.filter.camera.width == LENS.image_width
        np.testing.assert_allclose(found.cameras[:, :7], expected.cameras[:, :7], atol=0.02)


def test_what_hides_the_scene_and_moves_with_the_target_is_no_silent_error() -> None:
    """From 0.27 s on a picture lies before most of the view, the target too, and goes to the right."""
    poses = path(60, approach=0.001)
    images = [image_from(pose, target=True, samples=2) for pose in poses]
    target = TARGET._replace(corners_px=corners_from(poses[0]))
    right, wrong = (follow(zip(count(0.0, 1 / 30), shown), LENS, target, 30.0) for shown in (images, covered(images)))
    assert right.start_certain and not right.doubt and "contradicts" not in summary(right)
    assert np.linalg.norm(wrong.cameras[:, :3] - np.array(poses)[:, :3], axis=1).max() > 0.1
    assert not wrong.start_certain and "the map contradicts the images from 0.27 s on" in summary(wrong)


def test_a_jerk_from_which_the_map_returns_with_few_changes_is_no_contradiction() -> None:
    """Unlike a cut, after which the map is matched again since other features have taken the place of all."""
    log = FrameLog(0.0, 45, 35, 31, 30, 1, 0, 0, True, False, False, True, 2.0)
    for initialised, deletions, holds in ((0, 0, True), (0, 2, True), (4, 1, True), (4, 7, False), (12, 0, False)):
        agreement, unseen = Agreement(), log._replace(matched=3)
        changed = log._replace(matched=11, initialised=initialised, deletions=deletions)
        certain = [agreement.judged(one).start_certain for one in (log, unseen, changed, log)]
        assert certain == [True, False, False, holds]


@pytest.mark.parametrize("strayed, holds", [(0.0, True), (0.3, True), (0.6, False)])
def test_features_that_noise_hides_contradict_no_map_and_those_that_stray_do(strayed, holds) -> None:
    for metric, deletions in ((True, 3), (False, 1)):
        log = FrameLog(0.0, 45, 35, 31, 30, 1, 3, deletions, True, False, False, True, 2.0)
        agreement = Agreement(metric)
        certain = [agreement.judged(log, strayed).start_certain for _ in range(90)]
        assert certain[0] and certain[-1] == holds


def test_images_that_repeat_the_one_before_have_its_pose_and_tell_of_no_rest() -> None:
    """For half a second a picture stands still, while the camera goes on."""
    poses = path(40, approach=0.001)
    images = [image_from(pose, target=True, samples=2) for pose in poses]
    target = TARGET._replace(corners_px=corners_from(poses[0]))
    done = follow(zip(count(0.0, 1 / 30), [*images[:20], *[images[20]] * 15, *images[35:]]), LENS, target, 30.0)
    assert done.repeated == 14 and "14 repeat the image before and have its pose" in summary(done)
    assert (done.cameras[20:35] == done.cameras[20]).all() and len(done.times) == 40
    shown = np.array([*poses[:20], *[poses[20]] * 15, *poses[35:]])
    assert not done.lost.any() and np.linalg.norm(done.cameras[:, :3] - shown[:, :3], axis=1).max() < 0.03


def test_a_target_that_is_moved_contradicts_the_map_though_no_corner_is_matched() -> None:
    def plane(X: np.ndarray, moved: float) -> np.ndarray:
        return np.where(np.abs(X[..., 0]) < 0.24, with_target(X - (moved, 0.0)), texture(X))

    poses = path(38)
    images = [photographed(pose, lambda X, k=k: plane(X, 0.06 * (k >= 12)), 1) for k, pose in enumerate(poses)]
    target = TARGET._replace(corners_px=corners_from(poses[0]))
    done = follow([(k / 30.0, image) for k, image in enumerate(images)], LENS, target, 30.0)
    assert not done.start_certain and "the map contradicts the images from 0." in done.doubt
    assert np.linalg.norm(done.cameras[-1, :3] - poses[-1][:3]) < 0.03, "the map is right"


def test_a_rolling_shutter_is_corrected_by_its_readout_time() -> None:
    """A camera slides and turns to and fro, by up to 57 degrees a second, while its rows are read within 30 ms."""
    lens, readout, band = Calibration(320, 240, 200.0, 159.5, 119.5, 0.0), 0.03, 16
    room = RoomCamera(EXCERPTS, lens.camera, np.random.SeedSequence(6))

    def state_at(time: float) -> np.ndarray:
        x, turn = 0.2 * np.sin(1.5 * time), Rotation.from_rotvec((0.0, 0.25 * np.sin(4.0 * time), 0.0))
        return np.concatenate(((x, 0.0, 0.0), np.roll(turn.as_quat(), 1), np.zeros(6)))

    def image_at(k: int) -> np.ndarray:
        image = np.zeros((240, 320), np.uint8)
        for top in range(0, 240, band):
            own, rows = k / 30.0 + readout * ((top + 0.5 * band) / 240 - 0.5), slice(top, top + band)
            image[rows] = room.photograph(state_at(own), k, np.array([[0, 319, top, top + band - 1]]))[rows]
        return image

    images, errors = [(k / 30.0, image_at(k)) for k in range(60)], list[float]()
    truth = Rotation.from_quat(np.roll([state_at(time)[3:7] for time, _ in images], -1, axis=1))
    for given in (0.0, readout):
        done = follow(images, lens, None, 30.0, FrontEndSettings(readout=given))
        found = Rotation.from_quat(np.roll(done.cameras[:, 3:7], -1, axis=1))
        errors.append(((found[0].inv() * found).inv() * (truth[0].inv() * truth)).magnitude().max())
    assert errors[1] < np.radians(0.6) and errors[0] > 3.0 * errors[1], np.degrees(errors)


def test_a_track_keeps_the_places_of_a_minute_and_the_live_page_those_of_a_desk(sequence, tmp_path) -> None:
    assert parser().parse_args(command(sequence, tmp_path)).features == TRACK_FEATURES == 200
    assert scenario_of(LENS, True, 30.0).landmark_count + SPARE_FEATURES == 49


def test_a_full_map_says_how_many_features_made_room(sequence) -> None:
    frames = [(k / 30.0, image_from(pose, target=True, samples=2)) for k, pose in enumerate(path(25))]
    done = follow(frames, LENS, read_target(sequence / "target.json"), 30.0)
    assert done.displaced == 0 and "made room" not in summary(done)
    full = done._replace(displaced=done.filter.capacity + 1)
    assert f"{full.displaced} features made room for others: with more --features" in summary(full)


def test_rows_of_a_turned_picture_have_no_readout_time(sequence, tmp_path, capsys) -> None:
    (upright := tmp_path / "upright").mkdir()
    for k in range(2):
        tag = Image.Exif()
        tag[0x0112] = 6  # shown turned to the right
        stored = np.rot90(image_from(path(2)[k], target=True, samples=2))
        Image.fromarray(stored).save(upright / f"{k}.png", exif=tag)
    assert main(command(sequence, tmp_path / "out", upright)) == 0
    assert main(command(sequence, tmp_path / "out", upright, "--readout=0.01")) == 2
    assert "got 240 x 320" in capsys.readouterr().err


def swung(lens: Calibration) -> list[Frame]:
    """Images of a camera that slides and turns to and fro."""
    room, images = RoomCamera(EXCERPTS, lens.camera, np.random.SeedSequence(6)), list[Frame]()
    for at in np.arange(100) / 30.0:
        turn = Rotation.from_rotvec((0.1 * np.sin(3.0 * at), 0.4 * np.sin(2.0 * at), 0.0))
        state = np.concatenate(((0.3 * np.sin(1.5 * at), 0.0, 0.0), np.roll(turn.as_quat(), 1), np.zeros(6)))
        images.append((at, room.photograph(state, len(images))))
    return images


def test_a_wrong_focal_length_of_the_calibration_is_told_and_a_right_one_is_not() -> None:
    """The calibration's focal length is 5 % too long, right, 5 % too short."""
    lens = Calibration(320, 240, 200.0, 159.5, 119.5, 0.0)
    images = swung(lens)
    for ratio in (1.05, 1.0, 0.95):
        done = follow(images, lens._replace(focal_px=ratio * lens.focal_px), None, 30.0)
        assert (done.misfit is not None) == (ratio != 1.0) and done.start_certain
        assert ("times the focal length of the calibration" in done.doubt) == (ratio != 1.0)
        assert done.misfit is None or abs(ratio * done.misfit[0] - 1.0) < 0.02
        assert done.bent is None


@pytest.mark.parametrize(("distortion", "calibrated"), [(6e-6, 0.0), (6e-6, 6e-6), (6e-6, 8e-6)])
def test_a_wrong_distortion_of_the_calibration_is_told_and_a_right_one_is_not(distortion, calibrated) -> None:
    lens = Calibration(320, 240, 200.0, 159.5, 119.5, distortion)
    done = follow(swung(lens), lens._replace(distortion=calibrated), None, 30.0)
    assert (done.bent is not None) == (distortion != calibrated)
    assert ("check its model and distortion" in done.doubt) == (distortion != calibrated)
    assert done.bent is None or (done.bent[0] > 1.0) == (calibrated > distortion)
