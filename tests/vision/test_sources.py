"""Images and their times are read as people have them: lists, names, tags of orientation, videos of variable rate."""

import json
import os
import subprocess
import sys
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("cv2", reason="the extra `vision` is not installed")
Image = pytest.importorskip("PIL.Image", reason="the extra `vision` is not installed")
cv2 = pytest.importorskip("cv2", reason="the extra `vision` is not installed")

from activeslam_gym.__main__ import main
from activeslam_gym.vision.sources import SourceError, images_of
from tests.vision_scene import LENS, image_from, path, target_fields

START = 1403636579763555584


def pictures(folder: Path, names: list[str]) -> list[Path]:
    """Grey pictures of 32 x 24 pixels in a new ``folder``, of 0, 1, 2 ... in all of their pixels."""
    folder.mkdir(parents=True)
    for k, name in enumerate(names):
        Image.fromarray(np.full((24, 32), k, np.uint8)).save(folder / name)
    return [folder / name for name in names]


def seen(frames) -> list[int]:
    """The values of the pictures of `pictures`, in the order in which they come."""
    return [int(image[0, 0]) for _, image in frames]


def test_numbers_in_names_are_ordered_as_numbers(tmp_path) -> None:
    pictures(tmp_path / "a", [f"shot{k}.png" for k in range(12)])
    assert seen(images_of(tmp_path / "a", 30.0).frames) == list(range(12))


LISTS = {
    "rgb.txt": "# color images\n# timestamp filename\n" + "".join(f"{100 + 0.05 * k} rgb/{k}.png\n" for k in range(4)),
    "data.csv": "#timestamp [ns],filename\n" + "".join(f"{START + k * 50000000},{k}.png\r\n" for k in range(4)),
    "times.txt": "\ufeff100.0\n100.05\n\n100.1\n100.15\n",
    "quoted.txt": "".join(f'{100 + 0.05 * k}\t;"rgb\\{k}.png"\n' for k in range(4)),
}


@pytest.mark.parametrize("name", LISTS)
def test_times_are_read_from_a_list(name: str, tmp_path) -> None:
    (tmp_path / name).write_text(LISTS[name])
    pictures(tmp_path / "rgb", [f"{k}.png" for k in range(4)])
    found = images_of(tmp_path / "rgb", times=tmp_path / name)
    assert found.rate == pytest.approx(20.0) and found.origin == pytest.approx(START * 1e-9 if "csv" in name else 100.0)
    np.testing.assert_allclose([time for time, _ in found.frames], [0.0, 0.05, 0.1, 0.15], atol=1e-6)


@pytest.mark.parametrize(("name", "folder"), [("rgb.txt", "rgb"), ("data.csv", "data")])
def test_a_list_is_a_source(name: str, folder: str, tmp_path, capsys) -> None:
    (tmp_path / name).write_text(LISTS[name])
    pictures(tmp_path / folder, [f"{k}.png" for k in range(4)])
    found = images_of(tmp_path / name)
    assert found.rate == pytest.approx(20.0) and seen(found.frames) == [0, 1, 2, 3]
    images_of(tmp_path / name, 30.0)
    assert "20.00 images a second by its times, and --rate is 30" in capsys.readouterr().err


def test_a_list_chooses_and_says_so(tmp_path, capsys) -> None:
    (tmp_path / "some.txt").write_text("1.0 2.png\n2.0 gone.png\n3.0 0.png\n")
    pictures(tmp_path / "a", ["0.png", "1.png", "2.png"])
    assert seen(images_of(tmp_path / "a", times=tmp_path / "some.txt").frames) == [2, 0]
    told = capsys.readouterr().err
    assert "names 2 of 3 images" in told and "1 of 3 pictures that" in told


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("1\n2\n2\n4\n", "time 3 does"),
        ("1\n2\n3\n", "3 times.* 4 images"),
        *(
            ("1700000000000\n", "line 1"),
            ("0\n50000000\n100000000\n150000000\n", "in ns since"),
            ("a\n", "line 1"),
            ("inf\n", "line 1"),
            ("0,0\n0,1\n0,2\n0,3\n", "line 1 .* '0,0'"),
            ("0.1 1 2 3 0 0 0 1\n", "line 1"),
            ("0\n10\n20\n30\n", "0.1 images a second, and 0.5 to"),
            ("1 3.png\n2\n3\n4\n", "in some lines"),
            ("1 3.jpg\n2 2.jpg\n", "0 of 4 images"),
            ("", "no time"),
        ),
    ],
)
def test_a_bad_list_is_refused(text: str, word: str, tmp_path) -> None:
    (tmp_path / "times.txt").write_text(text)
    pictures(tmp_path / "a", [f"{k}.png" for k in range(4)])
    with pytest.raises(ValueError, match=word):
        images_of(tmp_path / "a", times=tmp_path / "times.txt")


@pytest.mark.parametrize(
    ("names", "images", "times", "word"),
    [
        (["0.png"], "times.txt", "1 a/0.png\n2 a/1.png\n", "no 'a/1.png'"),
        (["0.png"], "times.txt", "1\n2\n", "no ''"),
        (["0.png", "0.jpg"], "a", None, "several endings"),
        (["x/0.png", "y/0.png"], "a/*/*.png", "1 0.png\n2 0.png\n", "different names"),
    ],
)
def test_pictures_that_are_not_one_sequence_are_refused(names, images, times, word, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    for folder in {Path("a", name).parent for name in names}:
        pictures(folder, [name.split("/")[-1] for name in names if Path("a", name).parent == folder])
    if times:
        Path("times.txt").write_text(times)
    with pytest.raises(ValueError, match=word):
        images_of(images, times="times.txt" if times and images != "times.txt" else None)


def test_times_that_are_not_used_are_told(tmp_path, capsys) -> None:
    pictures(tmp_path / "a", [f"{START // 1000000 + k * 50}.png" for k in range(4)])
    assert images_of(tmp_path / "a").rate == 30.0 and "not used as times" in capsys.readouterr().err
    (tmp_path / "times.txt").write_text(LISTS["times.txt"])
    assert len(list(images_of(video(tmp_path / "b.mkv", [0, 50]), times=tmp_path / "times.txt").frames)) == 2
    assert "2 times are left over" in capsys.readouterr().err


def test_times_in_names_are_used_unless_a_rate_is_given(tmp_path, capsys) -> None:
    pictures(tmp_path / "euroc", [f"{START + k * 50000000}.png" for k in range(4)])
    pictures(tmp_path / "tum", [f"{1305031102.175304 + k / 20:.6f}.png" for k in range(4)])
    for name in ("euroc", "tum"):
        assert images_of(tmp_path / name).rate == pytest.approx(20.0, rel=1e-4)
        assert "20.00 images a second, by the times in their names" in capsys.readouterr().err
        assert [time for time, _ in images_of(tmp_path / name, 10.0).frames] == [0.0, 0.1, 0.2, 0.3]
        assert "20.00 images a second by its times, and --rate is 10" in capsys.readouterr().err


def test_a_tag_turns_only_what_the_lens_needs_turned(tmp_path, capsys) -> None:
    exif = Image.Exif()
    exif[0x0112] = 6
    (tmp_path / "a").mkdir()
    Image.fromarray(np.repeat(np.arange(24, dtype=np.uint8)[:, None], 32, axis=1)).save(tmp_path / "a/0.png", exif=exif)
    ((_, stored),) = images_of(tmp_path / "a", size=(32, 24)).frames
    assert stored.shape == (24, 32) and "EXIF Orientation 6 is not followed" in capsys.readouterr().err
    ((_, turned),) = images_of(tmp_path / "a", size=(24, 32)).frames
    assert turned.shape == (32, 24) and turned[0, 0] == 23 and turned[0, -1] == 0
    assert "Orientation" not in capsys.readouterr().err


def test_alpha_is_left_out_and_other_pixels_are_refused(tmp_path) -> None:
    grey = np.arange(24 * 32, dtype=np.uint16).reshape(24, 32).astype(np.uint8)
    (tmp_path / "a").mkdir()
    Image.merge("LA", [Image.fromarray(grey), Image.fromarray(255 - grey)]).save(tmp_path / "a/0.png")
    ((_, image),) = images_of(tmp_path / "a").frames
    np.testing.assert_array_equal(image, grey)
    (tmp_path / "b").mkdir()
    pages = [Image.fromarray(grey)] * 3
    pages[0].save(tmp_path / "b/0.tif", save_all=True, append_images=pages[1:])
    with pytest.raises(SourceError, match="3 pages"):
        images_of(tmp_path / "b")
    with pytest.raises(SourceError, match="pages"):
        images_of(tmp_path / "b/0.tif")


def video(path: Path, stamps: list[int]) -> Path:
    """A video of grey pictures of 0, 5, 10 ... at the ``stamps`` [ms]."""
    av = pytest.importorskip("av", reason="PyAV is not installed")
    with av.open(str(path), "w") as container:
        stream = container.add_stream("ffv1", rate=30)
        stream.width, stream.height, stream.pix_fmt = 32, 24, "gray"
        stream.codec_context.time_base = Fraction(1, 1000)
        for k, stamp in enumerate(stamps):
            frame = av.VideoFrame.from_ndarray(np.full((24, 32), 5 * k % 256, np.uint8), format="gray")
            frame.pts, frame.time_base = stamp, Fraction(1, 1000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def test_a_video_has_its_own_times(tmp_path, capsys) -> None:
    stamps = [500, 520, 540, 580, 620]
    path = video(tmp_path / "a.mkv", stamps)
    frames = list(images_of(path).frames)
    np.testing.assert_allclose([time for time, _ in frames], 1e-3 * (np.array(stamps) - 500.0), atol=1e-9)
    assert seen(frames) == [0, 5, 10, 15, 20] and capsys.readouterr().err == ""
    assert [time for time, _ in images_of(path, 10.0).frames] == [0.0, 0.1, 0.2, 0.3, 0.4]
    assert "--rate is 10" in capsys.readouterr().err


def test_a_video_that_is_cut_off_is_read_to_its_end(tmp_path, capsys) -> None:
    path = video(tmp_path / "a.mkv", [40 * k for k in range(200)])
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    assert 20 < len(list(images_of(path).frames)) < 180
    assert "is its end cut off?" in capsys.readouterr().err


# Images, calibrations and targets that cannot be used -----------------------------------------------------------------


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
    texts = {"hollow/0.png": "", "zero.mp4": "", "words.json": "focal 195", "list.json": "[1, 2]"}
    changes: dict[str, dict[str, Any]] = {
        "lens": {},
        "nan": {"focal_px": float("nan")},
        "negative": {"focal_px": -195.0},
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
    ("track", {"calibration": "infinite.json"}, "distortion 1 bends the image's corners beyond infinity; with this"),
    ("track", {"calibration": "list.json"}, "--calibration: list.json must hold a JSON object"),
    ("track", {"calibration": "words.json"}, "--calibration: words.json is no JSON"),
    (
        "track",
        {"calibration": "board.json"},
        "board.json holds no lens of OpenCV, ROS, Kalibr, ORB-SLAM or COLMAP: focal_px, ",
    ),
    ("track", {"calibration": "none.json"}, "--calibration: none.json: No such file or directory"),
    ("track", {"calibration": "locked.json"}, "--calibration: locked.json: Permission denied"),
    ("track", {"target": "lens.json"}, "--target: lens.json lacks corners_px, height, kind, width"),
    ("track", {"target": "flat.json"}, "--target: flat.json: width must be a positive number of metres, 1e-06 to"),
    ("track", {"target": "board.json"}, "shows 0 of the 24 corners of the target, a board of kind charuco; 6 or more"),
    ("track", {"rate": "0"}, "rate must be a positive number of images a second, got 0.0"),
    ("track", {"out": "lens.json"}, "--out: 'lens.json' is no folder to write to (Not a directory)"),
    ("calibrate", {"out": "good"}, "--out: good is a folder; allowed: a file"),
    ("calibrate", {"kind": "dots"}, "kind must be one of chessboard, charuco, got 'dots'"),
    ("calibrate", {"columns": "2"}, "the board must have 3 to 100 columns and rows, got 2 x 6"),
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
    message = "".join(line for line in lines if "compiling kernels" not in line)  # where the first start compiles
    assert status == 2 and said in message and message.count("\n") == 1, message
    assert message.startswith(f"python -m activeslam_gym {command}: ") and len(message) < 300


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
