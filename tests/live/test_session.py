"""The live system without its page: advice, the simulated person, the state estimate, and a recording."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

cv2 = pytest.importorskip("cv2", reason="the extra `vision` is not installed")

from activeslam_gym.camera import View, camera_of, change_of_view, visible
from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.information.candidates import measurable_points
from activeslam_gym.live import run
from activeslam_gym.live import source as live_source
from activeslam_gym.live.advice import CRITERION, best
from activeslam_gym.live.session import Session
from activeslam_gym.live.source import (
    FOLLOW,
    NEVER,
    ROOM,
    STILL,
    GuidanceError,
    Person,
    RealCamera,
    RecordedImages,
    RenderedRoom,
)
from activeslam_gym.live.state import Standing, State
from activeslam_gym.motion import Motion, goal_of, motion_of
from activeslam_gym.vision.other_lenses import lens_from
from activeslam_gym.vision.search import MATCHED
from activeslam_gym.vision.sources import Frame, images_of
from activeslam_gym.vision.target import read_target
from activeslam_gym.vision.views import projected
from tests.vision_scene import CAMERA, LENS, TARGET, covered, image_from, path, pose_at, target_fields

NEAR_LENS = "1 OPENCV_FISHEYE 320 240 195 197 162.5 125.5 -0.0089 -0.0329 -0.0052 0.0019"
"""A fisheye that is nearly `LENS`, in COLMAP's form: its images are mapped by up to a pixel."""
CALM = replace(ROOM, acceleration_std=0.0, angular_acceleration_std=0.0)


@pytest.fixture(scope="module")
def walk() -> tuple[Session, list[State]]:
    """The first three seconds in a rendered room."""
    session = Session(RenderedRoom(3), seed=3)
    return session, [session.step() for _ in range(46)]


def test_a_map_grows_and_the_camera_is_localised(walk: Any) -> None:
    _, states = walk
    last = states[-1]
    assert [state.frame for state in states] == list(range(1, 47))
    assert last.standing == Standing.TRACKING and last.landmarks >= last.mapped.sum() >= 6
    assert np.linalg.norm(last.truth[:3] - last.camera[:3]) < 0.2
    assert last.log2_dets[2] < states[2].log2_dets[2] - 100.0
    assert MATCHED in last.searched.outcome
    assert len(last.searched.id) == len(last.searched.pixel) == len(last.searched.covariance)


def test_a_command_a_second_is_the_best_of_seven(walk: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    _, states = walk
    assert [state.advised.sum() for state in states] == [0] * 15 + [1] * 15 + [2] * 15 + [3]
    for k in (15, 30, 45):
        assert np.isfinite(states[k].scores).all() and states[k].command == best(states[k].scores)
    slow = Session(RenderedRoom(3))
    monkeypatch.setattr(slow.source, "next", lambda: [RenderedRoom.next(slow.source) for _ in range(3)][-1])
    assert [slow.step().advised.sum() for _ in range(11)] == [0] * 5 + [1] * 5 + [2], "two of three images are missing"
    assert CRITERION == ROOM.motion_criterion
    assert best(np.zeros(7)) == best(np.array([1.0, 2.0, 0.0, np.nan, 0.0, 0.0, 0.0])) == Motion.STAY
    assert best(np.array([1.0, 2.0, 0.0, 0.0, 0.0, 0.0, 1.5])) == Motion.BACKWARDS


def test_the_same_seed_gives_the_same_run_after_a_restart(walk: Any) -> None:
    session, states = walk
    empty = session.restart()
    assert empty.frame == 0 and not len(empty.ids) and np.isnan(empty.scores).all(), "the page shows no map any more"
    for state in states[:20]:
        again = session.step()
        np.testing.assert_array_equal(again.camera, state.camera)
        np.testing.assert_array_equal(again.image, state.image)


def test_only_measurements_that_the_front_end_would_take_are_foreseen(walk: Any) -> None:
    """Of features those from familiar sides, and of expected landmarks as many as there is room for beside them."""
    session, _ = walk
    session.restart()
    for _ in range(4):  # early, while more is expected than there is room for
        session.step()
    belief, settings = session.adviser.expected.predicted_belief(), session.front_end.settings
    left_out = np.zeros(2, int)
    known = len(belief.points) - belief.waiting
    limits = belief.limits._replace(wanted=6)  # so that the room does not suffice
    for way in ((0, 0, -0.3), (0, 0, 0), (0, 0, 0.3), (0.4, 0, 0), (0.8, 0, 0)):
        pose = belief.camera.copy()
        pose[:3] += way
        view = View(camera_of(ROOM), pose, rotation_matrix(pose[3:7]))
        there = np.array([visible(view, point, 0.0, np.empty(2)) for point in belief.points])
        seen = there & measurable_points(session.front_end.camera, belief._replace(limits=limits), pose)
        change = np.array([change_of_view(*both) for both in zip(belief.first_seen, [pose] * known, belief.points)])
        np.testing.assert_array_equal(seen[:known], there[:known] & (change <= settings.most_change))
        room = max(limits.wanted - seen[:known].sum() - len(belief.fiducials), 0)
        assert seen[known:].sum() == min(there[known:].sum(), room)
        left_out += [(there & ~seen)[:known].sum(), (there & ~seen)[known:].sum()]
    assert (left_out > 0).all()


def moved(command: Motion, habit: str = FOLLOW, boxes: Any = (), times: int = 1, seed: int = 0) -> np.ndarray:
    """Where a person who hears a command ``times`` is afterwards."""
    places = np.reshape(np.array(boxes, float), (-1, 2, 3))
    who = Person(motion_of(CALM, 1.0), np.eye(1, 13, 3)[0], places, habit, np.random.default_rng(seed))
    for _ in range(times):
        who.hear(command)
        for _ in range(24):
            who.move()
    return who.state[:3]


def test_a_person_goes_as_the_habit_says_and_keeps_away_from_boxes() -> None:
    ways = ((0, 0, 0.3), (0, 0, -0.3), (-0.3, 0, 0), (0.3, 0, 0), (0, 0.3, 0), (0, -0.3, 0), (0, 0, 0))
    for motion, way in zip(Motion, ways):  # the camera's x points left
        np.testing.assert_allclose(moved(motion), way, atol=0.03)
    assert np.linalg.norm(moved(Motion.UP, STILL)) < 0.01
    random = [moved(Motion.UP, NEVER, seed=seed) for seed in range(12)]
    assert len({tuple(np.sign(np.round(way, 1))) for way in random}) >= 4
    assert 0.0 < moved(Motion.FORWARD, boxes=[[(-1, -1, 0.6), (1, 1, 0.9)]], times=4)[2] < 0.3


class Dark(RenderedRoom):
    """The lamps go out after two seconds."""

    def next(self) -> Any:
        time, image = super().next()
        return time, image if time < 2.0 else np.zeros_like(image)


def test_a_camera_in_the_dark_is_lost() -> None:
    session = Session(Dark(1))
    standings = [session.step().standing for _ in range(50)]
    assert standings[28] == Standing.TRACKING and standings[-1] == Standing.LOST


class Stuck(RenderedRoom):
    """The camera repeats its image from the third second on."""

    def next(self) -> Any:
        time, image = super().next()
        self.last = image if time < 2.0 else self.last
        return time, self.last


def test_a_camera_that_repeats_its_image_is_not_said_to_be_lost() -> None:
    session = Session(Stuck(1))
    last = [session.step() for _ in range(50)][-1]
    assert last.standing == Standing.UNSURE and "repeats its last image" in last.words


class Late(RenderedRoom):
    """The target is not there before the fifth image; then there are ten more, of which one is refused."""

    is_camera = True

    def start(self, image: np.ndarray) -> Any:
        if self._frame < 5:
            raise ValueError("no target")
        return super().start(image)

    def next(self) -> Any:
        if self._frame == 9:
            self._frame = 10
            raise GuidanceError("Turn the device.")
        return super().next() if self._frame < 15 else None


def test_it_waits_for_the_target_and_tells_when_no_image_is_left(tmp_path: Path) -> None:
    session = Session(Late(1), 0, tmp_path)
    session.step()
    assert not session.recorded and not list(tmp_path.iterdir())
    session.restart()
    states = [session.step() for _ in range(18)]
    expected = [Standing.WAITING] * 5 + [Standing.TRACKING] * 5 + [Standing.WAITING]
    expected += [Standing.TRACKING] * 5 + [Standing.OVER] * 2
    assert [state.standing for state in states] == expected
    assert "no target" in states[0].words and states[5].time == 0.0 and states[5].frame == 1
    assert len(list((tmp_path / "images").iterdir())) == expected.count(Standing.TRACKING)
    session.log = session.log._replace(lost=True)  # in frames.csv
    assert session._standing() == Standing.UNSURE


def test_a_recorded_sequence_is_followed_and_advised_at_its_rate(tmp_path: Path) -> None:
    places = [pose_at((0.05 + 0.004 * k, 0.03, 0.69)) for k in range(10)]
    (tmp_path / "cameras.txt").write_text(NEAR_LENS)
    (tmp_path / "target.json").write_text(json.dumps(target_fields(places[0])))
    for k, place in enumerate(places):
        assert cv2.imwrite(str(tmp_path / f"{k:02d}.png"), image_from(place, target=True))
    source = RecordedImages(str(tmp_path), tmp_path / "cameras.txt", tmp_path / "target.json", 5.0)
    session = Session(source, 0, tmp_path / "run")
    states = [session.step() for _ in range(11)]
    for kept, taken, state in zip(sorted((tmp_path / "run/images").iterdir()), places, states):
        np.testing.assert_array_equal(cv2.imread(str(kept), 0), image_from(taken, target=True))
        assert (state.image != image_from(taken, target=True)).any()  # it is mapped to equation 1
    assert [state.standing for state in states] == [Standing.TRACKING] * 10 + [Standing.OVER]
    assert np.linalg.norm(states[9].camera[:3] - places[9][:3]) < 0.02
    assert states[9].advised.sum() == 1 and np.isfinite(states[9].scores).all()  # five images a second
    assert states[9].follows is None and states[9].truth is None
    belief, aside = session.adviser.expected.predicted_belief(), pose_at((1.0, 0.03, 0.0))
    known, points = len(session.front_end.filter.ids), measurable_points(session.front_end.camera, belief, aside)
    assert known > 8 and not points[:known].any(), "no template can be drawn from there"
    session.restart()
    assert session.step().frame == 1


def test_a_motion_of_a_real_camera_is_30_cm_long_wherever_it_is(walk: Any) -> None:
    """Goals ended in an invisible box about the target, 1.1 m from it."""
    real, rendered = Session(Shown([image_from(path(1)[0], target=True)])), walk[0]
    real.step()
    far = pose_at((2.0, -1.5, -4.0))
    ways = [goal_of(real.adviser._motion, far, motion) - far[:3] for motion in Motion]
    np.testing.assert_allclose(np.linalg.norm(ways, axis=1), [0.3] * 6 + [0.0], atol=1e-9)
    assert np.abs(goal_of(rendered.adviser._motion, far, Motion.FORWARD)[2]) < 0.5 * ROOM.room_size[2], "it has walls"


def test_corners_of_a_target_are_mapped_with_the_first_image(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "cameras.txt").write_text("1 OPENCV 320 240 195 195 162.5 125.5 -0.28 0.07 0.01 0")
    (tmp_path / "target.json").write_text(json.dumps(target_fields(pose_at((0.05, 0.03, 0.69)))))
    assert cv2.imwrite(str(tmp_path / "0.png"), np.zeros((240, 320), np.uint8))
    monkeypatch.setattr(live_source, "start", lambda image, calibration, target, *_: target)
    source = RecordedImages(str(tmp_path), tmp_path / "cameras.txt", tmp_path / "target.json", 5.0)
    given = read_target(tmp_path / "target.json").corners_px
    mapped = lens_from(tmp_path / "cameras.txt")[1].pixels(given)
    assert 0.5 < np.abs(mapped - given).max() < 10.0
    np.testing.assert_array_equal(source.start(source.next()[1]).corners_px, mapped)
    done, taken = (
        list[str](),
        lambda *_, **__: done.append("opened") or SimpleNamespace(frames=iter([(0.0, source.original)])),
    )
    monkeypatch.setattr(live_source, "images_of", taken)
    monkeypatch.setattr(RecordedImages, "_warm_up", lambda self: done.append("compiled"))
    RecordedImages("camera:0", tmp_path / "cameras.txt", tmp_path / "target.json", 5.0).next()
    assert done == ["opened", "compiled", "opened"], "a live camera's first image is a new one"


class Shown(RealCamera):
    """A camera that shows ``images``."""

    name, is_camera = "shown", False

    def __init__(self, images: list[np.ndarray]) -> None:
        target = TARGET._replace(corners_px=projected(CAMERA, path(1)[0], TARGET.fiducials))
        super().__init__(LENS, lambda frame: frame, target, 30.0)
        self._frames = iter([(k / 30.0, image) for k, image in enumerate(images)])

    def next(self) -> Frame | None:
        return next(self._frames, None)


def test_a_map_that_contradicts_the_images_is_unsure_until_a_restart() -> None:
    images = [image_from(pose, target=True, samples=2) for pose in path(60, approach=0.001)]
    right, wrong = Session(Shown(images)), Session(Shown(covered(images)))
    said = [[show.step() for _ in images][-1] for show in (right, wrong)]
    assert [state.standing for state in said] == ["tracking", "unsure"]
    assert "contradicts the images" in said[1].words and right.log.start_certain and not wrong.log.start_certain


def test_a_recording_that_was_cut_off_has_its_images_states_trajectory_and_log(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    show = Session(RenderedRoom(2), 2, folder)
    states = [show.step(15.0) for _ in range(20)]
    show._recording = None  # as when the process is killed: what is on disk must be enough
    poses = np.loadtxt(folder / "trajectory.tum")
    np.testing.assert_allclose(poses[:, 1:4], [state.camera[:3] for state in states], atol=1e-6)
    assert len((folder / "frames.csv").read_text().splitlines()) == 21
    assert [time for time, _ in images_of(folder / "times.txt").frames] == [state.time for state in states]
    for line, state in zip((folder / "states.jsonl").read_text().splitlines(), states, strict=True):
        kept = json.loads(line)
        assert kept["frame"] == state.frame and kept["time"] == state.time and kept["command"] == state.command
        assert kept["rate"] == 15.0
        np.testing.assert_allclose(np.reshape(kept["points"], (-1, 3)), state.points, rtol=1e-5, atol=1e-9)


class Slow(RenderedRoom):
    """A third of the images come, and for a minute none."""

    def next(self) -> Any:
        time, image = super().next()
        return 3.0 * time + (60.0 if self._frame > 3 else 0.0), image


def test_a_film_and_a_replay_have_the_times_of_the_images(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A camera of 15 images a second played twice as fast, at the default of 30."""
    session, now = Session(Slow(2), 2, tmp_path, film=True), [0.0]
    times = [session.step().time for _ in range(6)]
    session.close()
    film = cv2.VideoCapture(str(tmp_path / "film.mp4"))
    assert film.get(cv2.CAP_PROP_FRAME_COUNT) == 3 * 3 + 15 + 3 + 1, "the pause is shortened to a second"
    monkeypatch.setattr(
        run, "time", SimpleNamespace(monotonic=lambda: now[0], sleep=lambda s: now.append(now.pop() + s))
    )
    clock, shown = run.Clock(session.source), list[float]()
    for time in times:
        clock.wait(time)
        shown.append(now[0])
    assert np.diff(shown) == pytest.approx([0.2, 0.2, 0.2, 1.0, 0.2])


def test_a_restart_has_a_folder_of_its_own_and_none_is_written_over(tmp_path: Path) -> None:
    show = Session(RenderedRoom(2), 2, tmp_path, film=True)
    show.step()
    show.restart()
    show.step()
    assert "Saved in" in show.save()
    show.close()
    assert {path.name for path in tmp_path.iterdir()} >= {"map.csv", "trajectory.tum", "2"}
    assert (tmp_path / "2" / "map.csv").exists()
    assert cv2.VideoCapture(str(tmp_path / "film.mp4")).read()[1].shape == (480, 1280, 3)
    assert (tmp_path / "2" / "film.mp4").exists()
    (tmp_path / "own" / "images").mkdir(parents=True)
    for folder, what in ((tmp_path, "a live recording"), (tmp_path / "own", "images")):
        with pytest.raises(OSError, match=f"holds {what} already"):
            Session(RenderedRoom(2), 2, folder)
