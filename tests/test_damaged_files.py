"""Calibrations, targets and boards that are damaged or endless: one line that names the file, status 2."""

import json
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

cv2 = pytest.importorskip("cv2", reason="the extra `vision` is not installed")

from activeslam_gym.__main__ import main  # noqa: E402
from activeslam_gym.vision.calibration import calibration_from  # noqa: E402
from activeslam_gym.vision.target import CORNERS, target_from  # noqa: E402

from .vision_scene import LENS  # noqa: E402

GOOD: dict[str, dict[str, Any]] = {
    "calibration": LENS._asdict(),
    "rectangle": {"kind": "rectangle", "width": 0.2, "height": 0.1, "corners_px": dict.fromkeys(CORNERS, [1, 2])},
    "charuco": {"kind": "charuco", "columns": 7, "rows": 5, "square": 0.03, "marker": 0.02, "dictionary": "4x4_50"},
    "apriltag": {"kind": "apriltag", "columns": 4, "rows": 3, "tag": 0.05, "gap": 0.01, "dictionary": "36h11"},
}
HUGE = int("9" * 400)
"""A number of 400 digits: Python's integer, and no float."""
WRONG = (HUGE, -HUGE, 1e300, float("nan"), float("inf"), None, [], {}, "a\nb", [[[]]])


@pytest.fixture
def images(tmp_path: Path) -> Path:
    """A folder with three grey images, and a sound calibration and target beside it."""
    folder = tmp_path / "images"
    folder.mkdir()
    for k in range(3):
        cv2.imwrite(str(folder / f"{k}.png"), np.full((240, 320), 90, np.uint8))
    (tmp_path / "lens.json").write_text(json.dumps(GOOD["calibration"]))
    (tmp_path / "target.json").write_text(json.dumps(GOOD["rectangle"]))
    return folder


def files_of(images: Path, **others: Any) -> dict[str, Any]:
    """Options of a command that takes a sequence."""
    return {
        "images": images,
        "calibration": images.parent / "lens.json",
        "target": images.parent / "target.json",
    } | others


def told(capsys: pytest.CaptureFixture[str], command: str, **options: Any) -> str:
    """The line that the command says, of those options, which must end with status 2."""
    assert main([command, *(f"--{name}={value}" for name, value in options.items())]) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"python -m activeslam_gym {command}: ") and said.count("\n") == 1 and len(said) < 400, said
    return said


@pytest.mark.parametrize("kind", GOOD)
def test_a_number_of_400_digits_is_named(kind: str) -> None:
    check = calibration_from if kind == "calibration" else target_from
    check(GOOD[kind])
    for name in GOOD[kind]:
        for value in WRONG:
            if name == "corners_px":
                value = {**GOOD[kind][name], "top_left": [value, 2]}
            with pytest.raises(ValueError, match=f"{name}|the board has") as error:
                check({**GOOD[kind], name: value})
            assert "\n" not in str(error.value) and len(str(error.value)) < 250, str(error.value)


@pytest.mark.parametrize("role", ["calibration", "target"])
def test_nested_and_broken_json_is_a_line(role: str, images: Path, capsys: Any) -> None:
    path = images.parent / "broken.json"
    for text, said in {
        "[" * 100_000: "nested",
        '{"kind": ' + "[" * 400 + "]" * 400 + "}": "kind",
        '{"a": ' * 100_000: "nested",
        '{"kind": ' + "9" * 5000 + "}": "digits",
        '{"kind": "circle", "a\\nb": 1}': "",
        "\xff": "UTF-8",
        "\0": "JSON",
        "": "JSON",
    }.items():
        path.write_bytes(text.encode("latin-1"))
        line = told(capsys, "track", out=images.parent / "out", **files_of(images, **{role: path}))
        assert "broken.json" in line and (said in line or role == "calibration" and "lacks" in line)


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="the memory is bounded as Linux does it")
@pytest.mark.parametrize("role", ["calibration", "target"])
def test_an_endless_file_is_read_no_further_than_needed(role: str, images: Path, capsys: Any) -> None:
    import resource

    before = resource.getrlimit(resource.RLIMIT_AS)
    held = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (held + 2**30, before[1]))  # so that a reader without end fails soon
    try:
        line = told(capsys, "track", out=images.parent / "out", **files_of(images, **{role: "/dev/zero"}))
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)
    assert "/dev/zero" in line


def test_a_huge_board_is_refused(images: Path, capsys: Any) -> None:
    chessboards = [(2**31, 3), (3, HUGE), (100_000, 100_000)]
    boards = [("chessboard", *size) for size in chessboards]
    for kind, columns, rows in (*boards, ("charuco", 2**31, 3), ("charuco", 1000, 1000), ("charuco", 11, 10)):
        board = {"kind": kind, "columns": columns, "rows": rows}
        line = told(capsys, "calibrate", images=images, out=images.parent / "lens.json", **board)
        assert "board" in line and f"{columns}"[:3] in line


def test_a_picture_of_terapixels_is_a_line(images: Path, capsys: Any) -> None:
    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = chunk(b"IHDR", struct.pack(">IIBBBBB", 10**6, 10**6, 8, 0, 0, 0, 0))
    (images / "0.png").write_bytes(b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", zlib.compress(b"\0" * 100)))
    line = told(capsys, "calibrate", images=images, out=images.parent / "lens.json", columns=7, rows=5)
    assert "0.png cannot be read as a picture" in line
