"""Images, calibrations and targets that cannot be used: each is one line that names the argument, and status 2."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

cv2 = pytest.importorskip("cv2", reason="the extra `vision` is not installed")

from activeslam_gym.__main__ import main  # noqa: E402
from tests.vision_scene import LENS, image_from, path, target_fields  # noqa: E402

BOARD = {"kind": "charuco", "columns": 7, "rows": 5, "square": 0.03, "marker": 0.02, "dictionary": "4x4_50"}
GOOD = {"images": "good", "calibration": "lens.json", "target": "target.json", "rate": "30", "out": "out"}
PICTURES = {"images": "good", "columns": "9", "rows": "6", "out": "lens.out"}


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with one good sequence and many bad files."""
    home, image = tmp_path_factory.mktemp("bad"), image_from(path(1)[0], target=True, samples=2)
    colour = cv2.applyColorMap(image, cv2.COLORMAP_JET)
    folders: dict[str, list[np.ndarray]] = {
        "good": [image] * 3,
        "resized": [image, image[:200]],
        "deep": [image.astype(np.uint16)],
        "dark": [image // 30],
        "bare": [np.full_like(image, 180)],
        "empty": [],
    }
    for name, pictures in folders.items():
        (home / name).mkdir()
        for k, picture in enumerate(pictures):
            assert cv2.imwrite(str(home / name / f"{k}.png"), picture)
    (home / "hollow").mkdir()
    texts = {"hollow/0.png": "", "zero.mp4": "", "zero.json": "", "words.json": "focal 195", "list.json": "[1, 2]"}
    changes: dict[str, dict[str, Any]] = {
        "lens": {},
        "nan": {"focal_px": float("nan")},
        "negative": {"focal_px": -195.0},
        "text": {"focal_px": "195"},
        "infinite": {"distortion": 1.0},
        "other": {"image_width": 640, "image_height": 480, "distortion": 0.0},
    }
    texts |= {f"{name}.json": json.dumps(LENS._asdict() | change) for name, change in changes.items()}
    target = target_fields(path(1)[0])
    texts |= {"target.json": json.dumps(target), "board.json": json.dumps(BOARD)}
    texts |= {"flat.json": json.dumps(target | {"width": -1}), "locked.json": json.dumps(LENS._asdict())}
    for name, text in texts.items():
        (home / name).write_text(text)
    (home / "locked.json").chmod(0)
    for name, code in (("film.avi", "MJPG"), ("film.mp4", "mp4v")):
        writer = cv2.VideoWriter(str(home / name), cv2.VideoWriter_fourcc(*code), 30.0, image.shape[::-1], True)
        for _ in range(5):
            writer.write(colour)
        writer.release()
    (home / "codec.avi").write_bytes((home / "film.avi").read_bytes().replace(b"MJPG", b"QQQQ"))
    (home / "cut.mp4").write_bytes((home / "film.mp4").read_bytes()[:-600])
    return home


TABLE = [
    ("track", {"images": "codec.avi"}, "--images: codec.avi cannot be read as a video: it is damaged, or its codec"),
    ("track", {"images": "cut.mp4"}, "--images: cut.mp4 cannot be read as a video: it is damaged"),
    ("track", {"images": "zero.mp4"}, "--images: zero.mp4 cannot be read as a video: it is empty"),
    ("track", {"images": "lens.json"}, "--images: lens.json cannot be read as a video"),
    ("track", {"images": "hollow"}, "--images: hollow/0.png cannot be read as a picture"),
    ("track", {"images": "empty"}, "--images: the folder empty holds no picture (.png, .pgm, "),
    (
        "track",
        {"images": "none.mp4"},
        "--images: there is no none.mp4; allowed: a folder, a pattern, a list, a video, or camera:0",
    ),
    ("track", {"images": "no*.png"}, "--images: nothing matches the pattern no*.png"),
    ("track", {"images": "camera:front"}, "--images: a camera is camera:0, camera:1 and so on, got camera:front"),
    ("track", {"images": "deep"}, "--images: deep/0.png has I;16 pixels; 8 bits a channel are needed"),
    ("track", {"images": "dark"}, "no edge of the target"),
    ("track", {"images": "bare"}, "the image has no corners (a blank wall, or blur)"),
    ("calibrate", {"images": "resized"}, "--images: 1.png is of 320 x 200 pixels, the first image of 320 x 240"),
    ("track", {"calibration": "other.json"}, "the calibration is of images of 640 x 480 pixels, got 320 x 240"),
    ("track", {"calibration": "nan.json"}, "--calibration: nan.json: focal_px must be a finite number, got nan"),
    ("track", {"calibration": "negative.json"}, "negative.json: focal_px must be a positive number, got -195.0"),
    ("track", {"calibration": "text.json"}, "--calibration: text.json: focal_px must be a finite number, got '195'"),
    ("track", {"calibration": "infinite.json"}, "distortion 1 bends the image's corners beyond infinity; with this"),
    ("track", {"calibration": "list.json"}, "--calibration: list.json must hold a JSON object"),
    ("track", {"calibration": "words.json"}, "--calibration: words.json is no JSON"),
    ("track", {"calibration": "zero.json"}, "--calibration: zero.json is no JSON"),
    ("track", {"calibration": "board.json"}, f"--calibration: board.json lacks {', '.join(sorted(LENS._fields))}"),
    ("track", {"calibration": "none.json"}, "--calibration: none.json: No such file or directory"),
    ("track", {"calibration": "good"}, "--calibration: good: Is a directory"),
    ("track", {"calibration": "locked.json"}, "--calibration: locked.json: Permission denied"),
    ("track", {"target": "lens.json"}, "--target: lens.json lacks corners_px, height, kind, width"),
    ("track", {"target": "flat.json"}, "--target: flat.json: width must be a positive number of metres, 1e-06 to"),
    ("track", {"target": "board.json"}, "shows 0 of the 24 corners of the target, a board of kind charuco; 6 or more"),
    ("track", {"rate": "0"}, "rate must be a positive number of images a second, got 0.0"),
    ("track", {"rate": "nan"}, "rate must be a positive number of images a second, got nan"),
    ("track", {"rate": "fast"}, "argument --rate: invalid float value: 'fast'"),
    ("track", {"out": "lens.json"}, "--out: 'lens.json' is no folder to write to (Not a directory)"),
    ("calibrate", {"out": "good"}, "--out: good is a folder; allowed: a file"),
    ("calibrate", {"out": "lens.json/lens.json"}, "is no folder to write to (Not a directory)"),
    ("calibrate", {"kind": "dots"}, "kind must be one of chessboard, charuco, got 'dots'"),
    ("calibrate", {"columns": "2"}, "the board must have 3 to 100 columns and rows, got 2 x 6"),
    ("calibrate", {"columns": "many"}, "argument --columns: invalid int value: 'many'"),
    ("calibrate", {}, "9 x 6 inner corners (one fewer than squares) was found in 0 pictures; 3 or more are needed\n"),
]
"""(command, options that are wrong, what is said)."""


@pytest.mark.parametrize(("command", "wrong", "said"), TABLE, ids=lambda value: str(value)[:40])
def test_a_bad_input_is_one_line(command, wrong, said, home, capsys, monkeypatch) -> None:
    monkeypatch.chdir(home)
    if wrong.get("calibration") == "locked.json" and os.access("locked.json", os.R_OK):
        pytest.skip("the superuser reads everything")
    if wrong.get("images") in ("codec.avi", "cut.mp4", "zero.mp4", "lens.json"):
        pytest.importorskip("av", reason="PyAV is not installed")
    options = {**(GOOD if command == "track" else PICTURES), **wrong}
    try:
        status = main([command, *(f"--{name}={value}" for name, value in options.items())])
    except SystemExit as end:  # of the parser
        status = end.code
    lines = capsys.readouterr().err.splitlines(keepends=True)
    told = "".join(line for line in lines if "compiling kernels" not in line)  # where the first start compiles
    assert status == 2 and said in told and told.count("\n") == 1, told
    assert told.startswith(f"python -m activeslam_gym {command}: ") and len(told) < 300


def test_images_before_another_size_are_kept(home, capsys, monkeypatch) -> None:
    monkeypatch.chdir(home)
    assert main(["track", *(f"--{name}={value}" for name, value in (GOOD | {"images": "resized"}).items())]) == 1
    assert "ended early: 1.png is of 320 x 200 pixels, the first image of 320 x 240\n" in capsys.readouterr().err


def test_ffmpeg_adds_no_lines_of_its_own(home) -> None:
    pytest.importorskip("av", reason="PyAV is not installed")
    line = [sys.executable, "-m", "activeslam_gym", "calibrate", "--images=codec.avi", "--columns=9", "--rows=6"]
    root = str(Path(__file__).resolve().parents[2])
    done = subprocess.run([*line, "--out=x"], cwd=home, env={**os.environ, "PYTHONPATH": root}, capture_output=True)
    assert done.returncode == 2 and done.stderr.count(b"\n") == 1, done.stderr
