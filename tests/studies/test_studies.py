"""`python -m studies.…`, small, and its measures, which have known answers; their whole tables are in docs/."""

import csv
import json
import re
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import multivariate_normal, norm

import baselines
from activeslam_gym import SCENARIOS, Motion, Scenario
from activeslam_gym.evaluation import run_episode
from activeslam_gym.information.candidates import OPEN_LOOP, motion_plans, score_plans
from activeslam_gym.information.criteria import CRITERIA
from activeslam_gym.metrics import CLOSURE_GAP, LoopClosures
from agents import task as tasks
from agents.learn.recipe import trained_scenario
from agents.summary import aggregate
from examples.extend_range_sensor import RangeSensor
from studies import consistency, measures, paper, settings_of, worth
from studies import tasks as tasks_of
from studies.removals import REMOVALS
from studies.worth import compared
from tests.agents.test_compare import episode

pytest.importorskip("cv2", reason="the extra `vision` is not installed")
pytest.importorskip("tyro", reason="the extra `compare` is not installed")

from activeslam_gym.geometry import rotation_error
from activeslam_gym.live.session import Session
from activeslam_gym.live.source import ROOM, STILL, RenderedRoom
from activeslam_gym.live.trial import Evaluator, trial
from activeslam_gym.metrics import camera_error, write_tum
from activeslam_gym.slam.estimate import taken_estimate
from studies import excerpts, learning, live, upper_reference

PACKAGE = Path(__file__).parents[2] / "activeslam_gym"


def test_consistency_fills_its_page_and_plays_no_episode_twice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page, variants = tmp_path / "page.md", ["inverse depth", "known association"]
    page.write_text("<!-- generated: consistency -->\n<!-- end: consistency -->\n")
    given = {"policies": ("sweep",), "variants": tuple(variants), "episodes": 2, "scenario": '{"landmark_count": 9}'}
    for _ in range(2):
        consistency.main(consistency.Args(**given, out=tmp_path / "store", report=(page,)))
        monkeypatch.setattr(tasks, "play_tasks", lambda _: pytest.fail("played again"))
    rows = [one.strip("| ").split(" | ") for one in page.read_text().splitlines() if one.startswith("| `")]
    assert [row[1] for row in rows] == variants and all(0.0 < float(row[4]) < np.inf for row in rows)
    assert "python -m studies.consistency --policies sweep --episodes 2 --" in page.read_text()
    table = list(csv.DictReader((tmp_path / "consistency.csv").open()))
    assert [row["variant"] for row in table] == variants and float(table[0]["landmark_nees_35s"]) > 0.0


def test_the_interval_of_a_consistent_filters_nees_holds_1() -> None:
    """A grey band, of 3 degrees of freedom an episode, held 99 of 100 means of the pose and all of landmarks."""
    rng, shape = np.random.default_rng(0), (150, 100)  # studies, episodes
    camera = rng.standard_normal((*shape, 2, 3))  # errors in standard deviations
    camera[:, :, 1] = 0.6 * camera[:, :, 0] + 0.8 * camera[:, :, 1]  # position and orientation are correlated
    landmarks = 0.5 * camera[:, :, :1] + np.sqrt(0.75) * rng.standard_normal((*shape, 20, 3))
    for errors in (camera, landmarks):
        means = [consistency.mean(nees) for nees in np.mean(errors**2, axis=(2, 3))]
        assert 0.88 < np.mean([one.low <= 1.0 <= one.high for one in means]) < 0.99


def test_a_policy_for_one_environment_is_played_in_one_at_a_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A study played it in a batch, for which it has no actions."""
    (tmp_path / "own_single.py").write_text("def slide(env): return 3, 1\n")
    monkeypatch.syspath_prepend(tmp_path)
    args = consistency.Args(policies=("own_single:slide",), episodes=2, scenario='{"duration": 2.0}')
    (runs,) = args.played({"": tasks_of("own_single:slide", settings_of(args.scenario), args.seed, 2)}).values()
    assert [run.actions.tolist() for run in runs] == [[[3, 1]] * 8] * 2


@pytest.mark.parametrize("given", ["earlier", "earlier=nowhere"])
def test_a_checkout_that_is_none_is_named(given: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(worth, "build", lambda *_: pytest.fail("began"))
    with pytest.raises(ValueError, match=f"checkouts: '{given}'; allowed: NAME=FOLDER"):
        worth.main(worth.Args(checkouts=(given,)))


def test_a_scenario_that_cannot_be_played_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It was a traceback."""
    monkeypatch.setattr(worth.sys, "executable", "false")
    with pytest.raises(ValueError, match="'nowhere'"):
        worth.episodes(worth.Args(), "nowhere", tmp_path, tmp_path)


def test_a_scenario_with_a_part_of_ones_own_is_named_in_settings(monkeypatch: pytest.MonkeyPatch) -> None:
    """The object of the part was no JSON: a traceback."""
    monkeypatch.setitem(SCENARIOS, "own", Scenario(name="own", sensor=RangeSensor))
    settings = json.loads(settings_of("examples.extend_range_sensor:own", pixel_std=3.0))
    assert settings["scenario"]["sensor"] == "examples.extend_range_sensor:RangeSensor"
    assert settings["scenario"]["pixel_std"] == 3.0


@pytest.mark.parametrize("row", [row for row in REMOVALS if row != "base"])
def test_a_row_replaces_a_function_or_constant_that_there_is(row: str) -> None:
    """A row that replaces nothing would show that a mechanism has no worth."""
    for module, lines in REMOVALS[row].items():
        source = (PACKAGE / f"{module}.py").read_text(encoding="utf-8")
        defined = re.findall(r"^def (\w+)|^([A-Z_]+(?:, [A-Z_]+)*) =|import \w+ as (\w+)$", lines, re.MULTILINE)
        names = [name for one in defined for name in ", ".join(filter(None, one)).split(", ")]
        assert names and all(re.search(rf"\b{name}\b", source) for name in names), names
        for field in re.findall(r"out\.(\w+) =", lines):
            assert re.search(rf"^    {field}=", source, re.MULTILINE), field


def test_differences_are_of_the_same_episodes() -> None:
    def episodes(lost: float, gain: float, seeds: range) -> list[dict[str, str]]:
        numbers = {"lost": lost, "log_score_gain": gain, "log_score_under_0": int(gain < 0.0)}
        numbers |= {"position_nees": 1.0, "landmark_nees": 1.0}
        one = {"policy": "stay", **{name: str(value) for name, value in numbers.items()}}
        return [{**one, "seed": str(seed)} for seed in seeds]

    found = compared(episodes(0, 100.0, range(20)), episodes(1, -50.0, range(10, 40)))
    assert found["episodes"] == found["under_zero"] == 10
    assert found["lost"] == found["lost_low"] == 100.0 and found["score"] == found["score_high"] == -0.5


def test_the_reference_is_of_the_scenario_that_the_policies_play(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of images it was searched with points."""
    searched: list[Scenario] = []
    monkeypatch.setattr(upper_reference, "search", lambda env, *_: searched.append(env.scenario) or 1.0)
    upper_reference.main(upper_reference.Args(scenarios=("corner-pixels",), policies=(), episodes=1))
    assert searched == [trained_scenario("corner-pixels")]


def test_learning_curves_and_their_policies_count_an_episode_until_it_is_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Validation of a learner ended a lost episode; the policies beside it went on, and some recovered."""
    (tmp_path / "curve.csv").write_text("decisions,scenario,log_score,failures\n40,office,1.0,0.0\n")
    played = list[tuple[bool, int]]()

    def note(_: Any, groups: dict[str, list[tasks.Task]], batch: int) -> dict[str, list[Any]]:
        played.extend((json.loads(one.settings)["end_when_lost"], batch) for group in groups.values() for one in group)
        return {name: [episode(), episode(seed=1)] for name in groups}

    monkeypatch.setattr(learning.Args, "played", note)
    monkeypatch.setattr(learning, "save_figure", lambda *_: None)
    learning.main(learning.Args(folders=(tmp_path,), policies=("stay",), episodes=2, out=tmp_path))
    assert played == [(True, 1)] * 2


def test_learning_curves_show_every_policy(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[Any] = []
    monkeypatch.setattr(learning, "save_figure", lambda figure, _: drawn.append(figure))
    learning.draw({"office": {}}, {"office": {name: aggregate([1.0], "IQM") for name in "abcde"}}, Path())
    assert len(drawn[0].axes[0].lines) == 5


def environment(duration: float = 3.0) -> gym.Env:
    return gym.make("ActiveSLAM-v0", gaze_period=0.05, duration=duration)


def test_a_verdict_needs_the_whole_interval_of_enough_episodes_on_one_side() -> None:
    noise = np.random.default_rng(0).normal(0.0, 0.5, 40)
    verdicts = [paper.row("", "", values, above)[-1] for values in (noise + 2.0, noise) for above in (True, False)]
    assert verdicts == ["**holds**", "**does not hold**", "not significant", "not significant"]
    assert paper.row("", "", noise + 2.0, True, 1.9)[-1] == "not significant"
    assert paper.row("", "", noise[:9] + 2.0, True)[-1] == "too few episodes"
    assert paper.row("", "", np.r_[noise, np.nan], True)[3] == str(40)


def test_numbers_of_made_up_episodes() -> None:
    late = episode(lost=True, landmark_times=np.arange(measures.TARGET) + 1.0)
    np.testing.assert_array_equal(measures.at_target([late, episode()], "landmark_times", 2.0), [measures.TARGET, 2.0])
    np.testing.assert_array_equal(measures.unless_lost([late, episode()], lambda one: 3.0), [np.nan, 3.0])
    actions = np.array([[motion, 0] for motion in (Motion.STAY, Motion.UP, Motion.UP, Motion.FORWARD)])
    events = {"initialised": np.array([1, 0, 0, 0])}
    one = episode(actions=actions, motion_read=np.ones(4, bool), events=events)  # a step is 0.5 s
    assert measures.share([one], measures.LATERAL) == 50.0
    assert measures.share([one], [Motion.UP], until=0.5) == 0
    assert measures.share([one], measures.LATERAL, after="initialised") == 100.0
    assert measures.within([episode()]) == 100.0
    assert measures.nearest([episode()]) == pytest.approx(0.0)
    nees = episode(position_nees=np.full(5, 3.0), landmark_nees=np.array([np.nan, np.nan, 1.0, 2.0, 3.0]))
    np.testing.assert_array_equal(measures.mean_nees([nees]), [[2.0], [2.0]])
    runs = [episode(lost=lost, log_score=np.full(5, x)) for lost, x in zip((0, 0, 1, 0, 0), (1.0, 5.0, 2.0, 4.0, 3.0))]
    assert measures.middle([runs]) == 3 and measures.middle([runs[2:3]]) == 0  # the upper of the two in the middle


def test_the_drop_at_a_closure_is_against_the_second_before() -> None:
    env, loops = environment(4.0), measures.Loops()
    run = run_episode(env, baselines.make("stay", env), seed=5, observers=[loops])
    assert 0.0 < loops.result(run)["fiducials"] <= env.unwrapped.scenario.fiducial_count
    steps, closed = len(run.actions), 40
    slopes = np.where(np.arange(steps) < closed, -1.0, -3.0)  # bits a step, before and from the closure on
    loops._log2_det = [0.0, *np.cumsum(slopes)]
    loops._closed = [0] * (steps + 1)
    assert np.isnan(loops.result(run)["drop"]) and loops.result(run)["closure"] == run.times[-1]
    loops._closed[closed + 1] = loops._closed[closed + 6] = 1  # after the step; the second is the same event
    found = loops.result(run)
    assert found["drop"] == -60.0 + 20.0 and found["closure"] == pytest.approx((closed + 1) * 0.05)
    counted = LoopClosures()
    assert [counted.count([-1], time) for time in (0.0, 0.1, CLOSURE_GAP + 0.1)] == [0, 0, 1]


def test_expected_landmarks_that_no_camera_sees_are_in_no_score() -> None:
    env = environment()
    env.reset(seed=5)
    core = env.unwrapped
    before = core.motion_scores("mutual_information")
    measures.WithoutExpected()(core, {})
    models, whole = core.setting.models, core.predicted_belief
    size = len(whole.covariance) - 3 * whole.waiting
    P = whole.covariance[:size, :size].copy()
    rest = whole._replace(points=whole.points[: -whole.waiting], covariance=P, waiting=0)
    for criterion in ("mutual_information", "fisher_trace"):
        without, plans, open_loop = np.empty(len(Motion)), motion_plans(20), np.zeros(1, OPEN_LOOP)
        number = list(CRITERIA).index(criterion)
        score_plans(models.lens, models.motion, rest, 0.0, plans, number, open_loop, without)
        np.testing.assert_array_equal(core.motion_scores(criterion), without)
    assert (before > core.motion_scores("mutual_information")).any()


def test_the_command_fills_its_page(tmp_path: Path) -> None:
    page = tmp_path / "paper.md"
    page.write_text("<!-- generated: paper -->\n<!-- end: paper -->\n")
    paper.main(paper.Args(episodes=2, seconds=2.0, report=(page,), out=tmp_path / "store"))
    rows = [line for line in page.read_text().splitlines() if line.startswith("| ")]
    assert len(rows) == 29 and {len(row.split(" | ")) for row in rows} == {5}
    assert "python -m studies.paper --episodes 2 --seconds 2 --seed 1000000\n" in page.read_text()
    pictures = {path.stem for path in (tmp_path / "images" / "paper").glob("*.png")}
    assert pictures == {"maps", "entropies", "errors", "live"}


def test_a_camera_that_stays_does_not_grow_sure_of_what_it_sees_wrong() -> None:
    """Each template has an error that is the same in all images of one view: they tell no more than a few of them."""
    assert min(one.log_score for one in trial(4_305_200_005, STILL, 8.0)) > 200.0


def test_the_log_score_of_the_live_study_is_that_of_the_environment_with_images() -> None:
    """Its N slots have true points: scene points of features, and random points of the room scored by the prior."""
    room = RenderedRoom(5)
    session, evaluator, seconds = Session(room, 5), Evaluator(room, 5), []
    for k in range(31):
        evaluator.add(session, session.step())
        if k % 15 == 0:
            seconds.append(evaluator.second())
    assert seconds[0].log_score == 0.0 and seconds[2].log_score > seconds[1].log_score > 50.0
    estimate, truth = taken_estimate(session.front_end.estimate()), room.person.state
    slots, _ = session.adviser.expected.factored()
    landmarks, variance = evaluator._spare.copy(), np.array(ROOM.landmark_prior_variance)
    counting = slots[slots >= 0]
    landmarks[slots >= 0] = evaluator._followed.of(estimate.ids[counting])
    rows = np.r_[:12, (12 + 3 * counting[:, None] + np.arange(3)).ravel()]
    error = np.r_[camera_error(truth, estimate.camera), (landmarks[slots >= 0] - estimate.points[counting]).ravel()]
    density = multivariate_normal(cov=estimate.covariance[np.ix_(rows, rows)]).logpdf(error)
    density += norm(scale=np.sqrt(variance)).logpdf(landmarks[slots < 0]).sum()
    assert 0 < len(counting) < ROOM.landmark_count
    assert seconds[2].log_score == pytest.approx(density / np.log(2.0) - evaluator._first_density, rel=1e-9)


def test_the_command_fills_its_page_and_makes_no_episode_twice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = tmp_path / "page.md"
    page.write_text("<!-- generated: live -->\nold\n<!-- end: live -->\n")
    args = live.Args(episodes=1, seed=9, seconds=(2.0,), out=tmp_path / "out", report=(page,))
    live.main(args)
    text = page.read_text()
    assert "old" not in text and "| 2 s, 1 rooms | follows |" in text and "--episodes 1 --seconds 2 --seed 9" in text
    (kept,) = (tmp_path / "out").glob(f"9-{STILL}-*")
    kept.write_text("{")  # damaged: made again
    again: list[tuple[Any, ...]] = []
    monkeypatch.setattr(live, "trial", lambda *task: again.append(task) or trial(*task))
    live.main(args)
    assert again == [(9, STILL, 2.0)] and page.read_text() == text


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A hand that sways, and turns a little, for 4 s."""
    times = np.arange(121) / 30.0
    positions = np.stack((0.2 * np.sin(times), np.full(121, 1.2), 0.1 * times), axis=1)
    looks = Rotation.from_rotvec(np.outer(0.2 * times, (0, 1, 0))) * Rotation.from_matrix(np.diag((-1.0, -1.0, 1.0)))
    write_tum(tmp_path / "path.tum", times, positions, np.roll(looks.as_quat(), 1, axis=1))
    return tmp_path / "path.tum"


def test_an_excerpt_begins_at_rest_at_unity_and_its_velocities_are_those_of_its_poses(path: Path) -> None:
    cameras = next(excerpts.excerpts(path, 4.0))
    np.testing.assert_allclose(cameras[0], np.eye(1, 13, 3)[0], atol=1e-9)
    steps = excerpts.RATE * np.diff(cameras[:, :3], axis=0)
    turns = [excerpts.RATE * rotation_error(b[3:7], a[3:7]) for a, b in zip(cameras, cameras[1:])]
    middle = 0.5 * (cameras[1:] + cameras[:-1])
    np.testing.assert_allclose(steps, middle[:, 7:10], atol=0.01)
    np.testing.assert_allclose(turns, middle[:, 10:], atol=0.01)


@pytest.mark.parametrize("lens", excerpts.LENSES)
def test_an_excerpt_is_tracked_through_every_lens(path: Path, lens: str) -> None:
    done = excerpts.flown(next(excerpts.excerpts(path, 3.0)), excerpts.LENSES[lens], excerpts.config.TRAINING_SEED)
    assert done is not None and not done.lost and done.error < 0.03 and max(done.nees) < 3.0
