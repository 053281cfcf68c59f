"""The evaluator and its store: a batch plays what single episodes play, and a key holds all that a result rests on."""

import json
import subprocess
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from activeslam_gym.config import SCENARIOS
from activeslam_gym.evaluation import Episode, Store, code, row_of, run_episode
from agents.task import Task, make_environment, play_tasks, run_policy
from tests.support import assert_same_record

SHORT = json.dumps({"gaze_period": 0.5, "duration": 3.0})


class Counted:
    """A measure: how often it was asked to look."""

    def __init__(self) -> None:
        self.looks = 0

    def __call__(self, core: Any, info: dict[str, Any]) -> None:
        self.looks += 1

    def result(self, episode: Episode) -> dict[str, Any]:
        return {"looks": self.looks}


NUMPY = {"estimator": "examples.extend_estimator:NumpyEkf", "association": "known"}
BATCHES: dict[str, tuple[str, Any]] = {
    **{name: (name, "paper") for name in ("mi-mi", "random", "ppo")},
    "ekf-plain": ("sweep", {"estimator": "ekf-plain"}),
    "corners": ("sweep", asdict(replace(SCENARIOS["gallery-pixels"], sensor="corners"))),
    "a foreign sensor": ("mi-mi", {**NUMPY, "sensor": "examples.extend_range_sensor:RangeSensor"}),
}
"""Policy and scenario."""


@pytest.mark.parametrize("case", BATCHES)
def test_a_batch_plays_the_episodes_of_single_environments(case: str) -> None:
    policy, scenario = BATCHES[case]
    if policy == "ppo":
        pytest.importorskip("torch")
    settings = json.dumps(json.loads(SHORT) | {"scenario": scenario})
    group = tuple(Task(policy, seed, settings, measures=(Counted,)) for seed in (3, 8))
    together, alone = play_tasks(group), [play_tasks([one])[0] for one in group]
    for one, other in zip(together, alone, strict=True):
        assert_same_record(one, other)
    assert together[0]["notes.looks"] == 7
    assert len(together[0]["times"]) == 4  # kept: one a second


def test_actions_may_be_tensors() -> None:
    torch = pytest.importorskip("torch")
    env = make_environment({"duration": 1.0})
    assert run_episode(env, lambda env: torch.tensor([2, 1]), 0).actions.tolist() == [[2, 1]] * 4


def test_a_record_has_the_size_of_the_room_that_the_episode_drew() -> None:
    env = make_environment({"scenario": "mixed", "duration": 1.0})
    episodes = [run_episode(env, lambda env: env.action_space.sample(), seed) for seed in range(3)]
    for episode in episodes:
        assert (np.abs(episode.true_landmarks) <= 0.5 * episode.room_size + 1e-9).all()
    assert len({tuple(episode.room_size) for episode in episodes}) == 3


def test_samples_of_a_period_are_the_nearest_of_all_and_the_last() -> None:
    settings = {"scenario": "hand-held", "gaze_period": 0.4, "duration": 4.4, "motion_period": 1.2}
    every, sparse = (
        run_policy("stay", make_environment(settings), [5], sample_period=period)[0] for period in (0.0, 1.0)
    )
    np.testing.assert_allclose(sparse.times, [0.0, 0.8, 2.0, 2.8, 4.0, 4.4])
    assert row_of(sparse) | {"decision_us": 0} == row_of(every) | {"decision_us": 0}
    kept = np.isin(every.times, sparse.times)
    for name in ("entropy", "log_score", "landmark_nees", "rotation_offset"):
        np.testing.assert_array_equal(getattr(sparse, name), getattr(every, name)[kept])


def test_a_key_holds_everything_that_could_change_the_result(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store, base = Store(tmp_path), Task("stay", 1, SHORT)
    store.save(base.label, base.key, {"a": np.ones(1)})

    def is_kept(task: Task) -> bool:
        return store.load(task.label, task.key) is not None

    assert is_kept(base)
    same = {"scenario": "paper", "motion_period": 1.0, "lost_position_error": 0.5, **json.loads(SHORT)}
    assert is_kept(Task("stay", 1, json.dumps(same))), "the same environment in other words"
    for other in ({"scenario": {"pixel_std": 4.0}}, {"motion_period": 0.5}, {"duration": 2.0}):
        assert not is_kept(Task("stay", 1, json.dumps(json.loads(SHORT) | other))), other
    assert not is_kept(Task("stay", 1, SHORT, whole=True)) and not is_kept(Task("stay", 1, SHORT, measures=(Counted,)))
    for function in ("package_sources", "package_versions"):
        with monkeypatch.context() as patch:
            patch.setattr(f"activeslam_gym.evaluation.store.{function}", lambda _: "another")
            assert not is_kept(base), function
    assert is_kept(base)


def test_a_page_names_its_commit_and_a_change_since(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A page that the study before has written is no change of code; a clone of something else is not ours."""

    def git(*line: str) -> str:
        command = ["git", "-C", str(tmp_path), "-c", "user.name=a", "-c", "user.email=a@b.c", *line]
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout

    own, page = tmp_path / "activeslam_gym" / "evaluation" / "code.py", tmp_path / "RESULTS.md"
    monkeypatch.setattr(code, "__file__", str(own))
    own.parent.mkdir(parents=True)
    named = code.code.__wrapped__  # without its cache
    git("init")
    git("commit", "--allow-empty", "-m", "something else")
    own.write_text("old")
    page.write_text("old")
    assert named().endswith(" unknown")
    git("add", ".")
    git("commit", "-m", "the code")
    commit = git("rev-parse", "--short", "HEAD").strip()
    page.write_text("new")
    assert named().endswith(f" {commit}")
    own.write_text("new")
    assert named().endswith(f" {commit}-dirty")


@pytest.mark.parametrize("field", ["reward", "motion_criterion", "estimator", "sensor", "scene"])
def test_results_of_a_user_s_own_part_are_not_kept(field: str, tmp_path: Path) -> None:
    """Its code may read a file or use a library that has changed, and a mesh is a file."""
    store, own = Store(tmp_path / "store"), ("activeslam_gym.sensors.points:PointSensor", "ekf-plain")
    foreign = "mine:part", "flat.glb", "<mine.Part object at 0x7f>", 'functools.partial(<function "f">)'
    for part, kept in (*((one, False) for one in foreign), *((one, True) for one in own)):
        key = {field: part} if field == "reward" else {"scenario": {field: part}}
        store.save("one", key, {"a": np.ones(1)})
        assert (store.load("one", key) is not None) == kept


def test_a_damaged_result_is_made_again_and_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    store = Store(tmp_path)
    for _ in range(2):
        assert store.of("a/b", {"k": 1}, lambda: {"x": np.ones(2)})["x"].tolist() == [1.0, 1.0]
    (kept,) = tmp_path.iterdir()
    kept.write_bytes(kept.read_bytes()[:-50])
    assert store.of("a/b", {"k": 1}, lambda: {"x": np.zeros(1)})["x"].tolist() == [0.0]
    assert "Played again" in capsys.readouterr().out


def test_finished_episodes_are_kept_in_batches_of_one_group(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sizes: list[int] = []

    def played(group: tuple[Task, ...]) -> list[Any]:
        if len(sizes) == 2:
            raise KeyboardInterrupt
        sizes.append(len(group))
        return [{"seed": np.array(task.seed)} for task in group]

    jobs = [Task("stay", seed, SHORT) for seed in range(3)] + [Task("orbit", 0, SHORT)]
    with pytest.raises(KeyboardInterrupt):
        list(Store(tmp_path).gather(jobs, played, batch=2))
    assert sizes == [2, 1] and len(list(tmp_path.iterdir())) == 3
    rest = dict(Store(tmp_path).gather(jobs, lambda group: [{"seed": np.array(9)} for _ in group], batch=2))
    assert [int(rest[job]["seed"]) for job in jobs] == [0, 1, 2, 9]
