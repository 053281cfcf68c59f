"""Mistakes on the command line: each is told in a line, before any work, and leaves nothing behind."""

import errno
import os
import re
import sys
from collections.abc import Iterator
from importlib import import_module
from itertools import product
from pathlib import Path
from typing import Any, get_type_hints

import pytest

from agents.__main__ import COMMANDS, main
from studies import consistency, run

pytest.importorskip("torch")

OWN = """
class P:
    def __init__(self, answer):
        self.answer = answer
    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return self.answer()
class Q:
    def predict(self):
        return (0, 0), None
def raises(env): raise ZeroDivisionError("division by zero\\nand more")
def none(env): return None
def no_arguments(): return None
def other_predict(env): return Q()
def not_a_number(env): return P(lambda: ((float("nan"), 1), None))
"""
FILES = {
    "file": "x",
    "page.md": "no marks",
    "own.py": OWN,
    "exits.py": "import sys; sys.exit(3)",
}
FILES |= {"broken.py": "def (:", "broken.npz": "PK\3\4 not all", "broken.json": "{}", "half.npz": "", "half.json": "{"}

UNKNOWN = "; allowed: random, stay, sweep"
TABLE: tuple[tuple[str, str, str, str], ...] = (
    # files and folders
    ("compare train", "--out", "TMP/file TMP/file/below", "is no folder to write to"),
    ("watch", "--tum", "TMP/file", "is no folder to write to"),
    ("watch", "--save", "TMP/file/a.gif", "is no folder to write to"),
    ("watch", "--save", "clip.avi", "must end in .gif, got"),
    ("compare", "--report", "TMP/absent.md", "there is no page"),
    ("compare", "--report", "TMP/page.md", "has no section <!-- generated:"),
    ("compare", "--policies", "TMP/broken.npz TMP/half.npz", "cannot be read"),
    ("compare", "--policies", "absent.npz", "is no file of weights"),
    ("export", "--out", "a.npz", "out must end in .zip"),
    ("export", "--policy", "nobody", "policy: 'nobody'; allowed: generalist"),
    # policies
    ("compare watch", "--policies", "nobody MI-FISHER", UNKNOWN),
    ("compare", "--policies", "", "policies: none given; allowed: one name or more"),
    ("compare", "--policies", "exits:make own:absent a:b:c", "cannot be imported"),
    ("compare", "--policies", "own:raises", "ZeroDivisionError: division by zero (own.py:10)"),
    ("compare", "--policies", "own:no_arguments", "TypeError"),
    ("compare", "--policies", "own:none", "must return an action, or an object with predict(observation, …), got None"),
    ("compare", "--policies", "own:other_predict", "TypeError"),
    ("compare", "--policies", "own:not_a_number", "action must be two whole numbers"),
    ("compare", "--reference", "nobody", "is not compared; allowed: mi-constant"),
    ("train", "--reward", "bogus", "reward must be one of entropy, log_score"),
    # numbers, beside those of `test_every_number_of_every_command_is_bounded_and_named`
    ("compare", "--duration", "0.01", "duration must be a whole multiple of "),
    ("compare watch", "--gaze-period", "0.07", "must be a whole multiple of the frame (0.05 s)"),
    ("train", "--duration", "0.1", "must be a whole multiple of decision_period (1 s)"),
    # scenarios
    ("compare watch", "--scenario", "nowhere [1]", "scenario must be one of paper, paper-literal"),
    ("compare", "--scenario", "{ {pixel_std:1}", "is no JSON object"),
    ("compare", "--scenario", '{"nonsense":1}', "scenario has no field nonsense"),
    # the line itself
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


def told(capsys: pytest.CaptureFixture[str], run: Any, line: list[str]) -> tuple[object, list[str]]:
    """Exit status and lines of stderr, without the parser's frames."""
    try:
        status = run(line)
    except SystemExit as exit_:
        status = exit_.code
    said = capsys.readouterr().err.translate(FRAMES).splitlines()
    return status, [line for line in said if "compiling kernels" not in line]  # which a first run has to


def refused(line: list[str], capsys: Any) -> str:
    """What is said of a command line: one line that begins with the command, or the parser's words."""
    beside = ["--tum", "t"] if line[0] == "watch" and "--tum" not in line else []
    status, lines = told(capsys, main, [line[0], *beside, *line[1:]])
    text = " ".join(" ".join(lines).split())
    assert status == 2 and "Traceback" not in text, (line, text)
    assert "For full helptext" in text or (len(lines) == 1 and lines[0].startswith(f"python -m agents {line[0]}: ")), (
        line,
        text,
    )
    return text


@pytest.mark.parametrize("row", TABLE, ids=lambda row: f"{row[1]} {row[3][:20]}")
def test_a_mistake_is_told_in_a_line_before_any_work(row: Any, folder: Path, capsys: Any) -> None:
    before = sorted(folder.rglob("*"))
    commands, options, values, said = row
    for command, option, value in product(commands.split(), options.split(), values.split() or [""]):
        text = refused([command, option, *filter(None, [value.replace("TMP", str(folder))])], capsys)
        assert said in text, (command, option, value, text)
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


def test_a_full_disk_is_a_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    def full(self: Path, target: Path) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(target))

    monkeypatch.setattr(Path, "replace", full)
    line = "compare --policies stay --episodes 1 --jobs 1 --duration 1 --no-figures --out".split()
    status, lines = told(capsys, main, [*line, str(tmp_path)])
    assert status == 2 and lines[-1].startswith("python -m agents compare: [Errno 28]")
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def ran(line: list[str]) -> None:
    """Run a study by its command line."""
    run(consistency.Args, consistency.main, line)


STUDIES = {"--out TMP/file": "is no folder", "--report TMP/absent.md": "no page", "--report TMP/page.md": "no section"}
STUDIES |= {"--seed -1": "allowed: 0 to", "--episodes 0": "allowed: 1 to", "--jobs 0": "allowed: 1 to"}


def test_a_mistake_in_a_study_is_told_in_a_line(folder: Path, capsys: Any) -> None:
    for line, said in (
        STUDIES | {"--policies nobody": UNKNOWN, "--scenario nowhere": "scenario must be one of"}
    ).items():
        status, said_lines = told(capsys, ran, line.replace("TMP", str(folder)).split())
        text = " ".join(said_lines)
        assert status == 2 and said in text and "Traceback" not in text, (line, text)
