"""`python -m agents`: each mistake is reported in a line, before any work, and small commands in full."""

import json
import re
import sys
from collections.abc import Iterator
from importlib import import_module
from itertools import product
from pathlib import Path
from types import SimpleNamespace
from typing import Any, get_type_hints

import numpy as np
import pytest

from activeslam_gym import SCENARIOS
from activeslam_gym.evaluation import row_of
from agents import watch
from agents.__main__ import COMMANDS, main
from agents.task import make_environment
from agents.tools.arguments import scenario_argument
from agents.tools.sections import Table, put_section

pytest.importorskip("torch")

OWN = """
class P:
    def __init__(self, answer):
        self.answer = answer
    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return self.answer()
def raises(env): raise ZeroDivisionError("division by zero\\nand more")
def none(env): return None
def no_arguments(): return None
def no_state(env): return P(lambda: (2, 1))
def not_a_number(env): return P(lambda: ((float("nan"), 1), None))
"""
FILES = {"file": "x", "page.md": "no marks", "own.py": OWN, "exits.py": "import sys; sys.exit(3)"}
FILES |= {"broken.py": "def (:", "broken.npz": "PK\3\4 not all", "broken.json": "{}", "half.npz": "", "half.json": "{"}

UNKNOWN = "; allowed: random, stay, sweep"
TABLE: tuple[tuple[str, str, str, str], ...] = (
    ("compare train", "--out", "TMP/file TMP/file/below", "is no folder to write to"),
    ("watch", "--tum", "TMP/file", "is no folder to write to"),
    ("watch", "--save", "clip.avi", "must end in .gif, got"),
    ("compare", "--report", "TMP/page.md", "has no section <!-- generated:"),
    ("compare", "--policies", "TMP/broken.npz TMP/half.npz", "cannot be read"),
    ("compare", "--policies", "absent.npz", "is no file of weights"),
    ("export", "--policy", "nobody", "policy: 'nobody'; allowed: generalist"),
    ("compare watch", "--policies", "nobody MI-FISHER", UNKNOWN),
    ("compare", "--policies", "exits:make own:absent a:b:c", "cannot be imported"),
    ("compare", "--policies", "own:raises", "ZeroDivisionError: division by zero (own.py:7)"),
    ("compare", "--policies", "own:no_arguments", "TypeError"),
    ("compare", "--policies", "own:none", "must return an action, or an object with predict(observation, …), got None"),
    ("compare", "--policies", "own:no_state", "predict must return (action, state), got (2, 1)"),
    ("compare", "--policies", "own:not_a_number", "action must be two whole numbers"),
    ("train", "--reward", "bogus", "reward must be one of entropy, log_score"),
    ("compare watch", "--gaze-period", "0.07", "must be a whole multiple of the frame (0.05 s)"),
    ("compare watch", "--scenario", "nowhere [1]", "scenario must be one of paper, paper-literal"),
    ("compare", "--scenario", "{ {pixel_std:1}", "is no JSON object"),
    ("train", "--scenario", "office+office sprint+office+sprint", "allowed: each scenario once"),
    ("compare train watch export", "--nonsense", "", "Unrecognized options: --nonsense"),
)
"""(commands, options, values, what is said): each command with each option and each value is a mistake."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A folder with files that are not what they should be, where the commands run and modules are found."""
    home = tmp_path_factory.mktemp("mistakes")
    for name, text in FILES.items():
        (home / name).write_text(text)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(home)
        patch.syspath_prepend(home)
        patch.setattr(sys, "dont_write_bytecode", True)
        patch.setenv("COLUMNS", "300")
        yield home


FRAMES = str.maketrans("│╭╰╮╯─", "      ")
"""Of the parser."""


def refused(line: list[str], capsys: Any) -> str:
    """What is said of a command line: one line that begins with the command, or the parser's words."""
    beside = ["--tum", "t"] if line[0] == "watch" and "--tum" not in line else []
    try:
        status: object = main([line[0], *beside, *line[1:]])
    except SystemExit as exit_:
        status = exit_.code
    said = capsys.readouterr().err.translate(FRAMES).splitlines()
    lines = [one for one in said if "compiling kernels" not in one]  # which a first run has to
    text = " ".join(" ".join(lines).split())
    in_a_line = len(lines) == 1 and lines[0].startswith(f"python -m agents {line[0]}: ")
    assert status == 2 and "Traceback" not in text and (in_a_line or "For full helptext" in text), (line, text)
    return text


@pytest.mark.parametrize("row", TABLE, ids=lambda row: f"{row[1]} {row[3][:20]}")
def test_a_mistake_is_reported_in_a_line_before_any_work(row: Any, folder: Path, capsys: Any) -> None:
    before, (commands, options, values, said) = sorted(folder.rglob("*")), row
    for command, option, value in product(commands.split(), options.split(), values.split() or [""]):
        text = refused([command, option, *filter(None, [value.replace("TMP", str(folder))])], capsys)
        assert said in text, (command, option, value, text)
        assert said != "cannot be imported" or "(episode" not in text  # no episode had begun
    assert sorted(folder.rglob("*")) == before


ZERO = ("seed", "warm_start", "entropy_bonus", "test_episodes")
"""Numbers that may be zero."""


@pytest.mark.parametrize("command", COMMANDS)
def test_every_number_of_every_command_is_bounded_and_named(command: str, folder: Path, capsys: Any) -> None:
    before = sorted(folder.rglob("*"))
    for name, kind in get_type_hints(import_module(COMMANDS[command]).Args).items():
        if not (number := re.search(r"\b(int|float)\b", str(kind))):
            continue
        values = ["nan", "-1", "x", *(["1.5", "9" * 30] if number[0] == "int" else ["inf"])]
        for value in values + ["0"] * (name not in ZERO):
            text = refused([command, f"--{name.replace('_', '-')}", value], capsys)
            assert name in text.replace("-", "_"), (name, value, text)
    assert sorted(folder.rglob("*")) == before


def test_a_section_is_replaced_and_a_scenario_is_a_name_or_json(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    marks = [f"<!-- generated: {name} -->\n<!-- end: {name} -->" for name in "ab"]
    page.write_text("# Mine\n\n" + "\n\n".join(marks) + "\n\nEnd.\n")
    assert put_section(page, "a", "first \\1") and put_section(page, "b", "other")
    assert put_section(page, "a", "second \\2") and not put_section(page, "c", "nowhere")
    bodies = ("second \\2", "other")
    parts = [mark.replace("\n", f"\n{body}\n") for mark, body in zip(marks, bodies)]
    assert page.read_text() == "# Mine\n\n" + "\n\n".join(parts) + "\n\nEnd.\n"
    assert scenario_argument("hall") == "hall"
    assert scenario_argument('{"pixel_std": 4.0}') == {"pixel_std": 4.0}
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
    for text in ("rooms_of_mine:wrong", "rooms_of_mine:absent", "absent_module:one", str(tmp_path / "no.json")):
        with pytest.raises(ValueError, match="scenario: .*allowed: 'package|cannot be read"):
            make_environment({"scenario": scenario_argument(text)})


def test_several_scenarios_are_compared_each_in_a_folder_of_its_name(tmp_path: Path, capsys: Any) -> None:
    (tmp_path / "paper").mkdir()
    (tmp_path / "paper" / "maps.png").write_text("of other policies")
    line = f"compare --policies stay --reference stay --episodes 1 --duration 1 --jobs 1 --no-figures --out {tmp_path}"
    assert main([*line.split(), "--scenario", "paper", "sprint"]) == 0
    out = capsys.readouterr().out
    for name in ("paper", "sprint"):
        assert f"{name}: stay; 1 episodes each" in out and (tmp_path / name / "summary.md").is_file()
        assert json.loads((tmp_path / name / "summary.json").read_text())["settings"]["scenario"] == name
        assert f"{name}/: episodes.csv, summary.json, summary.md\n" in out


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


def duration_of(animation: Any) -> int:
    """Of all pictures but the last [ms]."""
    return sum(animation.seek(k) or animation.info["duration"] for k in range(animation.n_frames - 1))


@pytest.mark.parametrize("step", [0.25, 1.0 / 15.0, 0.5])
def test_an_animation_keeps_the_times_of_its_pictures(tmp_path: Path, step: float) -> None:
    """One of every step played up to a hundred times faster than life."""
    from PIL import Image

    ramp = np.tile(np.arange(0, 247, 19, dtype=np.uint8)[:, None], (13, 1, 3))
    pictures = [np.roll(ramp, k, axis=1) for k in range(13)]
    watch.write_animation(tmp_path / "clip.gif", pictures, [step * k for k in range(13)])
    with Image.open(tmp_path / "clip.gif") as animation:
        assert abs(duration_of(animation) - max(1000 * 12 * step / 4, 12 * 20)) <= 5


def test_two_policies_are_watched_side_by_side(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("matplotlib")
    monkeypatch.setattr(watch, "row_of", lambda episode: row_of(episode) | {"distinct_landmarks": -1})
    from PIL import Image

    clip = tmp_path / "new" / "clip.gif"
    args = watch.Args(policies=("sweep", "stay"), duration=2.0, every=0.5, width=300, save=clip, tum=tmp_path / "tum")
    assert watch.main(args) == 0
    with Image.open(clip) as animation:
        assert animation.n_frames == 5 and animation.width == 600
        first = np.asarray(animation.convert("RGB"))
        animation.seek(4)
        assert (np.asarray(animation.convert("RGB")) != first).any()
        assert duration_of(animation) == 500, "four times faster than life"
    film = watch.Film(0.5, 60)
    for k in range(9):
        film.observe(SimpleNamespace(time=0.25 * k, snapshot=dict), {"lost": k > 2})
    assert len(film._moments) == 5
    said = capsys.readouterr().out
    assert "sweep, episode 1000000:" in said and f"Written to {clip}" in said
    assert "-1 landmarks mapped" not in said  # these were the distinct ones
    poses = np.loadtxt(tmp_path / "tum" / "sweep-1000000-true.tum")
    assert poses.shape == (9, 8)
    np.testing.assert_allclose(np.linalg.norm(poses[:, 4:], axis=1), 1.0, atol=1e-6)
