"""Starts from boards of markers, and without any target."""

import json
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial import procrustes
from scipy.spatial.transform import Rotation

cv2 = pytest.importorskip("cv2", reason="the extra `vision` is not installed")

from activeslam_gym.__main__ import main
from activeslam_gym.camera import camera_of
from activeslam_gym.geometry import quaternion_exp, rotation_error, rotation_matrix
from activeslam_gym.live.source import ROOM
from activeslam_gym.motion import CAMERA_SIZE, QUATERNION
from activeslam_gym.vision.bundle import Bundle, Geometry
from activeslam_gym.vision.calibration import Calibration
from activeslam_gym.vision.first_sight import seen_corners, start_pose
from activeslam_gym.vision.frontend import FrontEnd
from activeslam_gym.vision.report import TURNED
from activeslam_gym.vision.room.camera import RoomCamera
from activeslam_gym.vision.sources import Frame
from activeslam_gym.vision.start import Start
from activeslam_gym.vision.target import CORNERS, FACING, target_from
from activeslam_gym.vision.track import AT_REST, NARROW, SEVERAL, UNCERTAIN, Track, follow, scenario_of, start, summary
from activeslam_gym.vision.views import pixels_of, projected
from studies.excerpts import _ROOM as EXCERPTS
from tests import vision_scene
from tests.vision_scene import CAMERA, CHARUCO, LENS, TARGET, board_on_the_plane, enlarged, image_from, path, pose_at

APRILTAG = {"kind": "apriltag", "columns": 3, "rows": 2, "tag": 0.08, "gap": 0.02, "dictionary": "36h11"}
POSES = [
    pose_at((0.03, 0.02, 0.35)),
    pose_at((-0.12, 0.06, 0.33), (0.1, -0.3, 0.1)),
    pose_at((0.0, 0.0, 0.36), (0, 0, 2.0)),
]
RECTANGLE: dict[str, Any] = vision_scene.target_fields(POSES[0])
SCENARIO = scenario_of(LENS, True, 30.0)
CORNERS_PX = list(RECTANGLE["corners_px"].values())
both_kinds = pytest.mark.parametrize("fields", [CHARUCO, APRILTAG], ids=lambda fields: fields["kind"])


@both_kinds
@pytest.mark.parametrize("pose", POSES)
def test_the_pose_is_recovered_from_a_board_that_finds_itself(fields, pose) -> None:
    board = target_from(fields)
    points, pixels = seen_corners(board_on_the_plane(board, pose), CAMERA, board)
    assert len(points) >= 6
    assert np.abs(pixels - projected(CAMERA, pose, points)).max() < 0.4
    found, covariance = start_pose(CAMERA, points, pixels, 0.35)
    error = np.concatenate((pose[:3] - found[:3], rotation_error(pose[3:], found[3:])))
    assert np.linalg.norm(error[:3]) < 0.004 and np.abs(error[3:]).max() < 0.012, error
    assert error @ np.linalg.solve(covariance, error) < 22.5, "the 99.9th percentile of 6 degrees of freedom"


def test_a_part_of_the_board_is_enough_and_a_sliver_is_not() -> None:
    board = target_from(CHARUCO)
    image = board_on_the_plane(board, POSES[0])
    image[:, 190:] = 128
    points, pixels = seen_corners(image, CAMERA, board)
    assert 6 <= len(points) < len(board.points)
    assert np.abs(pixels - projected(CAMERA, POSES[0], points)).max() < 0.4
    image[:, 110:] = 128
    with pytest.raises(ValueError, match=r"shows \d of the 12 corners"):
        seen_corners(image, CAMERA, board)


def test_a_board_that_the_lens_bends_has_markers_of_the_right_size() -> None:
    board = target_from({**CHARUCO, "columns": 7, "rows": 5})
    pose = pose_at((0.06, 0.11, 0.25), (-0.4, 0.1, 0.0))
    points, pixels = seen_corners(board_on_the_plane(board, pose), CAMERA, board)
    assert np.abs(pixels - projected(CAMERA, pose, points)).max() < 0.8


def test_a_board_on_the_floor_may_reach_behind_the_camera() -> None:
    floor = target_from({**APRILTAG, "columns": 8, "rows": 8, "tag": 0.2, "gap": 0.05})
    pose = pose_at((0.0, -0.5, 0.35), (0.8, 0.0, 0.0))
    front_end = start(board_on_the_plane(floor, pose), LENS, floor, SCENARIO)
    assert np.isnan(pixels_of(CAMERA, pose, floor.points)).any()
    assert np.linalg.norm(front_end.filter.mean[:3] - pose[:3]) < 0.004


def test_a_target_that_the_image_contradicts_a_little_is_a_less_certain_start() -> None:
    image, stds = board_on_the_plane(target_from(APRILTAG), POSES[0]), []
    for gap in (0.02, 0.024):
        front_end = start(image, LENS, target_from({**APRILTAG, "gap": gap}), SCENARIO)
        stds.append(np.sqrt(np.diag(front_end.filter.camera_covariance)[:6]))
    assert (stds[1] > 1.5 * stds[0]).all()


@both_kinds
def test_a_board_that_is_there_twice_is_named(fields) -> None:
    half = board_on_the_plane(target_from(fields), pose_at((0.2, 0.0, 0.5)))[:, :160]
    with pytest.raises(ValueError, match="the picture has marker 0 twice"):
        start(np.hstack((half, half)), LENS, target_from(fields), SCENARIO)


def test_a_wrong_board_is_named() -> None:
    for fields, change, word in (
        (CHARUCO, {"marker": 0.06}, "marker must be smaller than square"),
        (CHARUCO, {"columns": 20, "rows": 20}, "the board has 200 markers"),
        (CHARUCO, {"tag": 1.0}, "has no field 'tag'"),
        (APRILTAG, {"gap": 0.0}, "gap must be a positive number"),
    ):
        with pytest.raises(ValueError, match=word):
            target_from({**fields, **change})


@both_kinds
def test_a_track_from_a_board_has_scale(fields) -> None:
    board, poses = target_from(fields), path(20, 0.4, -0.002)
    frames = [(k / 30.0, board_on_the_plane(board, pose, 2)) for k, pose in enumerate(poses)]
    done = follow(frames, LENS, board, 30.0)
    assert done.metric and done.logs[-1].metric and done.trouble is None
    assert np.linalg.norm(done.cameras[5:, :3] - np.array(poses)[5:, :3], axis=1).max() < 0.006


FREE = [np.concatenate((2.0 * pose[:3], pose[3:])) for pose in path(40, 0.4, -0.002)]
"""At twice the distance that the prior expects."""
SLANTED = [pose_at((0.01 * k, 0.0, 0.8), (0.1, 0.45, 0.0)) for k in range(30)]
"""One edge of the image is much farther away than the other."""


@pytest.fixture(scope="module")
def free() -> list[Frame]:
    """A textured plane without a target."""
    return [(k / 30.0, image_from(pose, samples=2)) for k, pose in enumerate(FREE)]


def test_a_track_without_a_target_has_the_path_and_no_scale(free) -> None:
    done = follow(free, LENS, None, 30.0)
    assert not done.metric and not done.logs[-1].metric and done.trouble is None
    np.testing.assert_array_equal(done.cameras[0, :3], 0.0)
    found, truth = done.cameras[5:, :3], np.array(FREE)[5:, :3]
    spread = [np.linalg.norm(one - one.mean(axis=0)) for one in (found, truth)]
    assert 0.3 < spread[1] / spread[0] < 3.0
    error = spread[1] * np.sqrt(procrustes(truth, found)[2] / len(truth))  # after a rotation, shift and scale
    assert error < 0.015 and TURNED not in summary(done)


def test_depths_are_known_at_the_start() -> None:
    search = Start(LENS)
    for k, pose in enumerate(SLANTED):
        search.add(k / 15.0, image_from(pose, samples=2))
        if search.best is not None and search.best.certain:
            break
    camera, points, covariance, pixels = search.belief(search.best, (2.0, 3.0), 32)
    now = SLANTED[k]
    on_plane = np.column_stack((vision_scene.plane_points(now, *pixels.T), np.zeros(len(pixels))))
    truth = np.linalg.norm(on_plane - SLANTED[0][:3], axis=1)
    errors = np.log(points[:, 2] * truth)
    assert len(points) > 12 and np.std(np.log(truth)) > 0.1
    assert np.std(errors) < 0.05 and np.std(errors) < 2.0 * np.median(
        np.sqrt(np.diag(covariance)[14::3]) / points[:, 2]
    )
    way = rotation_matrix(FACING) @ rotation_matrix(SLANTED[0][3:]).T @ (now[:3] - SLANTED[0][:3])
    assert camera[:3] @ way > 0.999 * np.linalg.norm(camera[:3]) * np.linalg.norm(way)


def test_a_start_whose_normal_equations_are_nearly_singular_is_none(monkeypatch) -> None:
    whole, tried, search = Bundle.normal_equations, [], Start(LENS)

    def singular(bundle: Bundle, x: Geometry) -> tuple[np.ndarray, np.ndarray]:
        H, g = whole(bundle, x)
        H[1], H[:, 1] = H[0], H[:, 0]
        H[1, 1] = H[0, 0] * (1.0 - 1e-13)  # as rounding may have it
        tried.append(np.linalg.inv(H))
        return H, g

    monkeypatch.setattr(Bundle, "normal_equations", singular)
    for k, pose in enumerate(SLANTED[:15]):
        search.add(k / 15.0, image_from(pose, samples=2))
    assert tried and search.best is None


def test_what_interrupts_the_images_of_the_start_ends_the_track(free) -> None:
    def images() -> Iterator[Frame]:
        yield from free[:7]
        raise KeyboardInterrupt

    done = follow(images(), LENS, None, 30.0)
    assert len(done.times) == 7 and done.trouble == "interrupted"


@pytest.mark.parametrize("n", [1, 2])
def test_a_camera_that_only_turns_in_a_room_stays_where_it_is_and_the_user_is_warned(n) -> None:
    lens = enlarged(LENS, n)
    scenario = replace(ROOM, **lens._asdict())
    room = RoomCamera(scenario, camera_of(scenario), np.random.SeedSequence(1))
    states, images = np.zeros((50, 13)), []
    for k, state in enumerate(states):
        angle, state[11] = 0.3 * (1.0 - np.cos(0.1 * k)), 0.9 * np.sin(0.1 * k)
        state[3:7] = quaternion_exp(np.array((0.0, angle, 0.0)))
        images.append((k / 30.0, room.photograph(state, k)))
    done = follow(images, lens, None, 30.0)
    places, variances = done.cameras[:, :3], np.trace(done.covariances[:, :3, :3], axis1=1, axis2=2)
    assert not done.lost.any() and (np.sum(places**2, axis=1) < 9.0 * variances + 1e-8).all()
    turned = [rotation_error(q, done.cameras[0, 3:7]) for q in done.cameras[:, 3:7]]
    truth = [rotation_error(state[3:7], states[0, 3:7]) for state in states]
    assert np.abs(np.linalg.norm(turned, axis=1) - np.linalg.norm(truth, axis=1)).max() < np.radians(0.3)
    assert TURNED in summary(done) and AT_REST in summary(done)


@pytest.mark.parametrize(
    ("fields", "change"),
    [
        (APRILTAG, {"columns": 2, "rows": 3}),
        (APRILTAG, {"gap": 0.1}),
        (CHARUCO, {"square": 0.05}),
        (RECTANGLE, {"width": RECTANGLE["height"], "height": RECTANGLE["width"]}),
        (RECTANGLE, {"height": 1.15 * TARGET.height}),
        (RECTANGLE, {"corners_px": dict(zip(CORNERS, (CORNERS_PX[k] for k in (2, 0, 3, 1))))}),
    ],
)
def test_a_target_that_contradicts_the_image_is_refused(fields, change) -> None:
    board = fields["kind"] != "rectangle"
    image = board_on_the_plane(target_from(fields), POSES[0], 2) if board else image_from(POSES[0], target=True)
    start(image, LENS, target_from(fields), SCENARIO)
    with pytest.raises(ValueError, match="contradicts the first image.*: check (sizes, order .*; of a board|marker)"):
        start(image, LENS, target_from({**fields, **change}), SCENARIO)
    mirrored = dict(zip(CORNERS, (CORNERS_PX[k] for k in (1, 0, 3, 2))))
    with pytest.raises(ValueError, match="check the order of its corners_px"):
        start(image_from(POSES[0], target=True), LENS, target_from(RECTANGLE | {"corners_px": mirrored}), SCENARIO)


SIZE = (640, 480)


def lens_of(focal: float) -> Calibration:
    """A pinhole."""
    return Calibration(*SIZE, focal, 319.5, 239.5, 0.0)


def flown(lens: Calibration, cameras: np.ndarray, seed: int = 5) -> Track:
    """The track through images of a rendered room."""
    room = RoomCamera(EXCERPTS, lens.camera, np.random.SeedSequence(seed))
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
    doubtful = done._replace(logs=[log._replace(start_certain=False) for log in done.logs])
    assert doubtful.doubt == f"{UNCERTAIN}: {SEVERAL if focal < 650.0 else NARROW}"
    assert turn_errors(done, cameras).max() < np.radians(1.0)
    ways = done.cameras[:, :3] - done.cameras[0, :3]
    assert np.linalg.norm(ways[-1, 1:]) < 0.05 * np.linalg.norm(ways[-1])


@pytest.mark.parametrize("pause", [False, True])
def test_the_start_bridges_neither_a_cut_nor_a_gap_in_time(pause: bool) -> None:
    cameras, lens = at_rest(70), lens_of(400.0)
    cameras[:, 0] = 0.25 * np.arange(70) / 30.0
    rooms = [RoomCamera(EXCERPTS, lens.camera, np.random.SeedSequence(seed)) for seed in (5, 5 if pause else 6)]
    images = [rooms[k >= 12].photograph(camera, k) for k, camera in enumerate(cameras)]
    done = follow([((k + 15 * (pause and k >= 12)) / 30.0, one) for k, one in enumerate(images)], lens, None, 30.0)
    assert done.start_certain and np.flatnonzero(done.lost).tolist() == [*range(13)]
    assert turn_errors(done._replace(cameras=done.cameras[13:]), cameras[13:]).max() < np.radians(0.5)


def test_from_a_cut_on_no_pose_is_certain() -> None:
    """The target of both rooms looks the same, so the map of one is found again in the other."""
    cameras, lens = at_rest(45), lens_of(400.0)
    cameras[:, 0] = 0.25 * np.arange(45) / 30.0
    rooms = [RoomCamera(EXCERPTS, lens.camera, np.random.SeedSequence(seed)) for seed in (6, 8)]
    images = [(k / 30.0, rooms[k >= 30].photograph(camera, k)) for k, camera in enumerate(cameras)]
    done = follow(images, lens, None, 30.0)
    assert [log.start_certain for log in done.logs] == [True] * 29 + [False] * 15
    assert "from 1.00 s on" in done.doubt and not done.lost[40:].any()


def test_without_a_target_blur_makes_features_uncertain_along_their_way() -> None:
    time, ratios = np.arange(70) / 30.0, list[float]()
    cameras = at_rest(70)
    cameras[:, 0], cameras[:, 7] = 0.2 * np.sin(1.5 * time), 0.3 * np.cos(1.5 * time)
    turns = Rotation.from_rotvec(0.5 * np.outer(np.sin(4.0 * time), (0, 1, 0)))
    cameras[:, 3:7], cameras[:, 11] = np.roll(turns.as_quat(), 1, axis=1), 2.0 * np.cos(4.0 * time)

    def look(front_end: FrontEnd, *_: Any) -> None:
        R = front_end.candidates["R"][front_end.candidates["id"] > 0]
        ratios.extend([float(np.median(R[:, 0, 0] / R[:, 1, 1]))] if len(R) else [])

    lens = lens_of(400.0)
    room = RoomCamera(EXCERPTS, lens.camera, np.random.SeedSequence(6))
    images = [(at, room.photograph(camera, k)) for k, (at, camera) in enumerate(zip(time, cameras))]
    done = follow(images, lens, None, 30.0, watch=look)
    assert min(ratios) < 3.0 and max(ratios) > 10.0
    assert done.doubt or turn_errors(done, cameras).max() < np.radians(1.5)


def in_motion(rate: int) -> np.ndarray:
    """Cameras (2 * rate, 13) that slide and turn for two seconds."""
    cameras, time = at_rest(2 * rate), np.arange(2 * rate) / rate
    cameras[:, 0], cameras[:, 1] = 0.5 * time, 0.1 * np.sin(3.0 * time)
    turns = Rotation.from_rotvec(np.stack((0.1 * np.sin(2.0 * time), -0.5 * time, 0.0 * time), axis=-1))
    cameras[:, QUATERNION] = np.roll(turns.as_quat(), 1, axis=1)
    return cameras


def test_a_start_in_motion_is_right() -> None:
    cameras = in_motion(30)
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
    printed = capsys.readouterr()
    assert AT_REST in printed.out and UNCERTAIN in printed.err
    header, *rows = (line.split(",") for line in (tmp_path / "frames.csv").read_text().splitlines())
    assert [row[header.index("start_certain")] for row in rows] == ["0"] * 4
    poses = np.loadtxt(tmp_path / "trajectory.tum")
    assert poses.shape == (4, 8) and np.abs(poses[:, 1:4]).max() == 0.0


def test_a_first_image_that_is_lost_has_no_pose_and_its_reason_is_said(tmp_path, capsys) -> None:
    (tmp_path / "lens.json").write_text(json.dumps(LENS._asdict()))
    cv2.imwrite(str(tmp_path / "0.png"), np.full((240, 320), 10, np.uint8))
    given = [f"--images={tmp_path / '0.png'}", f"--calibration={tmp_path / 'lens.json'}", f"--out={tmp_path / 'out'}"]
    assert main(["track", *given]) == 3
    assert "lost: 0 of 1 images were tracked; a lost image is dark" in capsys.readouterr().err
    poses, frames = ((tmp_path / "out" / name).read_text() for name in ("trajectory.tum", "frames.csv"))
    assert poses.count("\n") == 1 and frames.count("\n") == 2


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
