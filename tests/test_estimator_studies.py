"""The studies of the estimators, small, and their laws."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from activeslam_gym.config import TRAINING_SEED
from activeslam_gym.evaluation import Episode
from activeslam_gym.metrics import write_tum
from agents.task import Task, play_tasks
from benchmarks.studies import bound, estimators, ranking, trajectories
from benchmarks.studies.bound import Bound


def test_the_bound_is_below_the_error_and_near_the_filters_deviation() -> None:
    settings = json.dumps({"scenario": {"association": "known"}, "duration": 5.0})
    seeds = range(TRAINING_SEED, TRAINING_SEED + 4)
    runs = [Episode.of(one) for one in play_tasks([Task("sweep", seed, settings, measures=(Bound,)) for seed in seeds])]
    for run in runs:
        bound = run.notes["bound"]
        assert bound.shape == (len(run.times), 2) and (bound > 0.0).all()
        told = np.sqrt((run.position_std**2).sum(axis=1))
        assert bound[0, 0] == pytest.approx(told[0])
        assert 0.4 < bound[-1, 0] / told[-1] < 1.2
        assert run.notes["chance"] == 0.0  # nothing is out of view for long
    assert np.mean([run.notes["bound"][-1, 0] ** 2 for run in runs]) < 2.0 * np.mean(
        [run.position_error[-1] ** 2 for run in runs]
    )


def test_the_chance_of_a_loss_is_that_of_errors_with_the_bounds_deviation(monkeypatch) -> None:
    settings, chances = json.dumps({"scenario": {"association": "known"}, "duration": 3.0}), []
    for limit in (0.01, 0.05, 0.2):
        monkeypatch.setattr(bound, "LOST_POSITION_ERROR", limit)
        (run,) = map(Episode.of, play_tasks([Task("sweep", TRAINING_SEED, settings, measures=(Bound,))]))
        chances.append(float(run.notes["chance"]))
    assert 0.03 < run.notes["bound"][1:, 0].max() < 0.05  # the limits are a quarter, about one and four to six of it
    assert chances[0] > 0.95 and 0.2 < chances[1] < 0.95 and chances[2] < 0.02


def test_tau_counts_the_resolved_pairs_that_another_estimator_turns_round() -> None:
    rng = np.random.default_rng(0)
    base = {name: score + rng.normal(0.0, 1.0, 30) for name, score in (("a", 9.0), ("b", 5.0), ("c", 5.0), ("d", 0.0))}
    base["twin"] = base["a"].copy()
    pairs = ranking.resolved(base)
    assert ("a", "b") in pairs and ("c", "d") in pairs and not {("a", "twin"), ("twin", "a")} & set(pairs)
    assert ranking.tau(base, pairs)[0] == 1.0
    assert ranking.tau({name: -score for name, score in base.items()}, pairs)[0] == -1.0
    turned = base | {"b": base["a"] + 1.0}
    row, listed, worth = ranking.compared("paper", "x", base, turned)
    assert [one[2] for one in listed] == ["`a` over `b`", "`twin` over `b`"] and row[3].startswith("2 of ")
    assert worth[4].startswith("`b`")
    twins = {"a": base["a"], "b": base["a"]}
    assert ranking.compared("paper", "x", twins, twins)[0][2:4] == ["–", "0 of 0"]


def test_the_commands_print_their_tables(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    given = ["--policies", "stay", "orbit", "--rooms", "6", "--out", str(tmp_path), "--scenarios", "office"]
    ranking.main([*given, "--estimators", "ekf-plain"])
    assert "| office | `ekf-plain` |" in capsys.readouterr().out
    estimators.main([*given, "--estimators", "ekf", "ekf-fej"])
    told = capsys.readouterr().out
    assert told.count("| `orbit` | `ekf-fej` |") == 1 and "nan" not in told


def test_a_recorded_motion_is_flown(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    times = np.arange(60) / 30.0
    positions = np.stack((0.3 * np.sin(times), np.full(60, 1.2), 0.1 * times), axis=1)
    looks = Rotation.from_rotvec(np.outer(0.2 * times, (0, 1, 0))) * Rotation.from_matrix(np.diag((-1.0, -1.0, 1.0)))
    write_tum(tmp_path / "path.tum", times, positions, np.roll(looks.as_quat(), 1, axis=1))
    trajectories.main([str(tmp_path / "path.tum"), "--rooms", "2", "--estimators", "ekf"])
    rows = [line for line in capsys.readouterr().out.splitlines() if "`ekf`" in line]
    assert len(rows) == 2 and all("0 of 2" in row for row in rows)
