"""`python -m agents`: options, generated sections, and small commands in full."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from activeslam_gym import SCENARIOS
from agents import watch
from agents.__main__ import main
from agents.task import make_environment
from agents.tools.arguments import scenario_argument
from agents.tools.sections import Table, put_section


def test_a_section_is_replaced_and_a_scenario_is_a_name_or_json(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    marks = [f"<!-- generated: {name} -->\n<!-- end: {name} -->" for name in "ab"]
    page.write_text("# Mine\n\n" + "\n\n".join(marks) + "\n\nEnd.\n")
    assert put_section(page, "a", "first \\1") and put_section(page, "b", "other")
    assert put_section(page, "a", "second \\2") and not put_section(page, "c", "nowhere")
    bodies = ("second \\2", "other")
    parts = [mark.replace("\n", f"\n{body}\n") for mark, body in zip(marks, bodies)]
    assert page.read_text() == "# Mine\n\n" + "\n\n".join(parts) + "\n\nEnd.\n"
    with pytest.raises(ValueError, match="report: there is no page"):
        put_section(tmp_path / "absent.md", "a", "")
    assert scenario_argument("hall") == "hall"
    assert scenario_argument('{"pixel_std": 4.0}') == {"pixel_std": 4.0}
    with pytest.raises(ValueError, match="is no JSON object"):
        scenario_argument("{pixel_std}")
    with pytest.raises(ValueError, match=r"^scenario: .{2,90} is no JSON object \("):
        scenario_argument('{"a":' * 10**5)


def test_a_scenario_is_of_a_module_or_a_file_or_registered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    code = "from activeslam_gym import SCENARIOS, Scenario\none = Scenario(name='one', pixel_std=3.0)\n"
    code += "def fields(): return {'pixel_std': 3.0}\nSCENARIOS['registered'] = one\nwrong = {'pixel_sd': 1}\n"
    (tmp_path / "rooms_of_mine.py").write_text(code)
    (tmp_path / "room.json").write_text('{"pixel_std": 3.0}')
    names = [f"rooms_of_mine:{name}" for name in ("one", "fields", "registered")]
    for text in (*names, str(tmp_path / "room.json"), "registered"):
        env = make_environment({"scenario": json.loads(json.dumps(scenario_argument(text)))})
        assert env.unwrapped.scenario.pixel_std == 3.0
    SCENARIOS.pop("registered")
    (tmp_path / "list.json").write_text("[]")
    for text in (
        "rooms_of_mine:wrong",
        "rooms_of_mine:absent",
        "absent_module:one",
        "os:abc",
        str(tmp_path / "no.json"),
    ):
        with pytest.raises(ValueError, match="scenario: .*allowed: 'package|cannot be read"):
            make_environment({"scenario": scenario_argument(text)})
    with pytest.raises(ValueError, match="is no JSON object"):
        scenario_argument(str(tmp_path / "list.json"))


def test_several_scenarios_are_compared_each_in_a_folder_of_its_name(tmp_path: Path, capsys: Any) -> None:
    line = f"compare --policies stay --reference stay --episodes 1 --duration 1 --jobs 1 --no-figures --out {tmp_path}"
    assert main([*line.split(), "--scenario", "paper", "sprint"]) == 0
    out = capsys.readouterr().out
    for name in ("paper", "sprint"):
        assert f"{name}: stay; 1 episodes each" in out and (tmp_path / name / "summary.md").is_file()
        assert json.loads((tmp_path / name / "summary.json").read_text())["settings"]["scenario"] == name


def test_a_foreign_text_neither_closes_a_section_nor_is_markup(tmp_path: Path) -> None:
    """A note with the closing mark ended the section, and stayed in the page for good."""
    page = tmp_path / "page.md"
    page.write_text("<!-- generated: board -->\n<!-- end: board -->\nEnd.\n")
    note = "a | b\n<!-- end: board --><img src=x> `c` [d](javascript:e) *g* $h$ \x1b[2J"
    whole = Table("", ["entry", "note"], [["my_policy", note]])
    for text in (whole.markdown(), f"{note} <!-- generated: board -->", "short"):
        assert put_section(page, "board", text)
        assert page.read_text().count("<!--") == 2 and page.read_text().endswith("<!-- end: board -->\nEnd.\n")
    row = whole.markdown().splitlines()[-1]
    assert "my_policy" in row and not set("<>`*$\x1b") & set(row) and "](" not in row and "\x1b" not in whole.aligned()


def test_two_policies_are_watched_side_by_side(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("matplotlib")
    from PIL import Image

    clip = tmp_path / "new" / "clip.gif"
    args = watch.Args(policies=("sweep", "stay"), duration=2.0, every=0.5, width=300, save=clip, tum=tmp_path / "tum")
    assert watch.main(args) == 0
    with Image.open(clip) as animation:
        assert animation.n_frames == 5 and animation.width == 600
        first = np.asarray(animation.convert("RGB"))
        animation.seek(4)
        assert (np.asarray(animation.convert("RGB")) != first).any()
    said = capsys.readouterr().out
    assert "sweep, episode 1000000:" in said and f"Written to {clip}" in said
    poses = np.loadtxt(tmp_path / "tum" / "sweep-1000000-true.tum")
    assert poses.shape == (9, 8)
    np.testing.assert_allclose(np.linalg.norm(poses[:, 4:], axis=1), 1.0, atol=1e-6)
