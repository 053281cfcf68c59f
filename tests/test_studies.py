"""`python -m studies.…`, small; their whole tables are in docs/."""

import csv
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from agents import task as tasks
from studies import clients, consistency, rules, worlds
from tests.test_compare import episode


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


def test_worlds_tells_a_policy_beside_the_best_open_loop(capsys: pytest.CaptureFixture[str]) -> None:
    worlds.main(worlds.Args(scenarios=("office",), episodes=2, policies=("stay",)))
    rows = [one.split(" | ") for one in capsys.readouterr().out.splitlines() if one.startswith("| `")]
    assert [row[0][2:] for row in rows] == ["`best-constant`", "`sweep`", "`best-sequence`", "`stay`"]
    best = max(rows[:3], key=lambda row: float(row[1]))
    assert float(best[2]) == 0.0 and float(rows[3][2]) < 0.0


@pytest.mark.parametrize("name", ["GoBack", "Face", "SpinThenOrbit", "RIGHT_LEFT"])
def test_a_rule_does_in_a_batch_what_it_does_alone(name: str) -> None:
    given = {"scenario": "clusters", "duration": 15.0, "gaze_period": 0.5}
    batch, single = gym.make_vec("ActiveSLAM-v0", num_envs=2, **given), gym.make("ActiveSLAM-v0", **given)
    policy, alone = getattr(rules, name)(batch), getattr(rules, name)(single)
    (observations, _), (observation, _) = batch.reset(seed=3), single.reset(seed=4)
    taken = set()
    for _ in range(29):
        actions, action = policy.predict(observations)[0], alone.predict(observation)[0]
        np.testing.assert_array_equal(actions[1], action)
        taken.add(tuple(action.tolist()))
        observations, observation = batch.step(actions)[0], single.step(action)[0]
    assert len(taken) == 1 if name == "RIGHT_LEFT" else len(taken) > 1
    with pytest.raises(AttributeError, match="has no attribute 'RIGHT_DOWN'"):
        rules.RIGHT_DOWN  # noqa: B018


def put_interpreters(folder: Path, environments: set[str], status: int = 0) -> None:
    """In the place of the libraries': each prints a version, or the last line of a script."""
    line = "x: -2 -> 491 bits, 8960 steps in 3 s"
    for environment in environments:
        python = folder / ".venvs" / environment / "bin" / "python"
        python.parent.mkdir(parents=True, exist_ok=True)
        python.write_text(f'#!/bin/sh\nif [ "$1" = -c ]; then echo 9.8.7; else echo "{line}"; exit {status}; fi\n')
        python.chmod(0o755)


def test_the_page_of_clients_has_a_row_for_each_and_says_its_behaviour(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(clients, "ROOT", tmp_path)
    page = tmp_path / "page.md"
    page.write_text("<!-- generated: clients -->\n<!-- end: clients -->\n")
    put_interpreters(tmp_path, {"sb3"})
    clients.main()
    of_sb3 = [one for one in clients.CLIENTS if one.environment == "sb3"]
    assert capsys.readouterr().out.count("| 8 960 | -2 → 491 | 3 |") == len(of_sb3)
    with pytest.raises(ValueError, match="not installed: cleanrl, rllib, torchrl; make client-figures installs them"):
        clients.main(page)
    put_interpreters(tmp_path, {one.environment for one in clients.CLIENTS})
    clients.main(page)
    assert page.read_text().count("| 8 960 | -2 → 491 | 3 |") == len(clients.CLIENTS)
    assert "BEHAVIOUR" in page.read_text()
    put_interpreters(tmp_path, {"sb3"}, status=1)
    with pytest.raises(ValueError, match=r"sb3.py ended with 1: x: -2 -> 491 bits"):
        clients.main()
