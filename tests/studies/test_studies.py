"""`python -m studies.…`, small, and its measures, which have known answers; their whole tables are in docs/."""

import csv
import re
from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import baselines
from activeslam_gym import Motion
from activeslam_gym.evaluation import TARGET, run_episode
from activeslam_gym.information.candidates import motion_plans, score_plans
from activeslam_gym.information.criteria import CRITERIA
from activeslam_gym.metrics import CLOSURE_GAP, LoopClosures
from agents import task as tasks
from agents.summary import aggregate
from studies import consistency, learning, measures, paper, upper_reference
from studies.removals import REMOVALS
from studies.worth import compared
from tests.agents.test_compare import episode

PACKAGE = Path(__file__).parents[2] / "activeslam_gym"


def test_consistency_fills_its_page_and_plays_no_episode_twice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page, variants = tmp_path / "page.md", ["inverse depth", "known association"]
    page.write_text("<!-- generated: consistency -->\n<!-- end: consistency -->\n")
    given = {"policies": ("sweep",), "variants": tuple(variants), "episodes": 2, "scenario": '{"landmark_count": 9}'}
    for _ in range(2):
        consistency.main(consistency.Args(**given, out=tmp_path / "store", report=page))
        monkeypatch.setattr(tasks, "play_tasks", lambda _: pytest.fail("played again"))
    rows = [one.strip("| ").split(" | ") for one in page.read_text().splitlines() if one.startswith("| `")]
    assert [row[1] for row in rows] == variants and all(0.0 < float(row[4]) < np.inf for row in rows)
    assert "python -m studies.consistency --policies sweep --episodes 2 --" in page.read_text()
    table = list(csv.DictReader((tmp_path / "consistency.csv").open()))
    assert [row["variant"] for row in table] == variants and float(table[0]["landmark_nees_35s"]) > 0.0
    assert (tmp_path / "images" / "nees.png").stat().st_size > 1000


def test_wrong_matches_are_a_share_of_all_and_losses_of_all_episodes() -> None:
    runs = [episode(lost=lost, log_score=np.full(5, 1.0), times=np.arange(5) * 1.0) for lost in (True, False)]
    for run, wrong in zip(runs, (3, 1)):
        run.events["wrong_matches"], run.notes["matches"] = np.array([wrong, 0]), np.array(100)
    cells = consistency.row_of("x", "inverse depth", runs)
    assert cells[:2] == ["`x`", "inverse depth"] and cells[2].startswith("50.0 [")
    assert cells[3:] == ["2.000", "1.00", "1.00"]


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


def environment(duration: float = 3.0) -> gym.Env:
    return gym.make("ActiveSLAM-v0", gaze_period=0.05, duration=duration)


def test_a_verdict_needs_the_whole_interval_of_enough_episodes_on_one_side() -> None:
    noise = np.random.default_rng(0).normal(0.0, 0.5, 40)
    verdicts = [paper.row("", "", values, above)[-1] for values in (noise + 2.0, noise) for above in (True, False)]
    assert verdicts == ["**holds**", "**does not hold**", "not significant", "not significant"]
    assert paper.row("", "", noise + 2.0, True, 1.9)[-1] == "not significant"
    assert paper.row("", "", noise[:9] + 2.0, True)[-1] == "too few episodes"
    assert paper.row("", "", np.r_[noise, np.nan], True)[3] == str(40)


def test_a_stated_number_has_its_rank_among_the_episodes_that_have_one() -> None:
    values = np.r_[np.arange(4.0), np.nan]
    assert paper.number("falls to {}", "", values, -5.0)[::4] == ["falls to −5", "rank 0.00"]
    assert paper.number("", "", values, 2.5)[3:] == ["4", "rank 0.75"]
    assert paper.number("", "", np.full(2, np.nan), 2.5)[3:] == ["0", "–"]


def test_numbers_of_made_up_episodes() -> None:
    late = episode(lost=True, landmark_times=np.arange(TARGET) + 1.0)
    np.testing.assert_array_equal(measures.at_target([late, episode()], "landmark_times", 2.0), [TARGET, 2.0])
    np.testing.assert_array_equal(measures.unless_lost([late, episode()], lambda one: 3.0), [np.nan, 3.0])
    actions = np.array([[motion, 0] for motion in (Motion.STAY, Motion.UP, Motion.UP, Motion.FORWARD)])
    events = {"initialised": np.array([1, 0, 0, 0])}
    one = episode(actions=actions, motion_read=np.ones(4, bool), events=events)  # a step is 0.5 s
    assert measures.share([one], measures.LATERAL) == 50.0
    assert (
        measures.share([one], measures.LATERAL, until=1.0) == 50.0
        and measures.share([one], [Motion.UP], until=0.5) == 0
    )
    assert measures.share([one], measures.LATERAL, after="initialised") == 100.0
    assert np.isnan(
        measures.share([replace(one, events={"initialised": np.zeros(4)})], [Motion.UP], after="initialised")
    )
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
        without, plans = np.empty(len(Motion)), motion_plans(20)
        score_plans(models.lens, models.motion, rest, 0.0, plans, list(CRITERIA).index(criterion), without)
        np.testing.assert_array_equal(core.motion_scores(criterion), without)
    assert (before > core.motion_scores("mutual_information")).any()


def test_the_command_fills_its_page(tmp_path: Path) -> None:
    page = tmp_path / "paper.md"
    page.write_text("<!-- generated: paper -->\n<!-- end: paper -->\n")
    paper.main(paper.Args(episodes=2, seconds=2.0, report=page, out=tmp_path / "store"))
    rows = [line for line in page.read_text().splitlines() if line.startswith("| ")]
    assert len(rows) == 29 and {len(row.split(" | ")) for row in rows} == {5}
    assert "python -m studies.paper --episodes 2 --seconds 2 --seed 1000000\n" in page.read_text()
    pictures = {path.stem for path in (tmp_path / "images" / "paper").glob("*.png")}
    assert pictures == {"maps", "entropies", "errors", "live"}


def test_a_search_in_the_true_room_is_no_worse_than_what_it_tried_first(monkeypatch: pytest.MonkeyPatch) -> None:
    given = {"autoreset_mode": "DISABLED", "gaze_period": 1.0, "end_when_lost": False}
    env = gym.make_vec("ActiveSLAM-v0", num_envs=16, scenario="office", duration=3.0, **given)
    held = np.array([(motion, gaze) for motion in range(7) for gaze in range(3)])[:16]
    scores = upper_reference.play(env, 7, np.repeat(held[:, None], 3, axis=1))
    np.testing.assert_array_equal(scores, upper_reference.play(env, 7, np.repeat(held[:, None], 3, axis=1)))
    found = []
    for generations in (1, 6):
        monkeypatch.setattr(upper_reference, "GENERATIONS", generations)
        found.append(upper_reference.search(env, 7, 3))
    assert found[0] < found[1] and found[1] > np.median(scores)
    env.close()


def test_learning_curves_are_read_by_seed_and_held_against_the_best_baseline(tmp_path: Path) -> None:
    for seed, scores in enumerate(((100.0, 300.0), (150.0, 200.0))):
        (tmp_path / f"ppo-{seed}").mkdir()
        lines = [f"{1000 * k},1,office,8,{score},0.25,1.0" for k, score in enumerate(scores)]
        header = "decisions,seconds,scenario,episodes,log_score,failures,policy_entropy"
        (tmp_path / f"ppo-{seed}" / "curve.csv").write_text("\n".join([header, *lines]) + "\n")
    curves = learning.read_curves(sorted(tmp_path.iterdir()))
    policies = {"office": {"mi-mi": aggregate([180.0] * 8, "IQM"), "generalist": aggregate([900.0] * 8, "IQM")}}
    assert learning.rows_of(curves, policies) == [["`office`", "ppo", "2", "1,000", "250 [200, 300]", "25.0"]]
    policies["office"]["mi-mi"] = aggregate([250.0] * 8, "IQM")
    assert learning.rows_of(curves, policies)[0][3] == "1 of 2 seeds do"
    with pytest.raises(ValueError, match="cannot be read"):
        learning.read_curves([tmp_path / "nothing"])
