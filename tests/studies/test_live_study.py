"""`python -m studies.live`: its table agrees with its episodes, which an evaluator compares with the ground truth."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

pytest.importorskip("cv2", reason="the extra `vision` is not installed")
pytest.importorskip("tyro", reason="the extra `compare` is not installed")

from activeslam_gym.live.session import Session
from activeslam_gym.live.source import FOLLOW, ROOM, STILL, RenderedRoom
from activeslam_gym.live.trial import Evaluator, trial
from activeslam_gym.metrics import camera_error
from activeslam_gym.slam.estimate import taken_estimate
from studies import live


def test_the_evaluator_sees_the_ground_truth() -> None:
    told = trial(5, FOLLOW, 3.0)
    assert [round(one.time, 6) for one in told] == [1.0, 2.0, 3.0]
    assert all(np.isfinite(one.log_score) for one in told)
    assert told[-1].position_error < 0.2 and not told[-1].lost
    assert told[-1].log2_det_total < told[0].log2_det_total
    still = trial(5, STILL, 1.0)
    assert still[0].log2_det_total == pytest.approx(told[0].log2_det_total, abs=1e-6)  # nobody was told anything yet


def test_the_log_score_of_the_live_study_is_that_of_the_environment_with_images() -> None:
    """Its N slots have true points: scene points of features, and random points of the room scored by the prior."""
    room = RenderedRoom(5)
    session, evaluator, seconds = Session(room, 5), Evaluator(room, 5), []
    for k in range(31):
        evaluator.add(session, session.step())
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


def test_the_command_fills_its_page_and_makes_no_episode_twice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = tmp_path / "page.md"
    page.write_text("<!-- generated: live -->\nold\n<!-- end: live -->\n")
    args = live.Args(episodes=1, seed=9, seconds=(2.0,), out=tmp_path / "out", report=page)
    live.main(args)
    text = page.read_text()
    assert "old" not in text and "| 2 s, 1 rooms | follows |" in text and "--episodes 1 --seconds 2 --seed 9" in text
    (kept,) = (tmp_path / "out").glob(f"9-{STILL}-*")
    kept.write_text("{")  # damaged: made again
    again: list[tuple[Any, ...]] = []
    monkeypatch.setattr(live, "trial", lambda *task: again.append(task) or trial(*task))
    live.main(args)
    assert again == [(9, STILL, 2.0)] and page.read_text() == text
