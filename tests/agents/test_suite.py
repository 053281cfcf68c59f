"""The benchmark: seeds that were unknown before, entries, and their verification."""

import hashlib
import json
import re
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import activeslam_gym
from activeslam_gym.config import SCENARIOS, TRAINING_SEED, benchmark_seed
from agents.__main__ import main
from agents.suite import enter as entries
from agents.suite import leaderboard, manifest
from agents.suite.enter import Entry
from agents.suite.manifest import DRAWN, drawn_seed, draws, suite


def written(folder: Path, **changes: Any) -> Path:
    """The manifest of a suite of two episodes."""
    path = folder / "small.json"
    given = {"behaviour": activeslam_gym.BEHAVIOUR, "scenarios": ["paper"], "protocol": {"end_when_lost": False}}
    given |= {"episodes": 2, "open_loops": ["stay", "sweep"], "training_seeds": 5}
    path.write_text(json.dumps(given | changes))
    return path


def enter(folder: Path, name: str, *policies: str) -> Path:
    """The entry of some policies in a suite of two episodes of 2 s."""
    manifest = str(written(folder, protocol={"end_when_lost": False, "duration": 2.0}))
    given = ["--name", name, "--policies", *policies, "--suite", manifest, "--jobs", "1", "--out", str(folder)]
    assert main(["enter", *given]) == 0
    return folder / name / "entry.json"


def verify(entry: Path) -> int:
    """The status of `verify`."""
    out = str(entry.parent / "verified")
    return main(["verify", str(entry), "--suite", str(entry.parents[1] / "small.json"), "--jobs", "1", "--out", out])


@pytest.fixture(scope="module")
def entered(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The entry of `stay`."""
    return enter(tmp_path_factory.mktemp("entries"), "stay", "stay")


@pytest.fixture
def edited(entered: Path, tmp_path: Path) -> Callable[..., Path]:
    """Makes a copy of the entry, with other values of some fields."""

    def make(**changes: Any) -> Path:
        path = tmp_path / "stay" / "entry.json"
        path.parent.mkdir(exist_ok=True)
        shutil.copy(entered.parents[1] / "small.json", tmp_path)
        path.write_text(json.dumps(json.loads(entered.read_text()) | changes))
        return path

    return make


def test_test_seeds_are_of_the_commit_and_of_no_other_range(tmp_path: Path) -> None:
    seeds = {drawn_seed(commit, name, i) for commit in "ab" for name in ("paper", "office") for i in range(500)}
    assert len(seeds) == 2000  # of each commit, scenario and index another
    assert all(DRAWN[0] <= seed < DRAWN[1] for seed in seeds)
    highest = max(benchmark_seed(name, validation=True) for name in SCENARIOS) + 500_000
    assert highest < DRAWN[0] < DRAWN[1] <= TRAINING_SEED
    assert suite(str(written(tmp_path))).seeds("paper", 2) == [benchmark_seed("paper"), benchmark_seed("paper") + 1]


def test_every_shipped_draw_is_of_a_commit_that_had_the_manifest() -> None:
    for row in draws(manifest.FOLDER):
        name = f"{row['commit']}:./{row['suite']}.json"
        command = ["git", "-C", str(manifest.FOLDER), "show", name]
        then = subprocess.run(command, capture_output=True, check=True).stdout
        assert hashlib.sha256(then).hexdigest()[:16] == row["manifest"], row


def test_a_manifest_of_another_behaviour_or_an_unknown_scenario_is_refused(tmp_path: Path) -> None:
    for changes, message in (({"behaviour": 1}, "of BEHAVIOUR 1"), ({"scenarios": ["moon"]}, "moon")):
        with pytest.raises(ValueError, match=message):
            suite(str(written(tmp_path, **changes)))


def test_a_drawn_manifest_is_final(tmp_path: Path) -> None:
    path = written(tmp_path)
    digest = suite(str(path)).digest
    (tmp_path / "draws.csv").write_text(f"suite,manifest,commit,day,reason\nsmall,{digest},abc,2026-01-01,first\n")
    assert suite(str(path)).seeds("paper", 2) == [drawn_seed("abc", "paper", 0), drawn_seed("abc", "paper", 1)]
    written(tmp_path, episodes=3)
    with pytest.raises(ValueError, match="changed since its draw"):
        suite(str(path))


def test_an_entry_is_verified(entered: Path, capsys: pytest.CaptureFixture[str]) -> None:
    entry = entries.read(entered)
    assert (entry.policies, entry.episodes, entry.training) == (("stay",), 2, ())
    assert not np.array(entry.lost["paper"]).any() and np.isfinite(entry.gains("paper")).all()
    assert verify(entered) == 0
    assert "2 of 2 episodes replayed, 0 with other scores: the entry holds." in capsys.readouterr().out


def test_a_finished_entry_is_played_again_for_another_behaviour_alone(tmp_path: Path, capsys: Any) -> None:
    entry = enter(tmp_path, "stay", "stay")
    given = json.loads(entry.read_text())
    entry.write_text(json.dumps(given | {"machine": "elsewhere"}))
    enter(tmp_path, "stay", "stay")
    said = capsys.readouterr().out  # that a baseline's code is not compared was not said
    assert "of this BEHAVIOUR and these policies already" in said and "code is not seen. To play it again," in said
    assert entries.read(entry).machine == "elsewhere"
    for other in ({"behaviour": 1}, {"contents": ["0"]}, {"scores": "none"}):
        entry.write_text(json.dumps(given | {"machine": "elsewhere"} | other))
        enter(tmp_path, "stay", "stay")
        assert entries.read(entry) == replace(entries.read(entry), **{key: given[key] for key in ("scores", "lost")})
        assert entries.read(entry).machine == given["machine"] and "Written to" in capsys.readouterr().out


def test_a_learners_training_seeds_are_verified_with_their_weights(tmp_path: Path, capsys: Any) -> None:
    entry = enter(tmp_path, "both", "ppo", "ppo-entropy")
    read = entries.read(entry)
    assert read.policies == ("policy-0.npz", "policy-1.npz") and read.contents[0] != read.contents[1]
    assert [one["scenario"] for one in read.training] == ["paper", "paper"]
    moved = tmp_path / "elsewhere" / "both"
    shutil.copytree(entry.parent, moved)
    shutil.copy(tmp_path / "small.json", moved.parent)
    assert verify(moved / "entry.json") == 0
    assert "4 of 4 episodes replayed" in capsys.readouterr().out
    shutil.copy(moved / "policy-1.npz", moved / "policy-0.npz")
    assert verify(moved / "entry.json") == 2
    assert "but of other weights" in capsys.readouterr().err
    shutil.copy(moved / "policy-1.json", moved / "policy-0.json")
    assert verify(moved / "entry.json") == 1
    assert "contents: (" in capsys.readouterr().out
    (moved / "policy-1.npz").unlink()
    assert verify(moved / "entry.json") == 2
    assert "weights beside it" in capsys.readouterr().err


def test_edited_scores_and_hashes_are_found(entered: Path, edited: Callable[..., Path], capsys: Any) -> None:
    first, second = entries.read(entered).scores["paper"][0]
    for changes, message in (
        ({"scores": {"paper": [[first, second + 0.01]]}}, "episode 1"),
        ({"lost": {"paper": [[1, 0]]}}, "episode 0"),
        ({"contents": ["0"]}, "contents: ("),
        ({"manifest": "0"}, "nothing was"),
    ):
        assert verify(edited(**changes)) == 1
        assert message in capsys.readouterr().out


@pytest.mark.parametrize(("field", "value"), [
    ("name", "a|b"), ("scores", {"paper": [[1.0, float("nan")]]}), ("scores", {"paper": [["1", 2.0]]}), ("scores", [1]),
    ("machine", 7), ("versions", []), ("versions", {"numba": 1}), ("note", 3), ("behaviour", "24"), ("policies", [3]),
    ("policies", "stay"), ("training", [3]), ("contents", None),
])  # fmt: skip
def test_a_damaged_entrys_file_is_named(field: str, value: Any, edited: Callable[..., Path], capsys: Any) -> None:
    entry = edited(**{field: value})
    of = ["--suite", str(entry.parents[1] / "small.json"), "--entries", str(entry.parents[1])]
    assert verify(entry) == main(["leaderboard", *of]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 2 and said.count(str(entry)) >= 2 and said.count(field) >= 2, said


FOREIGN = """
import sys
class Still:
    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return (0, 1), state
def policy(env): return Still()
"""


def test_verify_has_a_verdict_whatever_the_entrants_code_does(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """`sys.exit(0)` and `os._exit(0)` ended it without a word."""
    folder = tmp_path / "mine"
    folder.mkdir()
    module = folder / "entrants_code.py"
    module.write_text(FOREIGN)
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.chdir(tmp_path)
    entry = enter(tmp_path, "mine", "entrants_code:policy")
    for more in ("sys.exit(0)", "import os; os._exit(0)"):
        module.write_text(f"{FOREIGN}{more}\n")
        assert verify(entry) == 2
        assert "entrants_code:policy" in capsys.readouterr().err


def of_scores(name: str, scores: Any, **changes: Any) -> Entry:
    """An entry in two scenarios, with the same scores (P, E) in both."""
    scores = np.asarray(scores, dtype=float)
    names = tuple(f"{name}-{i}.npz" for i in range(len(scores))) if len(scores) > 1 else (name,)
    training = tuple({"seconds_trained": 120.0} for _ in names) if len(scores) > 1 else ()
    of = suite("development")
    values: dict[str, Any] = dict.fromkeys(("contents", "versions"), ()) | {"machine": "", "note": ""}
    values |= {"suite": of.name, "manifest": of.digest, "commit": "", "behaviour": of.behaviour}
    values |= {"scores": {one: scores.tolist() for one in of.scenarios}}
    values |= {"lost": {one: np.zeros(scores.shape, int).tolist() for one in of.scenarios}}
    return Entry(**(values | {"name": name, "policies": names, "training": training} | changes))


def test_the_board_of_made_up_scores(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(leaderboard, "RESAMPLES", 60)
    episodes = np.arange(20.0)
    loops = [of_scores("stay", [50.0 + 0.0 * episodes]), of_scores("sweep", [100.0 + 0.0 * episodes])]
    learned = of_scores("mine", [150.0 + episodes - 9.5 + run for run in (-1.0, 0.0, 1.0)], note="as it is")
    wrong = of_scores("sure", [np.where(episodes < 5, -1e6, 400.0)])  # it fails in a quarter of its episodes
    of = suite("development")
    results = leaderboard.compared(of, [*loops, learned, wrong])
    whole, each = leaderboard.tables(of, results)
    rows = {row[0]: row[1:] for row in whole.rows}
    assert [row[0] for row in whole.rows] == ["sure", "mine", "sweep", "stay"]
    assert {row[1] for row in each.rows} == {"sweep"} and {row[3] for row in each.rows} == {"sure"}
    assert rows["sweep"][1] == "1.00 [1.00, 1.00]"  # ties are halves
    assert rows["mine"][0] == "0.0 [0.0, 2.3]"  # none of 160 failed, whatever the number of training seeds
    first = [one.scenarios[of.scenarios[0]] for one in results]
    assert [one.failures for one in first] == [0.25, 0.0, 0.0, 0.0]
    assert [first[k].lead.value for k in (2, 3)] == [0.0, -50.0]
    kept = leaderboard.rows_of(results)
    assert len(kept) == 4 * len(of.scenarios)
    assert (kept[0]["entry"], kept[0]["log_score"], kept[0]["failures"]) == ("sure", 400.0, 0.25)
    leaderboard.draw(of, results, tmp_path / "board.png")
    assert (tmp_path / "board.png").read_bytes().startswith(b"\x89PNG")


def test_the_stated_budget_is_that_of_the_training_and_not_of_a_command() -> None:
    """`total_steps` of the command that wrote the best weights stood there, after a longer or an interrupted one."""
    cards = [{"total_steps": 400, "steps_trained": 800}, {"total_steps": 900, "steps_trained": 40}]
    learned = of_scores("mine", [[1.0], [2.0]], training=tuple(cards))
    assert leaderboard._training(learned, suite("development")) == "2 seeds (few), 800 decisions"
    killed = replace(learned, training=({"total_steps": 400}, cards[1]))
    assert leaderboard._training(killed, suite("development")) == "2 seeds (few)"


def test_entries_that_cannot_be_compared_are_refused() -> None:
    loop = of_scores("stay", [[50.0, 60.0]])
    for others, message in (
        ([of_scores("mine", [[1.0, 2.0]])], "none of an open loop"),
        ([loop, of_scores("mine", [[1.0]])], "the same of all"),
        ([loop, of_scores("mine", [[1.0, 2.0]], manifest="0")], "another manifest"),
    ):
        with pytest.raises(ValueError, match=message):
            leaderboard.compared(suite("development"), others)


def test_the_leaderboard_is_made_from_a_folder(entered: Path, tmp_path: Path, capsys: Any) -> None:
    page = tmp_path / "page.md"
    page.write_text("<!-- generated: leaderboard -->\n<!-- end: leaderboard -->\n")
    shutil.copytree(entered.parents[1], tmp_path / "of")
    name, copy = str(tmp_path / "of" / "small.json"), tmp_path / "of" / "stay" / "entry.json"
    copy.write_text(json.dumps(json.loads(copy.read_text()) | {"scores": {"paper": [[10.0, 20.0]]}}))
    (tmp_path / "of" / "older").mkdir()
    older = json.loads(copy.read_text()) | {"name": "older", "suite": "v2"}
    (tmp_path / "of" / "older" / "entry.json").write_text(json.dumps(older))
    arguments = ["--suite", name, "--entries", str(tmp_path / "of"), "--report", str(page)]
    assert main(["leaderboard", *arguments]) == 0
    assert "Left out: older, which is of the suite v2." in capsys.readouterr().out
    assert "| stay | 0.0 [" in page.read_text()
    assert main(["leaderboard", *arguments, "--episodes", "1"]) == 0 and "1 episodes each" in page.read_text()
    assert re.search(r"\| stay \| 10 ", page.read_text())  # of 10 and 20 the first
    assert f"BEHAVIOUR {activeslam_gym.BEHAVIOUR}, commit " in page.read_text()
