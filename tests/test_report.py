"""Generated sections, and the table of conditions outside the training."""

from pathlib import Path

import pytest

from agents.compare import generalise
from agents.tools.arguments import scenario_argument
from agents.tools.sections import put_section


def test_a_section_is_replaced_and_the_rest_is_left_alone(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    marks = [f"<!-- generated: {name} -->\n<!-- end: {name} -->" for name in "ab"]
    page.write_text("# Mine\n\n" + "\n\n".join(marks) + "\n\nEnd.\n")
    assert put_section(page, "a", "first \\1") and put_section(page, "b", "other")
    assert put_section(page, "a", "second \\2") and not put_section(page, "c", "nowhere")
    text = page.read_text()
    assert text.startswith("# Mine\n") and text.endswith("\nEnd.\n")
    assert "second \\2" in text and "other" in text and "first" not in text and "nowhere" not in text
    with pytest.raises(ValueError, match="report: there is no page"):
        put_section(tmp_path / "absent.md", "a", "")


def test_the_same_policies_are_run_in_every_condition(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    conditions = {"default": "paper", "9 landmarks": '{"landmark_count": 9}'}
    monkeypatch.setattr(generalise, "CONDITIONS", conditions)
    page = tmp_path / "R.md"
    page.write_text("<!-- generated: generalise -->\n<!-- end: generalise -->\n")
    args = generalise.Args(policies=("stay", "sweep"), episodes=1, out=tmp_path, report=(page,), jobs=1)
    assert generalise.main(args) == 0
    rows = [line for line in (tmp_path / "generalise.md").read_text().splitlines() if line.startswith("| ")]
    assert [line.split(" | ")[:2] for line in rows[2:]] == [
        [f"| {condition}", policy] for condition in conditions for policy in ("stay", "sweep")
    ]
    assert "python -m agents generalise --policies stay sweep" in page.read_text()


def test_a_scenario_is_a_name_or_json() -> None:
    assert scenario_argument("hall") == "hall"
    assert scenario_argument('{"pixel_std": 4.0}') == {"pixel_std": 4.0}
    with pytest.raises(ValueError, match="is no JSON object"):
        scenario_argument("{pixel_std}")
