"""`best-constant`, shares of a lead, the loose bound, and the command that sets policies between their bounds."""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import baselines
from activeslam_gym import SCENARIOS, Gaze, Motion, Scenario
from agents.__main__ import main
from agents.bounds.ceiling import ceiling
from agents.task import make_environment, run_policy
from agents.tools.statistics import shares
from baselines import __main__ as table
from baselines import constants, readings, sequences
from baselines.constants import CONSTANTS, TABLE, best_constant, choose, key_of, log_scores

ORBITS = {(Motion.RIGHT, Gaze.LEFT), (Motion.LEFT, Gaze.RIGHT)}
SECOND = (1.0, 1.0, 3.0)


def bare(**arguments: Any) -> Any:
    return gym.make("ActiveSLAM-v0", **arguments).unwrapped


def test_in_the_papers_room_the_best_constant_is_an_orbit_held_in_every_step() -> None:
    env = bare(gaze_period=0.5, duration=35.0)
    policy, observation = baselines.make("best-constant", env), env.reset(seed=0)[0]
    for _ in range(3):
        action, _ = policy.predict(observation)
        assert tuple(action.tolist()) == best_constant(env) and best_constant(env) in ORBITS
        observation, *_ = env.step(action)


def test_the_shipped_choices_are_of_the_scenarios_as_they_are_and_the_best_of_their_finalists() -> None:
    shipped = json.loads(TABLE.read_text(encoding="utf-8"))
    assert "paper" in {entry["scenario"] for entry in shipped.values()}
    for key, entry in shipped.items():
        env = make_environment({"scenario": entry["scenario"]}).unwrapped
        assert key == key_of(env), "regenerate it: python -m baselines"
        best = max(entry["medians"], key=entry["medians"].get)
        assert best == f"{entry['motion']} {entry['gaze']}"


def test_a_name_changes_no_choice_and_a_field_or_a_time_does() -> None:
    plain = key_of(bare())
    assert key_of(bare(scenario={"name": "another"})) == plain
    others = ({"scenario": {"pixel_std": 4.0}}, {"duration": 34.0}, {"motion_period": 0.5})
    assert len({plain, *(key_of(bare(**one)) for one in others)}) == 4


def test_the_choice_has_the_highest_median_in_rooms_of_training_and_is_made_once(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, rooms in (("ROOMS", 3), ("FINALISTS", 21), ("LAST_ROOMS", 2)):
        monkeypatch.setattr(constants, name, rooms)
    chosen = choose(Scenario(), *SECOND)
    scores = log_scores(CONSTANTS[:, None], Scenario(), range(2**32 + 3, 2**32 + 5), SECOND)
    medians = {f"{Motion(m).name} {Gaze(g).name}": np.median(row) for (m, g), row in zip(CONSTANTS, scores)}
    assert f"{chosen['motion']} {chosen['gaze']}" == max(medians, key=lambda name: medians[name])
    assert chosen["medians"] == {name: pytest.approx(median, abs=0.06) for name, median in medians.items()}
    env = bare(scenario={"name": "mine", "pixel_std": 2.5}, duration=3.0)
    first = best_constant(env)
    assert "'mine'" in capsys.readouterr().err
    assert best_constant(env) == first and not capsys.readouterr().err


def test_of_images_all_are_searched_without_them_and_the_finalists_judged_with_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    images, played = replace(SCENARIOS["pixels"], sensor="images"), []

    def scores(plans: list[Any], scenario: Scenario, seeds: range, *_: Any) -> np.ndarray:
        played.append((scenario.sensor, len(plans)))
        return np.random.default_rng(len(played)).normal(size=(len(plans), len(seeds)))

    monkeypatch.setattr(constants, "log_scores", scores)
    choose(images, *SECOND)
    assert played == [("corners", 21), ("images", constants.FINALISTS)]
    played.clear()
    sequences.choose_sequence(images, *SECOND)
    assert {sensor for sensor, _ in played[:-1]} == {"corners"} and played[-1] == ("images", 6)


def test_the_command_makes_the_named_ones_anew_and_keeps_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    made = {"scenario": "paper", "medians": {"UP LEFT": 1.0}}
    paths = tmp_path / "constants.json", tmp_path / "sequences.json", tmp_path / "readings.json"
    choices = "choose", "choose_sequence", "choose_readings"
    for path, home, choice in zip(paths, (constants, sequences, readings), choices):
        path.write_text(json.dumps({"old": {"scenario": "paper"}, "kept": {"scenario": "hall"}}), encoding="utf-8")
        monkeypatch.setattr(home, "TABLE", path)
        monkeypatch.setattr(home, choice, lambda scenario, *times: made)
    assert table.main(["paper"]) == 0
    for path in paths:
        written = json.loads(path.read_text(encoding="utf-8"))
        assert written == {"kept": {"scenario": "hall"}, key_of(bare()): made}
    assert table.main(["nowhere"]) == 2
    told = capsys.readouterr().err
    assert all(name in told for name in ("nowhere", *SCENARIOS))


def test_shares_of_the_planners_lead() -> None:
    base = {0: 10.0, 1: 20.0, 2: 0.0}
    planner = {0: 14.0, 1: 22.0}
    half = {0: 11.0, 1: 22.0, 2: 99.0}  # room 2, which the planner has not seen, is left out
    found = shares({"base": base, "planner": planner, "half": half}, "planner", "base")
    assert [found[name].value for name in ("base", "planner", "half")] == [0.0, 1.0, 0.5]
    assert found["half"].rooms == 2
    assert math.isnan(shares({"a": base, "b": base}, "a", "b")["a"].value)  # a planner without a lead


def test_the_loose_bound_is_above_a_real_run_and_below_it_with_a_worse_camera() -> None:
    settings = {"gaze_period": 0.25, "duration": 10.0}
    (episode,) = run_policy("orbit", make_environment(settings), [1])
    gained = episode.log_score[-1] - episode.log_score[0]
    best, worse = ceiling(episode, Scenario()), ceiling(episode, Scenario(pixel_std=4.0))
    assert best > gained
    assert best - worse == pytest.approx(3.0 * 27, abs=0.5)  # half the sharpness: a bit in each dimension


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_the_command_writes_table_and_figure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for few, value in (("HALVINGS", ((1, 2),)), ("REFINEMENTS", 0)):
        monkeypatch.setattr(sequences, few, value)
    page = tmp_path / "page.md"
    page.write_text("<!-- generated: bounds -->\n<!-- end: bounds -->\n", encoding="utf-8")
    given = ["--scenarios", "paper", "--episodes", "2", "--duration", "2", "--greedy", "mi-constant"]
    where = ["--learned", "sweep", "--out", str(tmp_path / "out"), "--report", str(page), "--jobs", "1"]
    assert main(["bounds", *given, *where]) == 0
    rows = [line for line in page.read_text(encoding="utf-8").splitlines() if line.startswith("| ")]
    planners = ["planner, 8 runs", "planner, 24 runs", "planner, 72 runs", "oracle planner"]
    names = ["best-constant", "best-sequence", "mi-constant", "sweep", *planners, "upper bound on its path"]
    assert [row.split(" | ")[0][2:] for row in rows[2:]] == names
    pytest.importorskip("matplotlib")
    assert (tmp_path / "images" / "bounds.png").stat().st_size > 10_000
