"""A damaged live recording ends `live --replay` with one line that names the file and the value."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

cv2 = pytest.importorskip("cv2", reason="the extra `vision` is not installed")

from activeslam_gym.__main__ import main  # noqa: E402
from activeslam_gym.live.recording import Recording, read_about, read_states  # noqa: E402
from activeslam_gym.live.state import plain  # noqa: E402

from .live_scene import ABOUT, a_state  # noqa: E402

HUGE = 10**400
STRANGE = (None, "x", -1, HUGE, 1e999, -1e999, [], {}, [["x"]], [HUGE], ["x"], True, 0.5)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A recording of two images."""
    made = Recording(tmp_path / "run", ABOUT)
    for frame in (1, 2):
        made.add(a_state(frame), None)
    made.close()
    return made.folder


def rewrite(path: Path, name: str, value: Any) -> None:
    """Put ``value`` for ``name`` into the JSON object of the file's first line, or of the file."""
    text = path.read_text()
    first, rest = (text, "") if path.suffix == ".json" else text.split("\n", 1)
    path.write_text(json.dumps({**json.loads(first), name: value}) + "\n" + rest)


def test_a_replay_without_a_rate_ends_with_one_line(folder: Path, capsys: Any) -> None:
    for rate in (0, 0.0, -1, None, "x", "15", True, [], {}, HUGE, 1e-320, 1e999, float("nan")):
        rewrite(folder / "live.json", "rate", rate)
        assert main(["live", "--replay", str(folder), "--port", "0"]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert "live.json is damaged (rate: " in line and len(line) < 300


@pytest.mark.parametrize("name", list(vars(ABOUT)))
def test_an_about_is_read_or_refused(name: str, folder: Path) -> None:
    assert read_about(folder) == type(ABOUT)(**{**vars(ABOUT), "replay": True})
    for value in (*STRANGE, [0, 0], [-1, 2], [1, 2, HUGE], [1.5, 2]):
        rewrite(folder / "live.json", name, value)
        try:
            about = read_about(folder)
        except ValueError as error:
            assert "\n" not in str(error) and "live.json is damaged" in str(error)
        else:
            assert getattr(about, name) == (True if name == "replay" else value)
            assert name == "focal" or type(getattr(about, name)) is type(getattr(ABOUT, name))


@pytest.mark.parametrize("name", list(plain(a_state())))
def test_a_state_is_read_whole_or_refused(name: str, folder: Path) -> None:
    sound = plain(a_state())
    short = sound[name][:-1] if isinstance(sound[name], list) else sound[name]
    for value in (*STRANGE, short):
        rewrite(folder / "states.jsonl", name, value)
        try:
            state = next(read_states(folder))
        except ValueError as error:
            assert "\n" not in str(error) and "states.jsonl is damaged" in str(error) and len(str(error)) < 400
        else:
            assert plain(state) == {**sound, name: value}


def test_nonsense_in_a_state_s_line_is_refused(folder: Path) -> None:
    path = folder / "states.jsonl"
    sound = path.read_bytes()
    for rubbish in (b"[" * 10**6, b"\xff\xfe", b"[]", b"7", b"9" * 5000, b"{}", b'{"nobody": 1}', b""):
        path.write_bytes(rubbish + b"\n" + sound)
        with pytest.raises(ValueError, match="^line 1 of .*states.jsonl is damaged"):
            next(read_states(folder))


def test_a_line_without_end_is_not_read_to_its_end(folder: Path) -> None:
    for name in ("live.json", "states.jsonl"):
        (folder / name).unlink()
        (folder / name).symlink_to("/dev/zero")
    with pytest.raises(ValueError, match="^line 1 of .*states.jsonl is damaged"):
        next(read_states(folder))
    with pytest.raises(FileNotFoundError, match="holds no live recording"):
        read_about(folder)


def test_only_a_grey_picture_is_read(folder: Path) -> None:
    path = folder / "images" / "000000.png"
    for image in (np.zeros((240, 320, 3), np.uint8), np.zeros((240, 320), np.uint16)):
        assert cv2.imwrite(str(path), image)
        with pytest.raises(ValueError, match="000000.png is no 8-bit grey picture"):
            next(read_states(folder))
