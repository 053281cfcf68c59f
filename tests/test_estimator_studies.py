"""The studies of the estimators, small, and their laws."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from activeslam_gym.metrics import write_tum
from studies import estimators, trajectories


def test_tau_counts_the_resolved_pairs_that_another_estimator_reverses() -> None:
    rng = np.random.default_rng(0)
    base = {name: score + rng.normal(0.0, 1.0, 30) for name, score in (("a", 9.0), ("b", 5.0), ("c", 5.0), ("d", 0.0))}
    base["twin"] = base["a"].copy()
    pairs = estimators.resolved(base)
    assert ("a", "b") in pairs and ("c", "d") in pairs and not {("a", "twin"), ("twin", "a")} & set(pairs)
    assert estimators.ranking(base, base)[0] == "1.00 [1.00, 1.00]"
    assert estimators.ranking(base, {name: -score for name, score in base.items()})[0] == "-1.00 [-1.00, -1.00]"
    assert estimators.ranking(base, base | {"b": base["a"] + 1.0})[1:3] == [str(len(pairs)), "2"]
    assert estimators.ranking({"a": base["a"], "b": base["a"]}, {"a": base["a"], "b": base["a"]})[:3] == ["–", "0", "0"]


def test_the_estimators_fill_their_page(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("<!-- generated: estimators -->\n<!-- end: estimators -->\n")
    line = "--policies stay orbit --episodes 6 --scenarios office --estimators ekf-plain --report"
    estimators.main([*line.split(), str(page)])
    told = page.read_text()
    assert told.count("| office | `ekf` |") == 1 and told.count("| office | `ekf-plain` |") == 2 and "nan" not in told


def test_a_recorded_motion_is_flown(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    times = np.arange(60) / 30.0
    positions = np.stack((0.3 * np.sin(times), np.full(60, 1.2), 0.1 * times), axis=1)
    looks = Rotation.from_rotvec(np.outer(0.2 * times, (0, 1, 0))) * Rotation.from_matrix(np.diag((-1.0, -1.0, 1.0)))
    write_tum(tmp_path / "path.tum", times, positions, np.roll(looks.as_quat(), 1, axis=1))
    trajectories.main([str(tmp_path / "path.tum"), "--rooms", "2", "--estimators", "ekf"])
    rows = [line for line in capsys.readouterr().out.splitlines() if "`ekf`" in line]
    assert len(rows) == 2 and all("0 of 2" in row for row in rows)
