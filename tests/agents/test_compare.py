"""Statistics and tables of made-up episodes with known figures, then `compare` on the real environment."""

import csv
import json
import os
import subprocess
import sys
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.wrappers import RescaleAction

import baselines
from activeslam_gym import Gaze, Motion
from activeslam_gym.evaluation import Episode, play, row_of, run_episode
from activeslam_gym.files import written_whole
from activeslam_gym.rendering.scene import screen_from_world
from agents import policies
from agents import task as tasks
from agents.__main__ import main
from agents.compare import Args, compare
from agents.suite.enter import _beside
from agents.summary import Aggregate, aggregate, headline, paired_rmse, summarise, tables
from agents.task import Task, check, play_tasks
from agents.tools.files import write_csv, write_json
from tests.support import until

ROOT = Path(__file__).parents[2]
DURATION = 3.0
NAMES = [field.name for field in fields(Episode)]
SAMPLED = NAMES[NAMES.index("times") : NAMES.index("actions")]
"""Fields of an episode with one entry for each time."""
FIGURES = {"scores.png", "entropies.png", "errors.png", "maps.png"}


def episode(policy: str = "stay", seed: int = 0, bits: float = 10.0, **changes: Any) -> Episode:
    """An episode of 2 s in steps of 0.5 s that removes `bits`, with one landmark of three mapped after 1 s."""
    times = np.arange(5) * 0.5
    mapped = np.array([0, 0, 1, 1, 1])
    values: dict[str, Any] = {name: np.ones(5) for name in SAMPLED}
    values |= {name: np.zeros((5, 3)) for name in SAMPLED if name.endswith(("_std", "_position"))}
    values |= {name: np.tile([1.0, 0, 0, 0], (5, 1)) for name in ("true_quaternion", "estimated_quaternion")}
    values |= {"policy": policy, "seed": seed, "settings": "{}", "lost": False}
    values |= {"room_size": np.array([6.0, 2.0, 6.0]), "true_landmarks": np.zeros((3, 3)), "fiducials": np.ones((6, 3))}
    values |= {"times": times, "entropy": 100.0 - bits * times / 2.0, "log_score": -50.0 + bits * times}
    values |= {"landmarks_mapped": mapped, "distinct_landmarks": mapped}
    values |= {"landmark_rmse": np.where(mapped > 0, 0.03, np.inf), "landmark_errors": np.array([0.03, np.nan, np.nan])}
    values |= {"landmark_times": times[2:3], "landmark_log2_det": np.array([-20.0])}
    values |= {"estimated_landmarks": np.full((1, 3), 0.02), "landmark_covariance": np.eye(3)[None] * 1e-4}
    values |= {"actions": np.array([[2, 1]] * 4), "motion_read": np.array([True, False, True, False])}
    values |= {"rewards": np.full(4, bits / 4), "decision_us": np.full(4, 7.0)}
    return Episode(**(values | changes))


def test_outcome_of_a_known_episode() -> None:
    fourteen = {"landmark_times": 0.5 + np.arange(14.0), "landmark_log2_det": -np.arange(14.0)}
    row = row_of(episode(bits=10.0, **fourteen))
    assert (row["bits"], row["log_score_gain"], row["reward"]) == (10.0, 20.0, 10.0)
    for gain, under in ((0.0, [0, 0]), (-1000.0, [1, 0]), (-1001.0, [1, 1])):
        row = row_of(episode(log_score=np.linspace(0.0, gain, 5), **fourteen))
        assert [row["log_score_under_0"], row["log_score_under_minus_1000"]] == under
    assert (row["landmarks_mapped"], row["landmark_rmse"], row["decision_us"]) == (1, 0.03, 7.0)
    assert (row["target_time"], row["target_log2_det"]) == (13.5, -13.0)
    assert (row["motion_right"], row["motion_stay"], row["gaze_left"]) == (2, 0, 4)
    assert np.isnan(row_of(episode())["target_time"])
    assert row_of(episode(lost=True))["bits"] == 0.0


def test_differences_are_within_rooms_against_the_reference_and_the_highest_log_score() -> None:
    runs = [episode("stay", seed, 10.0 * seed) for seed in range(8)]
    runs += [episode("mi-fisher", seed, 10.0 * seed + 1.0) for seed in range(8)]
    runs += [episode("ahead", seed, 10.0 * seed + 1.0 + (seed < 6)) for seed in range(8)]
    summary = summarise(runs)
    difference = summary.paired["mi-fisher"]["stay"]["bits"]
    assert (difference.value, difference.low, difference.high, difference.episodes) == (-1.0, -1.0, -1.0, 8)
    assert summary.paired["mi-fisher"]["stay"]["ahead"].value == 0.0
    assert summary.paired["mi-fisher"]["ahead"]["ahead"].value == 0.875  # the last two rooms are ties
    assert summary.policies["stay"]["bits"].value == 35.0
    assert list(summary.paired) == ["mi-fisher", "ahead"]


def test_a_tie_counts_for_neither_policy() -> None:
    """Two policies of equal scores were both significantly behind."""
    summary = summarise([episode(name, seed, 10.0 * seed) for name in ("stay", "mi-fisher") for seed in range(8)])
    ahead = summary.paired["mi-fisher"]["stay"]["ahead"]
    assert ahead.value == 0.5 and ahead.low < 0.2 and ahead.high > 0.8
    three, half, four = (aggregate([1.0] * 3 + [tie] + [0.0] * 3, "share") for tie in (0.0, 0.5, 1.0))
    assert (half.low, half.value, half.high) == (three.low, 0.5, four.high)


def test_a_figure_of_fewer_episodes_than_the_others_shows_their_number() -> None:
    """The column `episodes` was the count of the first column alone."""
    runs = [episode("stay", seed, landmark_rmse=np.full(5, 0.03 if seed else np.nan)) for seed in range(8)]
    for line in (tables(summarise(runs, "stay"))[1].markdown(), headline(summarise(runs, "stay"))):
        (row,) = [row for row in line.splitlines() if row.startswith("| stay")]
        assert "3.0 [3.0, 3.0] (7) |" in row and row.endswith("| 8 |") and row.count("(") == 1


def test_an_interrupted_write_leaves_the_old_file_and_json_has_nulls(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    write_csv(path, [{"a": 1, "b": np.nan}])
    with pytest.raises(KeyboardInterrupt), written_whole(path) as unfinished:
        unfinished.write_text("half")
        raise KeyboardInterrupt
    assert path.read_text().splitlines() == ["a,b", "1,"]
    assert list(tmp_path.iterdir()) == [path]
    write_json(path, {"a": [1.0, np.nan], "b": {"c": -np.inf}})
    assert json.loads(path.read_text()) == {"a": [1.0, None], "b": {"c": None}}
    os.symlink(path, tmp_path / "link"), os.mkfifo(tmp_path / "pipe")
    write_json(tmp_path / "link", 2)
    assert path.read_text().strip() == "2"
    with pytest.raises(OSError, match="no regular file"):
        write_json(tmp_path / "pipe", 3)


def test_record_of_an_episode_holds_what_its_environment_tells() -> None:
    env = gym.make("ActiveSLAM-v0", duration=DURATION)
    run = run_episode(env, baselines.make("mi-fisher", env), seed=7, name="mi-fisher")
    samples, steps = len(run.times), len(run.actions)
    assert samples == steps + 1 == round(DURATION / 0.25) + 1
    assert run.times[-1] == pytest.approx(DURATION)
    assert all(len(getattr(run, name)) == samples for name in SAMPLED)
    assert run.motion_read.sum() == DURATION
    assert run.rewards.sum() == pytest.approx(run.entropy[0] - run.entropy[-1], abs=1e-6)
    np.testing.assert_allclose(np.linalg.norm(run.position_offset, axis=1), run.position_error, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(run.rotation_offset, axis=1), run.orientation_error, atol=1e-6)
    assert len(run.landmark_times) == run.landmarks_mapped.max()
    assert np.isfinite(run.landmark_errors).sum() == run.distinct_landmarks[-1]
    env = gym.make("ActiveSLAMDiscrete-v0", duration=1.0)
    assert run_episode(env, lambda env: np.array([7]), 0).actions.tolist() == [[2, 1]] * 4
    with pytest.raises(ValueError, match="observers: 2 lists"):
        play(env, lambda env: 7, [0], observers=[[], []])


def test_compare_writes_everything_and_resumes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    args = Args(policies=("stay", "mi-fisher"), episodes=2, duration=DURATION, out=tmp_path, jobs=1)
    summary = compare(args)
    assert summary is not None and summary.settings["complete"]
    assert {path.name for path in tmp_path.glob("*.png")} == FIGURES
    rows = list(csv.DictReader((tmp_path / "episodes.csv").open()))
    ran = [(row["policy"], int(row["seed"]) - args.seed) for row in rows]
    assert ran == [("stay", 0), ("stay", 1), ("mi-fisher", 0), ("mi-fisher", 1)]
    bits = np.mean([float(row["bits"]) for row in rows if row["policy"] == "stay"])
    written = json.loads((tmp_path / "summary.json").read_text())
    assert written["policies"]["stay"]["bits"]["value"] == pytest.approx(bits)
    assert (tmp_path / "summary.md").read_text().startswith("## Comparison")

    monkeypatch.setattr(tasks, "play_tasks", lambda _: pytest.fail("an episode was run again"))
    assert compare(replace(args, resume=True, figures=False)) == summary
    assert not list(tmp_path.glob("*.png"))  # those of an earlier comparison stayed beside other tables
    monkeypatch.setattr("activeslam_gym.evaluation.store.package_sources", lambda package: "another filter")
    with pytest.raises(pytest.fail.Exception, match="run again"):
        compare(replace(args, resume=True))


OWN = """
import os, sys
class Ends:
    def __init__(self, end):
        self.end = end
    def predict(self, *arguments, **named):
        self.end(0)
class Fails:
    steps = 0
    def predict(self, observation, state=None, *arguments, **named):
        self.steps += 1
        if self.steps > 2:
            raise RuntimeError("in the middle")
        return (0, 1), state
def fails(env): return Fails()
def leaves(env): return Ends(sys.exit)
def ends(env): return Ends(os._exit)
"""


def test_a_scenario_in_which_a_policy_fails_keeps_no_other_from_being_played(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "own_failing.py").write_text(OWN)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.chdir(tmp_path)
    line = "compare --policies stay own_failing:fails --scenario paper office --episodes 1 --duration 1 --jobs 1"
    assert main([*line.split(), "--reference", "stay", "--no-figures", "--out", "out"]) == 2
    for scenario in ("paper", "office"):
        rows = list(csv.DictReader((tmp_path / "out" / scenario / "episodes.csv").open()))
        assert [row["policy"] for row in rows] == ["stay"]
    said = capsys.readouterr().err
    assert "paper: " in said and "office: " in said and said.count("RuntimeError: in the middle") == 2


@pytest.mark.parametrize("how", ["leaves", "ends"])
def test_a_policy_that_ends_the_process_is_a_failure_with_its_name(
    how: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "own_policies.py").write_text(OWN)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.chdir(tmp_path)
    line = f"compare --policies own_policies:{how} --episodes 1 --duration 1 --jobs 1 --no-figures --out out".split()
    assert main(line) == 2
    assert f"own_policies:{how}" in capsys.readouterr().err


def test_a_model_of_stable_baselines_is_a_policy(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    sb3 = pytest.importorskip("stable_baselines3")
    path = tmp_path / "model.zip"
    for id, kind, seed in (("", "PPO", 0), ("Continuous", "SAC", 0), ("Discrete", "DQN", 0), ("Discrete", "DQN", 1)):
        env = gym.make(f"ActiveSLAM{id}-v0")
        model = getattr(sb3, kind)("MlpPolicy", env, seed=seed, **({} if kind == "PPO" else {"buffer_size": 10}))
        model.save(path)
        (played,) = play_tasks([Task(str(path), 3, json.dumps({"duration": 1.0}))])
        env = gym.make(f"ActiveSLAM{id}-v0", duration=1.0, end_when_lost=False)
        expected = run_episode(env, model, seed=3, name=str(path))
        np.testing.assert_array_equal(played["actions"], expected.actions)
        assert played["actions"].shape == (4, 2) and (played["actions"] < (len(Motion), len(Gaze))).all()
        alone, observation = policies.load(path, env), env.reset(seed=3)[0]
        np.testing.assert_array_equal(alone.predict(observation)[0], model.predict(observation, deterministic=True)[0])
        contents = policies.content(str(path))
    sb3.DQN("MlpPolicy", env, seed=9, buffer_size=10).save(path)
    assert policies.content(str(path)) != contents

    sb3.PPO("MlpPolicy", gym.make("ActiveSLAM-v0"), seed=3, policy_kwargs={"net_arch": [8]}).save(path)
    path.with_suffix(".json").write_text('{"decision_period": 0.5}')
    (copy,) = _beside([str(path)], tmp_path)  # as an entry has it
    slow, fast = (json.dumps({"duration": 3.0, "gaze_period": period}) for period in (0.5, 0.25))
    check([Task(copy, 4, fast)])
    assert "policy-0.zip decides every 0.5 s" in capsys.readouterr().out
    (once,), (_, held) = play_tasks([Task(copy, 4, slow)]), play_tasks([Task(copy, seed, fast) for seed in (3, 4)])
    np.testing.assert_array_equal(np.repeat(once["actions"], 2, axis=0), held["actions"])
    sb3.PPO("MlpPolicy", RescaleAction(gym.make("ActiveSLAMContinuous-v0"), *np.float32([-2.0, 2.0]))).save(path)
    with pytest.raises(ValueError, match="acts in Box"):
        play_tasks([Task(str(path), 3, slow)])
    path.write_bytes(path.read_bytes()[:-300])
    with pytest.raises(ValueError, match="model.zip"):
        policies.actions_of(str(path))


def gone(process: int) -> bool:
    """Whether a process is no more, or waits to be buried."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except OSError:
        return True


SLEEPY = """
import os, pathlib, sys, time
from activeslam_gym.evaluation.store import run_all
def sleep(paths):
    pathlib.Path(paths[0]).write_text(f"{os.getpid()} ")
    time.sleep(300)
if __name__ == "__main__":
    list(run_all(sleep, [(path,) for path in sys.argv[1:]], 2, 0))
"""


@pytest.mark.parametrize("name", ["/mine/policy.npz", "../policy.zip", "rllib:/mine"])
def test_weights_that_cannot_be_sent_to_a_cluster_are_refused(name: str) -> None:
    with pytest.raises(ValueError, match="below the working folder"):
        policies.files(["sweep", name])


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks into /proc")
def test_workers_end_with_a_killed_parent(tmp_path: Path) -> None:
    script, files = tmp_path / "sleepy.py", [tmp_path / name for name in "ab"]
    script.write_text(SLEEPY)
    env = os.environ | {"PYTHONPATH": str(ROOT)}
    parent = subprocess.Popen([sys.executable, str(script), *map(str, files)], env=env, stderr=subprocess.PIPE)
    until(lambda: all(file.exists() and file.read_text().endswith(" ") for file in files))
    parent.kill()
    parent.communicate()
    until(lambda: all(gone(int(file.read_text())) for file in files))


def test_the_bootstrap_of_an_interquartile_mean_holds_the_true_one_though_one_in_a_hundred_is_at_minus_6000() -> None:
    """That of a mean held it in two fifths of such samples of 50 episodes."""
    rng = np.random.default_rng(50)
    samples = np.where(rng.random((100, 50)) < 0.01, -6000.0, rng.normal(600.0, 60.0, (100, 50)))
    intervals = [aggregate(sample, "IQM") for sample in samples]
    assert np.mean([one.low <= 600.0 <= one.high for one in intervals]) > 0.87
    assert np.isnan(aggregate(samples[0], "mean").low)


def test_a_map_from_above_is_no_mirror_image() -> None:
    """A motion to the camera's left was drawn to its right."""
    pytest.importorskip("matplotlib")
    from agents.figures import maps

    axes = maps({"stay": [episode()]}).axes[0]
    for way in ((0.5, 0.0, 0.0), (0.0, 0.0, 0.5)):
        drawn = np.diff(axes.transData.transform([(0.0, 0.0), way[::2]]), axis=0)[0]
        assert np.argmax(np.abs(drawn)) == (way[2] > 0) and drawn @ screen_from_world(np.array(way)) > 0.0


def test_figures_of_equal_missing_infinite_and_zero_values() -> None:
    for statistic in ("median", "IQM"):
        assert aggregate([2.0] * 6, statistic) == Aggregate(2.0, 2.0, 2.0, 6, statistic)  # of no width
    assert aggregate([1.0, np.nan, 3.0], "mean").episodes == 2
    infinite = aggregate([1.0, 2.0, 3.0, 4.0, np.inf, np.inf], "median")
    assert (infinite.value, infinite.low, infinite.high) == (3.5, 1.0, np.inf)
    none = aggregate(np.zeros(20), "share")
    assert none.value == none.low == 0.0 and 0.1 < none.high < 0.2
    assert paired_rmse([1.0, 3.0, np.nan], [2.0, np.nan, 5.0]) == (1.0, 2.0)  # of the landmarks that both mapped
    assert np.isnan(paired_rmse([1.0, np.nan], [np.nan, 2.0])).all()
