"""The paper's study: verdicts on made-up rows with known answers, the altered strategies, then the command, small."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import activeslam_gym  # noqa: F401  (registers the environment)
import baselines
from activeslam_gym import Motion
from activeslam_gym.config import Scenario
from activeslam_gym.evaluation import TARGET, Episode, Store, run_episode
from activeslam_gym.information.candidates import motion_plans, score_plans
from activeslam_gym.information.criteria import CRITERIA
from activeslam_gym.metrics import CLOSURE_GAP, LoopClosures
from activeslam_gym.motion import CAMERA_DIM
from agents import policies
from agents import task as tasks
from agents.__main__ import main
from agents.places import PLACES, Placed
from agents.study import conditions, strategies, toy, verdicts
from agents.study.claims import CLAIMS
from agents.study.command import median_room
from agents.study.conditions import STRATEGIES, Condition, at_target, lead_at_common_rung
from agents.study.measures import Notes, Observer, measures
from agents.study.verdicts import FAILS, HOLDS, OPEN, OUTSIDE, WITHIN, Finding, judge, judge_draw
from agents.tools.statistics import Estimate
from tests.test_compare import episode as made_up

ROOMS = 40
SCENARIO = Scenario()


def environment(duration: float = 3.0) -> gym.Env:
    return gym.make("ActiveSLAM-v0", gaze_period=0.05, duration=duration)


def figure(value: float, low: float, high: float, rooms: int = ROOMS) -> Estimate:
    return Estimate(value, low, high, rooms, "median")


def test_a_verdict_needs_the_whole_interval_of_enough_rooms_on_one_side_and_a_stated_number_is_one_draw() -> None:
    assert judge(figure(2.0, 1.0, 3.0), "above") == judge(figure(-2.0, -3.0, -1.0), "below") == HOLDS
    assert judge(figure(2.0, 1.0, 3.0), "below") == FAILS
    undecided = [judge(figure(2.0, 1.0, 3.0), "above", 1.5), judge(figure(1.0, 0.0, 2.0), "above")]
    undecided += [judge(figure(1.0, np.nan, np.nan), "above"), judge(figure(2.0, 1.0, 3.0, 9), "above")]
    assert set(undecided) == {OPEN}
    draws = np.linspace(0.0, 100.0, 101)
    assert [judge_draw(draws, stated) for stated in (50.0, 1.0, 99.0)] == [WITHIN, OUTSIDE, OUTSIDE]


def difference(*values: np.ndarray) -> Finding:
    return verdicts.judged("x", "m", values[0] - values[1], "above")


def test_rooms_are_compared_in_pairs_and_equal_strategies_show_nothing() -> None:
    """Rooms that differ by far more than the strategies hide nothing, since the difference is taken in each room."""
    rng = np.random.default_rng(0)
    rooms = rng.normal(0.0, 100.0, ROOMS)
    ours, theirs = rooms + 1.0 + rng.normal(0.0, 0.5, ROOMS), rooms
    assert difference(ours, theirs).verdict == HOLDS
    assert difference(ours, rng.permutation(theirs)).verdict == OPEN
    noise = np.random.default_rng(1).normal(0.0, 1.0, (2, ROOMS))
    finding = difference(*(noise - np.median(noise, axis=1, keepdims=True)))
    assert finding.verdict == OPEN and finding.estimate.low < 0.0 < finding.estimate.high
    finding = difference(np.r_[[np.nan] * 3, np.ones(ROOMS - 3)], np.zeros(ROOMS))
    assert finding.estimate.rooms == ROOMS - 3 and finding.note == f"3 of {ROOMS} rooms left out"


def test_times_not_seen_and_ladders_that_end_early_are_compared_fairly() -> None:
    runs = [{"time": [1.0, 2.0], "lost": 1, "error": 0.1}, {"time": [7.0] * TARGET, "lost": 0, "error": 0.2}]
    np.testing.assert_array_equal(at_target(runs, "time", 35.0), [35.0, 7.0])
    np.testing.assert_array_equal(conditions.while_alive(runs, "error"), [np.nan, 0.2])
    ours = [{"l": [-1.0, -2.0, -3.0]}, {"l": [-1.0]}, {"l": []}, {"l": [-5.0] * 20}]
    theirs = [{"l": [-10.0, -20.0]}, {"l": [-10.0, -20.0]}, {"l": [-10.0]}, {"l": np.arange(20.0)}]
    np.testing.assert_array_equal(lead_at_common_rung("l", ours, theirs), [18.0, 9.0, np.nan, -5.0 - (TARGET - 1)])


def test_verdicts_of_several_choices_in_a_line_and_the_median_room() -> None:
    one = Finding("m", figure(1, 0.5, 2), HOLDS, choice="a")
    assert verdicts.under_choices([one]) == ""
    assert verdicts.under_choices([one, replace(one, choice="b")]) == "holds under every choice"
    text = verdicts.under_choices([replace(one, choice="z", verdict=FAILS), one, replace(one, choice="b")])
    assert text == "holds: a, b; does not hold: z"
    scores = [10.0, 20.0, 30.0, 40.0, 50.0]
    runs = [{"seed": i, "lost": int(i == 2), "log_score_gain": s} for i, s in enumerate(scores)]
    assert median_room(runs, runs, runs) == 3  # of 10, 20, 40, 50: the upper of the two in the middle
    live = [{"seed": i, "lost": int(i < 4), "log_score_gain": s} for i, s in enumerate(scores)]
    assert median_room(live) == 4, "a live run that was lost at once was drawn: an empty panel"
    assert median_room(live[:4]) == 2  # where all are lost


def test_toy_information_is_the_drop_of_entropy() -> None:
    """1/2 log2(|S| / |R|) = 1/2 log2(|P| / |P - P H^T S^-1 H P|), with H by differences."""
    scene, place = toy.Toy(half_view=np.pi), np.array([0.2, 0.1])

    def bearings(x: np.ndarray) -> np.ndarray:
        d = x[2:].reshape(-1, 2) - x[:2]
        return np.arctan2(d[:, 1], d[:, 0])

    x = np.concatenate((place, scene.landmarks.ravel()))
    H = np.stack([(bearings(x + e) - bearings(x - e)) / 2e-6 for e in 1e-6 * np.eye(len(x))], axis=1)
    P = scene.covariance
    P[:2, :2] += scene.motion_std**2 * np.eye(2)
    S = H @ P @ H.T + scene.bearing_std**2 * np.eye(len(H))
    posterior = P - P @ H.T @ np.linalg.solve(S, H @ P)
    drop = 0.5 * (np.linalg.slogdet(P)[1] - np.linalg.slogdet(posterior)[1]) / np.log(2.0)
    assert float(toy.information(scene, place)) == pytest.approx(drop, rel=1e-5)


def test_between_two_equal_landmarks_the_best_move_is_straight_ahead() -> None:
    scene = toy.Toy(bearings=(np.pi / 3, 2 * np.pi / 3), ranges=(1.5, 1.5))
    assert toy.best_direction(scene) == pytest.approx(np.pi / 2)
    assert toy.lies_between(scene, 0, 1)
    assert toy.lies_between(toy.Toy(step=0.6, half_view=np.pi))  # figure 1: landmarks 2 and 3, seen all around
    assert float(toy.information(toy.Toy(half_view=0.0), np.array([0.3, 0.3]))) == 0.0  # nothing is in view


@pytest.mark.parametrize(("name", "gaze_criterion"), [("mi-constant", None), ("mi-mi", "mutual_information")])
def test_the_default_reading_is_the_baseline(name: str, gaze_criterion: str | None) -> None:
    env = environment()
    expected = run_episode(env, baselines.make(name, env), seed=5)
    found = run_episode(env, strategies.Reread(env, gaze_criterion=gaze_criterion), seed=5)
    np.testing.assert_array_equal(found.actions, expected.actions)


def test_a_cap_touches_expected_landmarks_alone_and_without_one_the_scores_are_the_environments(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    core: Any = environment().unwrapped
    core.reset(seed=5)
    prospect, P = core.prospect, core.prospect.covariance
    capped = strategies.capped(prospect.points, P, prospect.camera, SCENARIO.landmark_count, SCENARIO)
    lowered = np.diag(capped) < np.diag(P)
    assert (np.diag(capped) <= np.diag(P)).all() and lowered[CAMERA_DIM:].any()
    np.testing.assert_array_equal(capped[:CAMERA_DIM], P[:CAMERA_DIM])
    np.testing.assert_array_equal(strategies.capped(prospect.points, P, prospect.camera, 0, SCENARIO), P)
    monkeypatch.setattr(strategies, "capped", lambda points, P, *_: P)
    policy = strategies.Reread(core, capped=True)
    for plans in (policy._motions, policy._gazes):
        for criterion in ("mutual_information", "fisher_trace"):
            found, expected = policy._capped_scores(plans, criterion), core.scores(plans, criterion)
            np.testing.assert_allclose(found, expected, rtol=1e-12)


@pytest.mark.parametrize("place", PLACES)
def test_expected_landmarks_move_and_nothing_else(place: str) -> None:
    plain, placed = environment(), Placed(environment(), place)
    plain.reset(seed=5), placed.reset(seed=5)
    one, other = plain.unwrapped, placed.unwrapped
    assert not np.array_equal(one.prospect.points, other.prospect.points)
    np.testing.assert_array_equal(one.truth.landmarks, other.truth.landmarks)
    assert one.belief.log2_det() == other.belief.log2_det()
    with pytest.raises(ValueError, match="place must be one of"):
        Placed(plain, "elsewhere")


def test_landmarks_that_are_nowhere_are_in_no_score_and_the_lattice_fills_the_room() -> None:
    env = Placed(environment(), "nowhere")
    env.reset(seed=5)
    core: Any = env.unwrapped
    models, whole = core.setting.models, core.prospect
    assert whole.waiting == SCENARIO.landmark_count
    size = len(whole.covariance) - 3 * whole.waiting
    P = whole.covariance[:size, :size].copy()
    rest = whole._replace(points=whole.points[: -whole.waiting], covariance=P, waiting=0)
    for criterion in ("mutual_information", "fisher_trace"):
        without, plans = np.empty(len(Motion)), motion_plans(20)
        score_plans(models.camera, models.motion, rest, 0.0, plans, CRITERIA.number(criterion), without)
        np.testing.assert_array_equal(core.motion_scores(criterion), without)
    points = PLACES["lattice"](SCENARIO, 3)
    assert len(np.unique(points, axis=0)) == SCENARIO.landmark_count
    assert (np.abs(points) < np.array(SCENARIO.room_size) / 2.0).all()
    np.testing.assert_allclose(points.mean(axis=0), 0.0, atol=1e-12)


def observed(name: str) -> tuple[Episode, Notes]:
    """Four seconds of a baseline, and the observer's notes of them."""
    env, observer = environment(4.0), Observer()
    return run_episode(env, baselines.make(name, env), seed=5, looks=[observer.look]), observer.notes


def test_notes_of_a_run_and_when_a_loop_closes() -> None:
    episode, notes = observed("mi-mi")
    assert len(notes.fiducials) == len(notes.births) == len(notes.nearest) == len(episode.actions)
    assert 0 < notes.fiducials.max() <= SCENARIO.fiducial_count
    assert len(notes.visited_log2_det) == len(episode.landmark_times) > 0
    assert (np.diff(notes.visited_log2_det) < 0).all()  # each brings three small variances
    loops = LoopClosures()
    assert loops.count([-1], 0.0) == loops.count([-2], 0.1) == 0
    assert [loops.count([-1, -2, -3], CLOSURE_GAP) for _ in range(2)] == [1, 0]


def test_measures_of_a_made_up_run() -> None:
    episode, _ = observed("stay")
    motions = np.repeat([Motion.STAY, Motion.UP, Motion.FORWARD, Motion.STAY], round(1.0 / 0.05))
    actions = np.stack((motions, episode.actions[:, 1]), axis=1)
    episode = replace(episode, actions=actions, landmarks_mapped=np.zeros_like(episode.landmarks_mapped))
    births, closures = np.zeros((2, len(actions)), int)
    births[3], closures[30] = 1, 2
    notes = Notes(np.full(len(actions), 2), births, closures, np.full(len(actions), 1.5), np.array([]))
    row = measures(episode, notes)
    assert row["lateral_after_birth"] == 1.0  # UP, after the initialisation in the first second
    assert row["lateral_otherwise"] == 0.0
    assert np.isnan(row["lateral_after_mapping"])
    assert (row["stay_share"], row["forward_share"], row["lateral_first_minute"]) == (0.5, 0.25, 0.25)
    assert (row["fiducials_a_frame"], row["nearest_mean"], row["closures"]) == (2.0, 1.5, 2.0)
    assert row["first_closure"] == pytest.approx(31 * 0.05)


def test_the_drop_at_a_closure_is_against_the_second_before() -> None:
    episode, notes = observed("stay")
    steps, closed = len(episode.actions), 40
    slopes = np.where(np.arange(steps) < closed, -1.0, -3.0)  # bits a step, before and from the closure on
    falling = np.concatenate(([0.0], np.cumsum(slopes)))
    closures = np.zeros(steps, int)
    closures[[closed, closed + 5]] = 1  # the second is the same event
    notes = notes._replace(closures=closures)
    row = measures(replace(episode, log2_det_camera=falling), notes)
    assert (row["before_change_camera"], row["closure_change_camera"]) == (-20.0, -60.0)
    closures[:] = 0
    assert np.isnan(measures(episode, notes)["closure_change_camera"])


def test_conditions_have_names_of_their_own_and_known_policies_and_those_of_equal_settings_share_episodes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    every = {(one.choice, one.policy): one for one in conditions.conditions()}
    assert len(every) == len(conditions.conditions())
    for one in every.values():
        policies.factory(one.source)
        Scenario(**one.environment()["scenario"])
    assert every["eigenvalue", "mi-constant"].task(1) == every["default", "mi-constant"].task(1)
    assert every["eigenvalue", "mi-fisher"].task(1) != every["default", "mi-fisher"].task(1)
    played: list[int] = []

    def play(group: tuple[tasks.Task, ...]) -> list[Any]:
        played.extend(task.seed for task in group)
        return [replace(made_up(seed=task.seed), notes={"seed": np.array(task.seed)}).arrays() for task in group]

    monkeypatch.setattr(tasks, "play_tasks", play)
    twins = [Condition("a", "mi-mi", "mi-mi"), Condition("b", "mi-mi", "mi-mi")]
    for _ in range(2):
        rows = conditions.run_conditions({twins[0]: [1, 2], twins[1]: [2]}, Store(tmp_path), jobs=1)
        assert played == [1, 2]
        assert [[row["seed"] for row in rows[one, "mi-mi"]] for one in "ab"] == [[1, 2], [2]]
    conditions.run_conditions({replace(twins[0], duration=2.0): [1]}, Store(tmp_path), jobs=1)
    assert played == [1, 2, 1]


def test_the_command_run_small(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = "study --episodes 2 --choice-episodes 1 --duration 1 --jobs 1 --out".split()
    assert main([*arguments, str(tmp_path)]) == 0
    assert "Written to" in capsys.readouterr().out
    page = (tmp_path / "STUDY.md").read_text(encoding="utf-8")
    assert "python -m agents study --episodes 2 --choice-episodes 1 --duration 1 --seed 1000000" in page
    assert all(claim.words in page for claim in CLAIMS)
    study = json.loads((tmp_path / "study.json").read_text(encoding="utf-8"))
    assert {finding["claim"] for finding in study["findings"]} == {claim.key for claim in CLAIMS}
    for name in STRATEGIES:
        files = (tmp_path / "trajectories" / f"{name}-{kind}.tum" for kind in ("true", "estimated"))
        true, estimated = map(np.loadtxt, files)
        assert true.shape == estimated.shape == (5, 8)
    assert all(f"images/study/{path.name}" in page for path in (tmp_path / "images" / "study").glob("*"))
