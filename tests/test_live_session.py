"""The live system without its page: advice, the simulated person, what is known, and a recording."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

cv2 = pytest.importorskip("cv2", reason="the extra `vision` is not installed")

from activeslam_gym.camera import camera_of, pixel_from_camera_point  # noqa: E402
from activeslam_gym.geometry import rotation_matrix  # noqa: E402
from activeslam_gym.information.foresight import change_of_view, foresee  # noqa: E402
from activeslam_gym.live import advice  # noqa: E402
from activeslam_gym.live.advice import Adviser, best  # noqa: E402
from activeslam_gym.live.history import History  # noqa: E402
from activeslam_gym.live.person import FOLLOW, NEVER, STILL, Person  # noqa: E402
from activeslam_gym.live.recording import Recording, read_about, read_states  # noqa: E402
from activeslam_gym.live.run import Live, Replay  # noqa: E402
from activeslam_gym.live.session import Session  # noqa: E402
from activeslam_gym.live.source import ROOM, RenderedRoom, Sequence  # noqa: E402
from activeslam_gym.live.state import LOST, OVER, TRACKING, WAITING, State, plain, state_of  # noqa: E402
from activeslam_gym.motion import Motion, motion_of  # noqa: E402
from activeslam_gym.vision.frontend import MATCHED  # noqa: E402
from activeslam_gym.vision.target import CORNERS  # noqa: E402

from .vision_scene import LENS, TARGET, image_from, pose_at  # noqa: E402

CALM = replace(ROOM, acceleration_std=0.0, angular_acceleration_std=0.0)


@pytest.fixture(scope="module")
def walk() -> tuple[Session, list[State]]:
    """The first three seconds in a rendered room."""
    session = Session(RenderedRoom(3), seed=3)
    return session, [session.step() for _ in range(46)]


def test_a_map_grows_and_the_camera_knows_its_place(walk: Any) -> None:
    _, states = walk
    last = states[-1]
    assert [state.frame for state in states] == list(range(1, 47))
    assert last.standing == TRACKING and last.mapped.sum() >= 6
    assert last.landmarks >= last.mapped.sum()
    assert np.linalg.norm(last.truth[:3] - last.camera[:3]) < 0.2
    assert last.log2_dets[2] < states[2].log2_dets[2] - 100.0
    assert {int(outcome) for outcome in last.outcomes} >= {MATCHED}
    assert len(last.searched) == len(last.pixels) == len(last.ellipses) == len(last.outcomes)


def test_a_command_a_second_is_the_best_of_seven(walk: Any) -> None:
    _, states = walk
    assert [state.advised.sum() for state in states] == [0] * 15 + [1] * 15 + [2] * 15 + [3]
    for k in (15, 30, 45):
        assert np.isfinite(states[k].scores).all()
        assert states[k].command == best(states[k].scores)


def test_the_same_seed_gives_the_same_run_after_a_restart(walk: Any) -> None:
    session, states = walk
    session.restart()
    for state in states[:20]:
        again = session.step()
        np.testing.assert_array_equal(again.camera, state.camera)
        np.testing.assert_array_equal(again.image, state.image)


def test_one_motion_is_evaluated_an_image(walk: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    session, _ = walk
    for rate, turns in ((15, [0] * 7 + [1] * 7), (30, [0] * 22 + [1] * 7), (4, [3, 2, 2])):
        scenario = replace(ROOM, frame_time=1.0 / rate, controller_frequency=1.0, rate_loop_time=1.0)
        adviser = Adviser(scenario, session.expected)
        calls: list[int] = []

        def score(motion: int, calls: list[int] = calls) -> float:
            calls.append(int(motion))
            return float(motion == Motion.UP)

        monkeypatch.setattr(adviser, "score", score)
        told, counts = [], [0]
        for _ in range(2 * rate):
            told.append(adviser.consider())
            counts.append(len(calls))
        assert told == ([False] * (rate - 1) + [True]) * 2
        assert np.diff(counts).tolist() == [*turns, 0] * 2
        assert calls == [*range(7)] * 2
        assert adviser.command == Motion.UP and adviser.advised.tolist() == [0, 0, 0, 0, 2, 0, 0]


def test_the_scores_are_those_of_the_kernel_that_the_environment_uses(walk: Any) -> None:
    from activeslam_gym.information.candidates import motion_plans, score_plans
    from activeslam_gym.information.criteria import CRITERIA

    session, _ = walk
    front_end, motion = session.front_end, motion_of(ROOM, 1.0)
    adviser, out = Adviser(ROOM, session.expected), np.empty(1)
    number, plans = CRITERIA.number("mutual_information_position_map"), motion_plans(15)
    for one in range(len(Motion)):
        prospect = session.expected.prospect()
        score_plans(front_end.camera, motion, prospect, 0.0, plans[one : one + 1], number, out)
        np.testing.assert_allclose(adviser.score(Motion(one)), out[0], rtol=1e-12)
    assert advice.CRITERION == ROOM.motion_criterion


# What would be seen ---------------------------------------------------------------------------------------------------


def seen_from(prospect: Any, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which features, and which expected landmarks, are in view from ``pose``."""
    camera, inside, z = camera_of(ROOM), [], np.empty(2)
    for point in prospect.points:
        p_C = rotation_matrix(pose[3:7]).T @ (point - pose[:3])
        projected = p_C[2] > camera.minimum_depth and pixel_from_camera_point(camera, p_C, z)
        inside.append(bool(projected and (z > 0.0).all() and (z < (camera.width, camera.height)).all()))
    known = len(inside) - prospect.waiting
    return np.array(inside[:known]), np.array(inside[known:])


def foreseen(session: Session, prospect: Any, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which features, and which expected landmarks, the sensor is foreseen to measure from ``pose``."""
    places = prospect.boxes, pose, prospect.fiducials, prospect.points, prospect.first_seen
    seen = foresee(session.front_end.camera, prospect.limits, *places) & np.concatenate(seen_from(prospect, pose))
    known = len(seen) - prospect.waiting
    return seen[:known], seen[known:]


def moved_by(prospect: Any, *way: float) -> np.ndarray:
    pose = prospect.camera.copy()
    pose[:3] += way
    return pose


def test_no_more_is_foreseen_than_the_front_end_wants_in_view(walk: Any) -> None:
    session, _ = walk
    before, expected = session.expected.prospect(), []
    for way in (-0.3, 0.0, 0.3):
        pose = moved_by(before, 0.0, 0.0, way)
        features, new = foreseen(session, before, pose)
        room = session.front_end.settings.visible - features.sum() - len(before.fiducials)
        there = seen_from(before, pose)[1]
        assert new.sum() == min(there.sum(), max(room, 0)) and not (new & ~there).any()
        expected.append(there.sum() - new.sum())
    assert max(expected) > 0


def test_features_are_foreseen_from_where_the_front_end_searches_them_alone(walk: Any) -> None:
    session, _ = walk
    before, lost = session.expected.prospect(), 0
    known = len(before.points) - before.waiting
    for way in (0.0, 0.4, 0.8):
        pose = moved_by(before, way, 0.0, 0.0)
        there, seen = seen_from(before, pose)[0], foreseen(session, before, pose)[0]
        change = np.array([change_of_view(*both) for both in zip(before.first_seen, [pose] * known, before.points)])
        np.testing.assert_array_equal(seen, there & (change <= session.front_end.settings.most_change))
        lost += (there & ~seen).sum()
    assert lost > 0


def test_to_stay_is_best_where_nothing_is_better() -> None:
    assert best(np.zeros(7)) == Motion.STAY
    assert best(np.array([1.0, 2.0, 0.0, np.nan, 0.0, 0.0, 0.0])) == Motion.STAY
    assert best(np.array([1.0, 2.0, 0.0, 0.0, 0.0, 0.0, 1.5])) == Motion.BACKWARDS


# The person -----------------------------------------------------------------------------------------------------------


def person(habit: str = FOLLOW, scenario: Any = CALM, boxes: Any = None, seed: int = 0) -> Person:
    start = np.zeros(13)
    start[3] = 1.0
    given = np.zeros((0, 2, 3)) if boxes is None else np.array(boxes, float)
    return Person(motion_of(scenario, 1.0), start, given, habit, np.random.default_rng(seed))


def moved(who: Person, command: Motion, frames: int = 24) -> np.ndarray:
    who.hear(command)
    for _ in range(frames):
        who.move()
    return who.state[:3]


@pytest.mark.parametrize(
    "command, way",
    [(Motion.UP, (0, 0.3, 0)), (Motion.DOWN, (0, -0.3, 0)), (Motion.FORWARD, (0, 0, 0.3)), (Motion.STAY, (0, 0, 0)),
     (Motion.BACKWARDS, (0, 0, -0.3))],
)  # fmt: skip
def test_a_follower_goes_where_it_is_told(command: Motion, way: Any) -> None:
    np.testing.assert_allclose(moved(person(), command), way, atol=0.03)


def test_right_is_to_the_right_of_the_image() -> None:
    assert moved(person(), Motion.RIGHT)[0] < -0.25  # the camera's x points left


def test_a_person_keeps_away_from_boxes() -> None:
    wall = [[(-1, -1, 0.6), (1, 1, 0.9)]]
    who = person(boxes=wall)
    for _ in range(4):
        moved(who, Motion.FORWARD)
    assert 0.0 < who.state[2] < 0.3


def test_who_does_not_follow_goes_elsewhere_and_who_is_still_nowhere() -> None:
    assert np.linalg.norm(moved(person(STILL), Motion.UP)) < 0.01
    ways = [moved(person(NEVER, seed=seed), Motion.UP) for seed in range(12)]
    assert len({tuple(np.sign(np.round(way, 1))) for way in ways}) >= 4


def test_a_hand_trembles_and_stays_level() -> None:
    who, heights, tilts = person(STILL, ROOM), [], []
    for _ in range(600):
        x = who.move()
        heights.append(x[1])
        tilts.append(np.abs(x[[4, 6]]).max())
    assert 0.001 < np.std(heights) < 0.02
    assert max(tilts) < 0.03


# How it goes ----------------------------------------------------------------------------------------------------------


class Dark(RenderedRoom):
    """The lamps go out after two seconds."""

    def next(self) -> Any:
        time, image = super().next()
        return time, image if time < 2.0 else np.zeros_like(image)


def test_it_says_when_it_is_lost() -> None:
    session = Session(Dark(1))
    standings = [session.step().standing for _ in range(50)]
    assert standings[28] == TRACKING and standings[-1] == LOST


class Late(RenderedRoom):
    """The target is not there before the fifth image; then there are ten more."""

    is_camera = True

    def start(self, image: np.ndarray) -> Any:
        if self._frame < 5:
            raise ValueError("no target")
        return super().start(image)

    def next(self) -> Any:
        return super().next() if self._frame < 15 else None


def test_it_waits_for_the_target_and_says_when_no_image_is_left() -> None:
    session = Session(Late(1))
    states = [session.step() for _ in range(18)]
    assert [state.standing for state in states] == [WAITING] * 5 + [TRACKING] * 11 + [OVER] * 2
    assert "no target" in states[0].words
    assert states[5].time == 0.0 and states[5].frame == 1


def test_before_anything_is_found_the_entropy_is_the_prior_s() -> None:
    session = Session(RenderedRoom(0))
    state = session.step()
    variances = np.diag(session.front_end.filter.belief.covariance)[:12]
    camera, whole = np.log2(variances).sum(), ROOM.landmark_count * np.log2(ROOM.landmark_prior_variance).sum()
    np.testing.assert_allclose(state.log2_dets, (camera, whole, camera + whole), rtol=1e-9)


def test_the_past_is_bounded_and_keeps_new_landmarks(walk: Any) -> None:
    state, past = walk[1][-1], History()
    for k in range(5000):
        past.add(replace(state, frame=k, time=k / 15, landmarks=1 if k >= 7 else 0))
    assert len(past.curves) <= 1200 and len(past.way) <= 1200
    assert past.curves[:, 4].sum() == 1.0 and past.curves[-1, 0] == 4999 / 15
    past.add(replace(state, frame=1, time=0.1))
    assert len(past.curves) == 1


def test_a_recorded_sequence_is_followed_and_advised_at_its_rate(tmp_path: Path) -> None:
    corners = np.empty((4, 2))
    places = [pose_at((0.05 + 0.004 * k, 0.03, 0.69)) for k in range(10)]
    camera = camera_of(LENS.scenario())
    for z, point in zip(corners, TARGET.fiducials):
        pixel_from_camera_point(camera, rotation_matrix(places[0][3:]).T @ (point - places[0][:3]), z)
    names = dict(zip(CORNERS, np.rint(corners).tolist()))
    target = {"kind": "rectangle", "width": TARGET.width, "height": TARGET.height, "corners_px": names}
    (tmp_path / "lens.json").write_text(json.dumps(LENS._asdict()))
    (tmp_path / "target.json").write_text(json.dumps(target))
    for k, place in enumerate(places):
        assert cv2.imwrite(str(tmp_path / f"{k:02d}.png"), image_from(place, target=True))
    source = Sequence(str(tmp_path), tmp_path / "lens.json", tmp_path / "target.json", 5.0)
    session = Session(source)
    states = [session.step() for _ in range(11)]
    assert [state.standing for state in states] == [TRACKING] * 10 + [OVER]
    assert np.linalg.norm(states[9].camera[:3] - places[9][:3]) < 0.02
    assert states[9].advised.sum() == 1 and np.isfinite(states[9].scores).all()  # five images a second
    assert states[9].follows is None and states[9].truth is None
    session.restart()
    assert session.step().frame == 1


# Recordings -----------------------------------------------------------------------------------------------------------


def test_a_state_survives_json(walk: Any) -> None:
    for state in (walk[1][0], walk[1][-1]):
        back = state_of(json.loads(json.dumps(plain(state))), state.image)
        for name, value in vars(state).items():
            got = getattr(back, name)
            if isinstance(value, np.ndarray):
                assert got.shape == value.shape, name
                np.testing.assert_allclose(got, value, rtol=1e-5, atol=1e-9)
            elif not isinstance(value, float):
                assert got == value, name
    with pytest.raises(ValueError, match="no state"):
        state_of({"frame": 1}, np.zeros((2, 2), np.uint8))


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[State]]:
    """A run of 20 images in a folder, not closed: as it is when the process is killed; and a restart's, closed."""
    folder = tmp_path_factory.mktemp("live") / "run"
    show = Live(RenderedRoom(2), 2, folder)
    states = [show.step() for _ in range(20)]
    show._recording = None  # what is on disk must be enough
    return folder, states


def test_a_recording_that_was_cut_off_is_shown_again(recorded: Any) -> None:
    folder, states = recorded
    with (folder / "states.jsonl").open("a") as file:
        file.write('{"frame": 21, "ti')
    again = list(read_states(folder))
    assert len(again) == len(states)
    for one, other in zip(again, states):
        np.testing.assert_array_equal(one.image, other.image)
        np.testing.assert_allclose(one.points, other.points, rtol=1e-5, atol=1e-9)
    show = Replay(folder)
    shown = [show.step() for _ in range(22)]
    assert [state.standing for state in shown][-3:] == [TRACKING, OVER, OVER]
    assert show.about == replace(read_about(folder), replay=True)


def test_a_recording_becomes_an_animation(recorded: Any, tmp_path: Path, capsys: Any) -> None:
    pytest.importorskip("tyro", reason="the extra `compare` is not installed")
    image = pytest.importorskip("PIL.Image", reason="the extra `plot` is not installed")
    from agents.__main__ import main

    clip = tmp_path / "clip.gif"
    line = ["watch", "--recording", str(recorded[0]), "--every", "0.25", "--width", "200", "--save", str(clip)]
    assert main(line) == 0
    with image.open(clip) as animation:
        assert animation.n_frames == 6 and animation.size == (200, 176)
    assert main(["watch", "--recording", str(tmp_path), "--save", str(clip)]) == 2
    assert main(["watch", "--recording", str(recorded[0])]) == 2
    assert "holds no live recording" in capsys.readouterr().err


def test_a_recording_becomes_one_for_rerun(recorded: Any, tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="the extra `rerun` is not installed")
    from agents.watching.replay import log_rerun

    log_rerun(recorded[0], tmp_path / "run.rrd")
    assert (tmp_path / "run.rrd").stat().st_size > 10_000


def test_a_recording_has_a_trajectory_and_a_log(recorded: Any) -> None:
    folder, states = recorded
    poses = np.loadtxt(folder / "trajectory.tum")
    assert poses.shape == (20, 8)
    np.testing.assert_allclose(poses[:, 1:4], [state.camera[:3] for state in states], atol=1e-6)
    assert len((folder / "frames.csv").read_text().splitlines()) == 20  # a header, and all images but the first
    assert len(list((folder / "images").iterdir())) == 20


def test_a_restart_has_a_folder_of_its_own_and_none_is_written_over(tmp_path: Path) -> None:
    show = Live(RenderedRoom(2), 2, tmp_path)
    show.step()
    show.restart()
    show.step()
    assert "Saved in" in show.save()
    show.close()
    assert {path.name for path in tmp_path.iterdir()} >= {"map.csv", "trajectory.tum", "2"}
    assert (tmp_path / "2" / "map.csv").exists()
    with pytest.raises(OSError, match="holds a live recording already"):
        Live(RenderedRoom(2), 2, tmp_path)


def test_a_damaged_recording_is_told(recorded: Any, tmp_path: Path) -> None:
    folder, _ = recorded
    with pytest.raises(FileNotFoundError, match="holds no live recording"):
        read_about(tmp_path)
    (tmp_path / "live.json").write_text("{}")
    with pytest.raises(ValueError, match="is damaged"):
        read_about(tmp_path)
    (tmp_path / "states.jsonl").write_text("nonsense\n")
    (tmp_path / "images").mkdir()
    cv2.imwrite(str(tmp_path / "images" / "000000.png"), np.zeros((4, 4), np.uint8))
    with pytest.raises(ValueError, match="line 1 of .* is damaged"):
        next(read_states(tmp_path))


def test_the_recording_says_what_it_is_of(tmp_path: Path) -> None:
    show = Live(RenderedRoom(7), 7, tmp_path / "a")
    show.step()
    show.close()
    about = read_about(tmp_path / "a")
    assert about.name == "rendered room 7" and about.image_size == (320, 240) and about.replay
    assert isinstance(Recording(tmp_path / "b", about).count, int)
