"""`best-constant`, and the tables of the choices in the named scenarios."""

import json
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from activeslam_gym import SCENARIOS, Gaze, Motion, Scenario
from agents.task import make_environment
from baselines import __main__ as table
from baselines import constants, readings, sequences
from baselines.constants import CONSTANTS, TABLE, best_constant, choose, key_of, log_scores

SECOND = (1.0, 1.0, 3.0)


def bare(**arguments: Any) -> Any:
    return gym.make("ActiveSLAM-v0", **arguments).unwrapped


def test_the_shipped_choices_are_of_the_scenarios_as_they_are_and_the_best_of_their_finalists() -> None:
    shipped = json.loads(TABLE.read_text(encoding="utf-8"))
    assert "paper" in {entry["scenario"] for entry in shipped.values()}
    for key, entry in shipped.items():
        env = make_environment({"scenario": entry["scenario"]}).unwrapped
        assert key == key_of(env), "regenerate it: python -m baselines"
        best = max(entry["medians"], key=entry["medians"].get)
        assert best == f"{entry['motion']} {entry['gaze']}"


def test_the_choice_has_the_highest_median_in_rooms_of_training_and_is_made_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
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
