"""Starts without a target that have two answers, or none: right, or uncertain by the track's own word."""

import json

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

cv2 = pytest.importorskip("cv2", reason="the extra `vision` is not installed")

from activeslam_gym.__main__ import main
from activeslam_gym.camera import camera_of
from activeslam_gym.config import Scenario
from activeslam_gym.motion import CAMERA_SIZE, QUATERNION
from activeslam_gym.vision.bundle import Bundle, Geometry, inverse_depths, tangents
from activeslam_gym.vision.calibration import Calibration
from activeslam_gym.vision.room.camera import RoomCamera
from activeslam_gym.vision.sources import Frame
from activeslam_gym.vision.track import AT_REST, UNCERTAIN, Track, follow, summary
from studies.excerpts import _ROOM as ROOM
from tests.vision_scene import LENS, image_from, pose_at

SIZE = (640, 480)


def lens_of(focal: float) -> Calibration:
    """A pinhole."""
    return Calibration(*SIZE, focal, 319.5, 239.5, 0.0)


def flown(lens: Calibration, cameras: np.ndarray, seed: int = 5) -> Track:
    """The track through images of a rendered room."""
    room = RoomCamera(ROOM, camera_of(Scenario(**lens._asdict())), np.random.SeedSequence(seed))
    return follow([(k / 30.0, room.photograph(camera, k)) for k, camera in enumerate(cameras)], lens, None, 30.0)


def turn_errors(done: Track, cameras: np.ndarray) -> np.ndarray:
    """Of the rotations since the first image [rad]."""
    found, truth = (Rotation.from_quat(np.roll(one[:, QUATERNION], -1, axis=1)) for one in (done.cameras, cameras))
    return ((found[0].inv() * found).inv() * (truth[0].inv() * truth)).magnitude()


def at_rest(count: int) -> np.ndarray:
    """Cameras (count, 13) that look along Z."""
    cameras = np.zeros((count, CAMERA_SIZE))
    cameras[:, 3] = 1.0
    return cameras


@pytest.mark.parametrize("focal", [600.0, 900.0])
def test_a_slide_past_a_wall_is_no_turn_and_a_lens_of_less_than_50_degrees_is_never_certain(focal: float) -> None:
    cameras = at_rest(100)
    cameras[:, 0] = 0.2 * np.clip(np.arange(100) / 30.0 - 0.3, 0.0, None)
    cameras[10:, 7] = 0.2
    done = flown(lens_of(focal), cameras)
    assert not done.lost.any()
    assert done.start_certain == (focal < 650.0) and (UNCERTAIN in summary(done)) != done.start_certain
    assert turn_errors(done, cameras).max() < np.radians(1.0)
    ways = done.cameras[:, :3] - done.cameras[0, :3]
    assert np.linalg.norm(ways[-1, 1:]) < 0.05 * np.linalg.norm(ways[-1])


def test_a_start_in_motion_is_right() -> None:
    cameras, time = at_rest(60), np.arange(60) / 30.0
    cameras[:, 0], cameras[:, 1] = 0.5 * time, 0.1 * np.sin(3.0 * time)
    turns = Rotation.from_rotvec(np.stack((0.1 * np.sin(2.0 * time), -0.5 * time, 0.0 * time), axis=-1))
    cameras[:, QUATERNION] = np.roll(turns.as_quat(), 1, axis=1)
    done = flown(lens_of(400.0), cameras)
    assert done.start_certain and done.logs[0].start_certain
    assert turn_errors(done, cameras).max() < np.radians(0.5)


def test_an_object_that_moves_is_no_motion_of_the_camera() -> None:
    rng = np.random.default_rng(3)

    def textured(height: int, width: int) -> np.ndarray:
        waves = (
            cv2.resize(rng.normal(0, a, (height // s, width // s)), (width, height)) for s, a in ((40, 30), (8, 25))
        )
        return np.clip(128.0 + sum(waves), 0, 255)

    wall, thing, images = textured(480, 640), textured(240, 300), list[Frame]()
    for k in range(60):
        image, x = wall.copy(), 60 + 3 * max(k - 5, 0)
        image[120:360, x : x + 300] = thing
        images.append((k / 30.0, np.clip(image + rng.normal(0, 2, image.shape), 0, 255).astype(np.uint8)))
    done = follow(images, lens_of(527.0), None, 30.0)
    assert not done.start_certain and AT_REST in summary(done)
    assert np.abs(done.cameras[:, :3]).max() == 0.0 and turn_errors(done, at_rest(60)).max() < np.radians(0.2)


def test_a_camera_at_rest_ends_uncertain_in_every_output(tmp_path, capsys) -> None:
    (tmp_path / "images").mkdir()
    for k in range(4):
        cv2.imwrite(str(tmp_path / "images" / f"{k}.png"), image_from(pose_at((0.0, 0.0, 0.6)), samples=1))
    (tmp_path / "lens.json").write_text(json.dumps(LENS._asdict()))
    given = ["--images", str(tmp_path / "images"), "--calibration", str(tmp_path / "lens.json")]
    assert main(["track", *given, "--out", str(tmp_path), "--film"]) == 3
    told = capsys.readouterr()
    assert AT_REST in told.out and UNCERTAIN in told.err
    header, *rows = (line.split(",") for line in (tmp_path / "frames.csv").read_text().splitlines())
    assert [row[header.index("start_certain")] for row in rows] == ["0"] * 3
    poses = np.loadtxt(tmp_path / "trajectory.tum")
    assert poses.shape == (4, 8) and np.abs(poses[:, 1:4]).max() == 0.0


@pytest.fixture
def problem() -> tuple[Bundle, Geometry]:
    """Four cameras, nine points, of which one camera does not see one, with noise; and the truth."""
    rng = np.random.default_rng(1)
    turns, places = (np.vstack((np.zeros(3), rng.normal(0.0, 0.1, (3, 3)))) for _ in range(2))
    d = np.column_stack((rng.normal(0.0, 0.5, (9, 2)), np.ones(9)))
    d /= np.linalg.norm(d, axis=1)[:, None]
    truth = Geometry(Rotation.from_rotvec(turns).as_matrix(), places, d, rng.uniform(0.5, 2.5, 9)).in_unit()
    z = (truth.d - truth.rho[:, None] * truth.p[:, None]) @ truth.R_WC + 1e-4 * rng.standard_normal((4, 9, 3))
    z /= np.linalg.norm(z, axis=-1, keepdims=True)
    z[1, 3] = np.nan
    return Bundle(z, np.full((4, 9), 1e-4)), truth


def test_the_gradient_of_the_adjustment_is_that_of_its_cost(problem) -> None:
    bundle, x = problem
    _, g = bundle.normal_equations(x)
    kept = np.setdiff1d(np.arange(len(g)), np.arange(18 + 2, len(g), 3))  # others change the unit
    for i in kept:
        step = 1e-7 * np.eye(len(g))[i]
        slope = (bundle.cost(x.moved(step)) - bundle.cost(x.moved(-step))) / 4e-7
        assert abs(slope - g[i]) < 1e-4 * np.abs(g).max()


def test_the_adjustment_is_that_of_scipy(problem) -> None:
    """Whose `least_squares`, by sparse differences, takes over fifteen times as long for a start."""
    bundle, truth = problem
    start = truth.moved(np.random.default_rng(2).normal(0.0, 0.02, 18 + 27))
    found, cost = bundle.fit(start, 40)

    def residuals(step: np.ndarray) -> np.ndarray:
        e = bundle._residuals(start.moved(step))[0]
        square = np.maximum((e**2).sum(axis=-1, keepdims=True), 1e-12)
        return (e * np.sqrt(4.0 * np.log1p(square / 4.0) / square)).ravel()

    fit = least_squares(residuals, np.zeros(18 + 27))
    assert abs(2.0 * fit.cost - cost) < 0.01 * cost
    assert np.abs(start.moved(fit.x).p - found.p).max() < 1e-3


def test_tangents_and_depths() -> None:
    d = np.random.default_rng(3).standard_normal((20, 3))
    d /= np.linalg.norm(d, axis=1)[:, None]
    frames = np.concatenate((d[..., None], tangents(d)), axis=-1)
    np.testing.assert_allclose(np.swapaxes(frames, -1, -2) @ frames, np.tile(np.eye(3), (20, 1, 1)), atol=1e-12)
    rho, p = np.linspace(0.1, 2.0, 20), np.array((0.1, -0.2, 0.05))
    last = d - rho[:, None] * p
    np.testing.assert_allclose(inverse_depths(d, last / np.linalg.norm(last, axis=1)[:, None], p), rho, atol=1e-9)
