"""`python -m agents live`: its tables agree with its runs, which an evaluator compares with the ground truth."""

from dataclasses import replace
from inspect import signature
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

pytest.importorskip("cv2", reason="the extra `vision` is not installed")
pytest.importorskip("tyro", reason="the extra `compare` is not installed")

from activeslam_gym import ActiveSLAMEnv, ActiveSLAMVectorEnv, Motion  # noqa: E402
from activeslam_gym.live.person import FOLLOW, HABITS, NEVER, STILL  # noqa: E402
from activeslam_gym.live.session import Session  # noqa: E402
from activeslam_gym.live.source import ROOM, RenderedRoom  # noqa: E402
from activeslam_gym.live.trial import Evaluator, trial  # noqa: E402
from activeslam_gym.metrics import camera_error  # noqa: E402
from activeslam_gym.slam.estimate import taken_estimate
from agents import advising  # noqa: E402
from agents.__main__ import main  # noqa: E402
from agents.tools.arguments import command_line  # noqa: E402


def row(time: int, total: float) -> advising.Row:
    dets = {"log2_det_camera": -100.0, "log2_det_map": total + 100.0, "log2_det_total": total}
    rest = {"landmark_rmse": 0.1, "mapped": 15, "position_error": 0.02, "position_nees": 0.8, "lost": False}
    command = Motion.LEFT if time % 5 == 0 else Motion.FORWARD
    events = {"command": int(command), "births": int(time % 5 == 0), "closures": int(time % 10 == 0)}
    return {"time": float(time), "log_score": -total, **dets, **rest, **events}


def runs(count: int = 6) -> advising.Runs:
    """A follower removes 10 bits a second, a random mover 4, one that stays 1; a loop closes every tenth second."""
    speed = {FOLLOW: -10.0, NEVER: -4.0, STILL: -1.0}
    return {
        habit: {
            seed: [row(t, speed[habit] * t - 50.0 * (t // 10) + 0.1 * seed) for t in range(1, 61)]
            for seed in range(count)
        }
        for habit in HABITS
    }


def test_tables_are_of_the_same_rooms_at_their_time_and_without_shorter_runs() -> None:
    told = advising.differences(runs(), (35.0,))
    assert "| 35 s | follows − random | -210 [-210, -210] | 0.0 [0.0, 0.0] | 210 [210, 210] |" in told
    assert "| 35 s | follows − stays | -315 [-315, -315] | 0.0 [0.0, 0.0] | 315 [315, 315] |" in told
    told = advising.standings(runs(1), (35.0, 60.0))
    assert "| 35 s, 1 rooms | follows | -500 |" in told and "| 60 s, 1 rooms | follows | -900 |" in told
    short = runs(7)
    for rooms in short.values():
        rooms[1] = rooms[1][:35]
    told = advising.standings(short, (35.0, 60.0))
    assert "| 35 s, 7 rooms | follows |" in told and "| 60 s, 6 rooms | follows |" in told
    assert "| 60 s | follows − random | -360 [-360, -360] |" in advising.differences(short, (60.0,))


def test_fewer_rooms_may_be_played_longer() -> None:
    args = advising.Args(rooms=(3, 1), seconds=(35.0, 167.0), seed=10)
    assert args.lasting == {10: 167.0, 11: 35.0, 12: 35.0}
    assert advising.Args(rooms=(2,), seconds=(35.0, 167.0), seed=10).lasting == {10: 167.0, 11: 167.0}
    told = "python -m agents live --rooms 3 1 --seconds 35 60.5 --seed 10"
    assert command_line("live", replace(args, seconds=(35.0, 60.5))) == told
    with pytest.raises(ValueError, match="rooms: 3 numbers; allowed: 1 or 2, as of seconds"):
        replace(args, rooms=(2, 1, 1)).check()


def test_commands_are_told_apart_by_births_and_changes_by_closures() -> None:
    told = advising.commands(runs())
    assert "| after initialisations | 52 [52, 52] |" in told  # 12 of 23: its second, and the one after it
    assert "| otherwise | 0 [0, 0] |" in told
    assert "LEFT 20 %" in told and "FORWARD 80 %" in told
    assert advising.first_minute(runs(2)[FOLLOW]).sum() == 120
    told = advising.closures(runs())
    assert "| everything | -60.0 [-60.0, -60.0] | -10.0 [-10.0, -10.0] | -50.0 [-50.0, -50.0] |" in told


def test_each_claim_has_the_verdict_of_its_interval() -> None:
    told = advising.claims(runs(12), (35.0,))
    assert "follows − random, after 35 s | -210 [-210, -210] | **holds** |" in told
    assert "| position error, cm, follows − stays, after 35 s | 0.0 [0.0, 0.0] | **not shown** |" in told
    assert "% of commands that are lateral, 2 s after initialisations | 52 [52, 52] | **does not hold** |" in told
    assert "(everything) in a second, with a closure − without | -50.0 [-50.0, -50.0] | **holds** |" in told
    assert "**holds**" not in advising.claims(runs(6), (35.0,))  # fewer rooms than a verdict needs


def test_the_evaluator_sees_the_ground_truth() -> None:
    told = trial(5, FOLLOW, 3.0)
    assert [round(one.time, 6) for one in told] == [1.0, 2.0, 3.0]
    assert all(np.isfinite(one.log_score) for one in told)
    assert told[-1].position_error < 0.2 and not told[-1].lost
    assert told[-1].mapped >= 5 and told[-1].landmark_rmse < 0.5
    assert told[-1].log2_dets[2] < told[0].log2_dets[2]
    assert told[0].births > 0 and told[-1].matched > 0.5
    still = trial(5, STILL, 1.0)
    assert still[0].log2_dets[2] == pytest.approx(told[0].log2_dets[2], abs=1e-6)  # nobody was told anything yet


def test_the_log_score_of_the_live_study_is_that_of_the_environment_with_images() -> None:
    """Its N slots have true points: scene points of features, and random points of the room scored by the prior."""
    room = RenderedRoom(5)
    session, evaluator, seconds = Session(room, 5), Evaluator(room, 5), []
    for k in range(31):
        evaluator.look(session, session.step())
        if k % 15 == 0:
            seconds.append(evaluator.second())
    assert seconds[0].log_score == 0.0 and seconds[2].log_score > seconds[1].log_score > 50.0
    estimate, truth = taken_estimate(session.front_end.estimate()), room.person.state
    slots, _ = session.expected.factored()
    landmarks, variance = evaluator._spare.copy(), np.array(ROOM.landmark_prior_variance)
    counting = slots[slots >= 0]
    landmarks[slots >= 0] = evaluator._followed.of(estimate.ids[counting])
    rows = np.r_[:12, (12 + 3 * counting[:, None] + np.arange(3)).ravel()]
    error = np.r_[camera_error(truth, estimate.camera), (landmarks[slots >= 0] - estimate.points[counting]).ravel()]
    density = multivariate_normal(cov=estimate.covariance[np.ix_(rows, rows)]).logpdf(error)
    density += norm(scale=np.sqrt(variance)).logpdf(landmarks[slots < 0]).sum()
    assert 0 < len(counting) < ROOM.landmark_count
    assert seconds[2].log_score == pytest.approx(density / np.log(2.0) - evaluator._first_density, rel=1e-9)


def test_lost_is_in_the_live_study_what_it_is_in_the_environment() -> None:
    told = [signature(made).parameters["lost_position_error"].default for made in (ActiveSLAMEnv, ActiveSLAMVectorEnv)]
    room = RenderedRoom(5)
    session = Session(room, 5)
    state, evaluator = session.step(), Evaluator(room, 5)
    for share, lost in ((0.98, False), (1.02, True), (0.0, True)):
        camera = state.truth.copy()
        camera[0] += share * told[0]
        evaluator.look(session, replace(state, camera=camera, births=0))
        assert evaluator.second().lost == lost
    assert set(told) == {0.5}


def test_the_command_writes_its_files_and_its_section_and_makes_no_run_twice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = tmp_path / "page.md"
    both = ("live", "live-claims")
    page.write_text("a\n" + "".join(f"<!-- generated: {one} -->\nold\n<!-- end: {one} -->\nb\n" for one in both))
    line = ["live", "--rooms", "1", "--seed", "9", "--seconds", "2", "--out", str(tmp_path / "out")]
    assert main([*line, "--report", str(page), "--no-figures"]) == 0
    assert {path.name for path in (tmp_path / "out").iterdir()} >= {"seconds.csv", "live.md", "settings.json"}
    assert len((tmp_path / "out" / "seconds.csv").read_text().splitlines()) == 1 + 3 * 2
    text = page.read_text()
    assert "old" not in text and "| 2 s, 1 rooms | follows |" in text and "--rooms 1 --seconds 2 --seed 9" in text
    page.write_text(text.replace("follows", "?"))
    (kept,) = (tmp_path / "out" / "runs").glob(f"9-{STILL}-*")
    kept.write_text("{")  # damaged: made again
    again: list[tuple[Any, ...]] = []
    monkeypatch.setattr(advising, "trial", lambda *task: again.append(task) or trial(*task))
    assert main([*line, "--report", str(page), "--no-figures"]) == 0
    assert again == [(9, STILL, 2.0)] and page.read_text() == text
