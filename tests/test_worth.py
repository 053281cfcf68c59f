"""The study of the worth of each mechanism: its rows replace what there is, and its differences are paired."""

import re
from pathlib import Path

import pytest

from studies.paired import compare
from studies.removals import REMOVALS

PACKAGE = Path(__file__).parents[1] / "activeslam_gym"


@pytest.mark.parametrize("row", [row for row in REMOVALS if row != "base"])
def test_a_row_replaces_a_function_or_constant_that_there_is(row: str) -> None:
    """A row that replaces nothing would show that a mechanism has no worth."""
    for module, lines in REMOVALS[row].items():
        source = (PACKAGE / f"{module}.py").read_text(encoding="utf-8")
        defined = re.findall(r"^def (\w+)|^([A-Z_]+(?:, [A-Z_]+)*) =|import \w+ as (\w+)$", lines, re.MULTILINE)
        names = [name for one in defined for name in ", ".join(filter(None, one)).split(", ")]
        assert names and all(re.search(rf"\b{name}\b", source) for name in names), names
        for field in re.findall(r"out\.(\w+) =", lines):
            assert re.search(rf"^    {field}=", source, re.MULTILINE), field


def test_differences_are_of_the_same_episodes() -> None:
    def episodes(lost: float, score: float, seeds: range) -> list[dict[str, str]]:
        numbers = {"lost": lost, "log_score": score, "pose_nees": 1.0, "landmark_nees": 1.0}
        one = {"scenario": "paper", "policy": "stay", **{name: str(value) for name, value in numbers.items()}}
        return [{**one, "seed": str(seed)} for seed in seeds]

    (found,) = compare(episodes(0, 100.0, range(20)), episodes(1, -50.0, range(10, 40))).values()
    assert found["episodes"] == found["under_zero"] == 10
    assert found["lost"] == found["lost_low"] == 100.0 and found["score"] == found["score_high"] == -0.5
