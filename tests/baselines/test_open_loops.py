"""`best-constant` and `best-sequence`: how they are chosen, what they play, and the shipped tables of the choices."""

import json
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from activeslam_gym import SCENARIOS, Gaze, Motion, Scenario
from activeslam_gym.evaluation import run_episode
from agents.task import make_environment
from baselines import __main__ as table
from baselines import constants, readings, sequences
from baselines.constants import CONSTANTS, best_constant, choose, key_of
from baselines.fixed import Planned
from baselines.sequences import Sequence, choose_sequence, constant, log_scores, sequence_from

BACK_THEN_ORBIT = Sequence(((int(Motion.BACKWARDS), int(Gaze.STAY)), (int(Motion.RIGHT), int(Gaze.LEFT))), (0.54, 1.0))
TIMES = (0.5, 1.0, 3.0)


def bare(**arguments: Any) -> Any:
    return gym.make("ActiveSLAM-v0", **arguments).unwrapped


@pytest.mark.parametrize("module", [constants, sequences])
def test_the_shipped_choices_are_of_the_scenarios_as_they_are_and_the_best_of_their_finalists(module: Any) -> None:
    shipped = json.loads(module.TABLE.read_text(encoding="utf-8"))
    assert "paper" in {entry["scenario"] for entry in shipped.values()}
    for key, entry in shipped.items():
        env = make_environment({"scenario": entry["scenario"]}).unwrapped
        assert key == key_of(env), "regenerate it: python -m baselines"
        chosen = f"{entry['motion']} {entry['gaze']}" if module is constants else sequences.best_sequence(env).words()
        assert max(entry["medians"], key=entry["medians"].get) == chosen


def test_the_choice_has_the_highest_median_in_rooms_of_training_and_is_made_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    for name, rooms in (("ROOMS", 3), ("FINALISTS", 21), ("LAST_ROOMS", 2)):
        monkeypatch.setattr(constants, name, rooms)
    chosen = choose(Scenario(), 1.0, 1.0, 3.0)
    scores = constants.log_scores(CONSTANTS[:, None], Scenario(), range(2**32 + 3, 2**32 + 5), (1.0, 1.0, 3.0))
    medians = {f"{Motion(m).name} {Gaze(g).name}": np.median(row) for (m, g), row in zip(CONSTANTS, scores)}
    assert f"{chosen['motion']} {chosen['gaze']}" == max(medians, key=lambda name: medians[name])
    assert chosen["medians"] == {name: pytest.approx(median, abs=0.06) for name, median in medians.items()}
    env = bare(scenario={"name": "mine", "pixel_std": 2.5}, duration=3.0)
    first = best_constant(env)
    assert "'mine'" in capsys.readouterr().err
    assert best_constant(env) == first and not capsys.readouterr().err


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


def test_a_plan_holds_each_action_for_its_share_and_words_tell_it() -> None:
    plan = BACK_THEN_ORBIT.plan(10)
    assert plan.tolist() == [list(BACK_THEN_ORBIT.actions[0])] * 6 + [list(BACK_THEN_ORBIT.actions[1])] * 4
    assert constant((2, 1)).plan(3).tolist() == [[2, 1]] * 3
    assert BACK_THEN_ORBIT.words() == "BACKWARDS STAY to 54 %, then RIGHT LEFT"


def test_scores_of_a_constant_are_those_of_the_constant_action() -> None:
    found = log_scores([constant((4, 0)), BACK_THEN_ORBIT], Scenario(), range(3), TIMES)
    (alone,) = constants.log_scores(np.array([[(4, 0)]]), Scenario(), range(3), TIMES)
    np.testing.assert_array_equal(found[0], alone)
    assert (found[1] != alone).all()


def test_the_policy_plays_the_sequence() -> None:
    env = gym.make("ActiveSLAM-v0", gaze_period=0.5, duration=3.0, end_when_lost=False)
    run = run_episode(env, Planned(env, BACK_THEN_ORBIT.plan(3)), seed=1)
    assert run.log_score[-1] == log_scores([BACK_THEN_ORBIT], Scenario(), [1], TIMES)[0, 0]


def test_the_search_finds_what_is_better_than_every_constant(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a world in which only BACKWARDS for a third, then orbit, is worth anything."""
    wanted = Sequence(BACK_THEN_ORBIT.actions, (0.3, 1.0)).plan(35)

    def worths(pool: list[Sequence], scenario: Scenario, seeds: range, **_: Any) -> np.ndarray:
        return np.repeat([[(one.plan(35) == wanted).mean()] for one in pool], len(seeds), axis=1)

    monkeypatch.setattr(sequences, "log_scores", worths)
    monkeypatch.setattr(sequences, "REFINEMENTS", 40)
    found = sequence_from(choose_sequence(Scenario(), 1.0, 1.0, 35.0))
    held = [constant(action).plan(35) for action in BACK_THEN_ORBIT.actions]
    assert (found.plan(35) == wanted).mean() > 0.9 > max((plan == wanted).mean() for plan in held)


def test_every_constant_is_among_the_finalists_though_the_first_rooms_speak_against_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    held = constant((int(Motion.UP), int(Gaze.LEFT)))

    def worths(pool: list[Sequence], scenario: Scenario, seeds: range, **_: Any) -> np.ndarray:
        last = len(seeds) == sequences.LAST_ROOMS
        return np.repeat([[1.0 if (one == held) is last else 0.0] for one in pool], len(seeds), axis=1)

    monkeypatch.setattr(sequences, "log_scores", worths)
    assert sequence_from(choose_sequence(Scenario(), 1.0, 1.0, 35.0)) == held
