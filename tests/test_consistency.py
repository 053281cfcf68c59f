"""The consistency report: its statistics on made-up runs, the witness on a made-up belief, and the command, small."""

import csv
import json
from pathlib import Path
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest

import baselines
from activeslam_gym.config import DEPTH_PARTICLES, INVERSE_DEPTH
from activeslam_gym.evaluation import run_episode
from activeslam_gym.slam.belief import POINT, RAY
from activeslam_gym.slam.map import convert_to_point
from agents.__main__ import main
from agents.consistency.calibration import Bar, Checked, chi2_bounds, lost_bar, nees_bar
from agents.consistency.witness import Witness, depth_error
from agents.tools.statistics import estimate
from tests.support import joint_covariance, random_belief, scenario_for

DURATION = 4.0


def test_bars_are_those_of_the_issue_and_chi2_bounds_hold_as_often_as_they_say() -> None:
    assert nees_bar("mi-mi", 15.0) == nees_bar("mi-fisher", 35.0) == Bar(0.8, 1.5)
    assert nees_bar("sweep", 5.0) == Bar(high=2.5)
    assert nees_bar("random", 5.0) is None and nees_bar("mi-mi", 25.0) is None
    assert lost_bar("mi-mi", "paper").high == 0.01
    assert (lost_bar("sweep", "paper").high, lost_bar("sweep", "clutter").high) == (0.02, 0.05)
    for figures, met in (([1.0, 1.2], True), ([0.5, 0.5], False), ([np.nan], None)):
        assert Checked(estimate(figures, "mean"), Bar(0.8, 1.5)).met is met
    assert "NOT MET" in Checked(estimate([0.5], "mean"), Bar(0.8, 1.5)).text()
    errors = np.random.default_rng(0).normal(size=(400, 40, 3))
    averages = (errors**2).sum(axis=2).mean(axis=1) / 3.0
    low, high = chi2_bounds(averages[:40])
    assert low < 1.0 < high
    assert np.mean((low < averages) & (averages < high)) == pytest.approx(0.95, abs=0.03)
    assert np.isnan(chi2_bounds(np.full(3, np.nan))).all()


@pytest.mark.parametrize("kind", [RAY, POINT])
def test_depth_error_is_a_standard_normal_along_the_sight(kind: int) -> None:
    """Truths drawn from the belief give errors of mean 0 and deviation 1."""
    rng = np.random.default_rng(3)
    belief = random_belief(scenario_for([RAY]), [kind], rng, point_std=0.2)
    p_hat, rows, errors = belief.state.camera[:3], np.r_[0:3, 12:15], []
    if kind == RAY:
        convert_to_point(belief, 0)
    y_hat, P = belief.feature[0].mean[:3], joint_covariance(belief)
    estimate = SimpleNamespace(position=p_hat, landmarks=y_hat[None], covariance=P)
    for draw in rng.multivariate_normal(np.zeros(6), P[np.ix_(rows, rows)], size=2000):
        truth = SimpleNamespace(position=p_hat + draw[:3], landmarks=[None, y_hat + draw[3:]])
        errors.append(depth_error(estimate, truth, 0, 1, p_hat + 0.1))
    assert np.mean(errors) == pytest.approx(0.0, abs=0.07)
    assert np.std(errors) == pytest.approx(1.0, abs=0.05)
    assert np.isnan(depth_error(estimate, truth, 0, -1, p_hat + 0.1))


def test_the_witness_knows_a_duplicate_and_wants_steps_of_a_frame() -> None:
    witness = Witness()
    witness._note_owners(owners=np.array([7, -1, 7]), ids=np.array([1, 2, 5]))
    assert (witness._owned, witness._duplicates) == ({1, 5}, {5})
    env = gym.make("ActiveSLAM-v0", gaze_period=0.1)
    with pytest.raises(ValueError, match="gaze_period"):
        run_episode(env, baselines.make("stay", env), seed=3, looks=[Witness().look])


@pytest.mark.parametrize("initialisation", [INVERSE_DEPTH, DEPTH_PARTICLES])
def test_witness_sees_every_conversion(initialisation: str) -> None:
    scenario = {"initialisation": initialisation}
    env = gym.make("ActiveSLAM-v0", scenario=scenario, gaze_period=0.05, duration=DURATION)
    witness = Witness()
    episode = run_episode(env, baselines.make("mi-mi", env), seed=3, looks=[witness.look])
    said = witness.result(episode)
    assert not episode.lost
    assert 0 < len(said["depth_errors"]) <= said["conversions"] == len(witness._depth_errors)
    assert 0 <= said["duplicates"] <= said["features"] and said["features"] >= len(said["depth_errors"])
    assert said["wrong_matches"] <= said["matches"]


def test_report_on_two_rooms(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    line = ["consistency", "--policies", "mi-mi", "sweep", "--episodes", "2", "--duration", f"{DURATION}"]
    assert main([*line, "--jobs", "1", "--out", str(tmp_path / "out"), "--store", str(tmp_path / "store")]) == 0
    printed = capsys.readouterr().out
    assert "bars met" in printed and "fewer than 20" in printed
    out = tmp_path / "out"
    assert {path.name for path in out.iterdir()} == {"report.md", "report.json", "runs.csv", "nees.png"}
    assert len(list((tmp_path / "store").iterdir())) == 8
    rows = list(csv.DictReader((out / "runs.csv").open()))
    assert len(rows) == 8 and {row["seed"] for row in rows} == {"2000000", "2000001"}
    results = json.loads((out / "report.json").read_text())["results"]
    assert [one["strategy"] for one in results] == ["mi-mi", "mi-mi", "sweep", "sweep"]
    assert [one["initialisation"] for one in results] == [INVERSE_DEPTH, DEPTH_PARTICLES] * 2
    names = ("position_nees_4s", "wrong_matches", "matches", "depth_errors", "depth_error_mean")
    nees, wrong, matches, count, mean = np.array([[float(row[name]) for name in names] for row in rows[:2]]).T
    figures = {name: one["figure"] for name, one in results[0]["figures"].items()}
    assert figures["NEES of position at 4 s"]["value"] == pytest.approx(nees.mean())
    assert figures["wrong associations"]["value"] == wrong.sum() / matches.sum()
    assert figures["depth error, mean"]["value"] == pytest.approx(count @ mean / count.sum())
    assert "| mi-mi, inverse_depth |" in (out / "report.md").read_text()
