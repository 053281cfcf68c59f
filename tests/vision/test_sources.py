"""Images and their times are read as people have them: lists, names, tags of orientation, videos of variable rate."""

import json
from fractions import Fraction
from pathlib import Path

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


@pytest.mark.parametrize(
    "names", [[f"shot{k}" for k in range(12)], [f"cam0.{k}" for k in range(12)], ["0.05", "0.125", "0.5", "10.25"]]
)
def test_numbers_in_names_are_ordered_as_numbers(names: list[str], tmp_path) -> None:
    pictures(tmp_path / "a", [f"{name}.png" for name in names])
    assert seen(images_of(tmp_path / "a", 30.0).frames) == list(range(len(names)))


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
    (tmp_path / "times.txt").write_text(LISTS["times.txt"])
    assert seen(images_of(tmp_path / name, times=tmp_path / "times.txt").frames) == [0, 1, 2, 3]
    assert images_of(tmp_path / name, 30.0).rate == pytest.approx(20.0)
    assert "20.00 images a second by its times, and --rate is 30: the times are used" in capsys.readouterr().err


@pytest.mark.parametrize("numbers", ["1 2 4 5", "0 2 4 6"])
def test_numbers_of_images_are_not_taken_for_times_in_silence(numbers: str, tmp_path, capsys) -> None:
    (tmp_path / "times.txt").write_text("\n".join(numbers.split()))
    pictures(tmp_path / "a", [f"{k}.png" for k in range(4)])
    images_of(tmp_path / "a", times=tmp_path / "times.txt")
    assert "if they are numbers of images" in capsys.readouterr().err
    images_of(pictures(tmp_path / "b", [f"{2611301200 + int(k)}.png" for k in numbers.split()])[0].parent)
    assert "by the times in their names; if they are numbers of images" in capsys.readouterr().err


BAD_LISTS = {
    "1\n2\n2\n4\n": "time 3 does",
    "1\n2\n3\n": "3 times.* 4 images",
    "0\n50000000\n100000000\n150000000\n": "in ns since",
    "0.1 1 2 3 0 0 0 1\n": "line 1",
    "1 3.png\n2\n3\n4\n": "in some lines",
}


@pytest.mark.parametrize("text", BAD_LISTS)
def test_a_bad_list_is_refused(text: str, tmp_path) -> None:
    (tmp_path / "times.txt").write_text(text)
    pictures(tmp_path / "a", [f"{k}.png" for k in range(4)])
    with pytest.raises(ValueError, match=BAD_LISTS[text]):
        images_of(tmp_path / "a", times=tmp_path / "times.txt")


def test_pictures_that_are_not_one_sequence_are_refused(tmp_path) -> None:
    pictures(tmp_path / "a", ["0.png", "0.jpg"])
    with pytest.raises(ValueError, match="several endings"):
        images_of(tmp_path / "a")
    pictures(tmp_path / "c", ["1.9.png", "1.10.png"])
    with pytest.raises(ValueError, match="as many digits in all"):
        images_of(tmp_path / "c")
    pictures(tmp_path / "b", ["0.png"])
    (tmp_path / "times.txt").write_text("1 b/0.png\n2 b/1.png\n")
    with pytest.raises(ValueError, match="no 'b/1.png'"):
        images_of(tmp_path / "times.txt")


def test_times_follow_the_numbers_in_names_where_some_are_missing(tmp_path, capsys) -> None:
    for name, step in (("each", 1), ("tenth", 10)):
        pictures(tmp_path / name, [f"cam0_{step * k:04}.png" for k in (3, 4, 7, 8, 9)])
        assert [time for time, _ in images_of(tmp_path / name, 10.0).frames] == [0.0, 0.1, 0.4, 0.5, 0.6]
        assert "of the numbers in the pictures' names 2 are missing" in capsys.readouterr().err
    others = ["a3 a4 a5", "cam0_3 cam1_4 cam1_6", "3.25 3.5 4.5", "33 67 100", "a1 b2 b4"]
    for folder, names in enumerate(others):
        pictures(tmp_path / str(folder), [f"{name}.png" for name in names.split()])
        assert [time for time, _ in images_of(tmp_path / str(folder), 10.0).frames] == [0.0, 0.1, 0.2]
        assert "missing" not in capsys.readouterr().err


def test_times_in_names_are_used_unless_a_rate_is_given(tmp_path, capsys) -> None:
    pictures(tmp_path / "euroc", [f"{START + k * 50000000}.png" for k in range(4)])
    pictures(tmp_path / "tum", [f"{1305031102.175304 + k / 20:.6f}.png" for k in range(4)])
    for name in ("euroc", "tum"):
        assert images_of(tmp_path / name).rate == pytest.approx(20.0, rel=1e-4)
        assert "20.00 images a second, by the times in their names" in capsys.readouterr().err
        assert [time for time, _ in images_of(tmp_path / name, 10.0).frames] == [0.0, 0.1, 0.2, 0.3]
        assert "20.00 images a second by its times, and --rate is 10: --rate is used" in capsys.readouterr().err
    assert images_of(pictures(tmp_path / "numbered", ["1.png"])[0].parent).rate == 30.0
    assert "30 images a second are assumed; --rate or --times" in capsys.readouterr().err
    rare = pictures(tmp_path / "rare", [f"{1305031102 + 10 * k}.png" for k in range(4)])[0].parent
    for found in (images_of(rare, 10.0), images_of(rare, timed=False)):
        assert seen(found.frames) == [0, 1, 2, 3]
    with pytest.raises(ValueError, match="0.1 images a second"):
        images_of(rare)


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
    Image.fromarray(np.zeros((24, 32), np.uint8)).save(tmp_path / "a/1.tif", tiffinfo={0x0112: 6})
    with pytest.raises(SourceError, match="TIFF with Orientation 6"):
        list(images_of(tmp_path / "a").frames)


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


@pytest.mark.parametrize("stated", [True, False])
@pytest.mark.parametrize("stamps", [[500, 520, 540, 580, 620], [0, 65, 66, 131, 132]])
def test_a_video_has_its_own_times(stamps: list[int], stated: bool, tmp_path, capsys) -> None:
    path = video(tmp_path / "a.mkv", stamps)
    if not stated:  # the default duration of an image, four bytes, becomes void
        path.write_bytes(path.read_bytes().replace(b"\x23\xe3\x83\x84", b"\xec\x86\0\0"))
    frames = list(images_of(path).frames)
    np.testing.assert_allclose([time for time, _ in frames], 1e-3 * (np.array(stamps) - stamps[0]), atol=1e-9)
    assert seen(frames) == [0, 5, 10, 15, 20] and capsys.readouterr().err == ""
    assert [time for time, _ in images_of(path, 10.0).frames] == [0.0, 0.1, 0.2, 0.3, 0.4]
    assert "--rate is 10" in capsys.readouterr().err


def test_a_video_that_is_cut_off_is_read_to_its_end(tmp_path, capsys) -> None:
    path = video(tmp_path / "a.mkv", [40 * k for k in range(200)])
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    assert 20 < len(list(images_of(path).frames)) < 180
    assert "is its end cut off?" in capsys.readouterr().err


BOARD = {"kind": "charuco", "columns": 7, "rows": 5, "square": 0.03, "marker": 0.02, "dictionary": "4x4_50"}
GOOD = {"images": "good", "calibration": "lens.json", "target": "target.json", "rate": "30", "out": "out"}
PICTURES = {"images": "good", "columns": "9", "rows": "6", "out": "lens.out"}


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with one good sequence and many bad files."""
    home, image = tmp_path_factory.mktemp("bad"), image_from(path(1)[0], target=True, samples=2)
    folders = {"good": [image] * 3, "resized": [image, image[:200]], "deep": [image.astype(np.uint16)], "empty": []}
    for name, pictures in folders.items():
        (home / name).mkdir()
        for k, picture in enumerate(pictures):
            assert cv2.imwrite(str(home / name / f"{k}.png"), picture)
    for folder in ("hollow", "rare"):
        (home / folder).mkdir()
    for seconds in (0, 10):
        (home / "rare" / f"{1305031102 + seconds}.png").symlink_to(home / "good" / "0.png")
    changes = {"lens": {}, "nan": {"focal_px": float("nan")}, "other": {"image_width": 640, "distortion": 0.0}}
    texts = {f"{name}.json": json.dumps(LENS._asdict() | change) for name, change in changes.items()}
    texts |= {"twice.json": texts["lens.json"].replace("{", '{"focal_px": 200.0, ')}
    texts |= {"hollow/0.png": "", "words.json": "focal 195", "board.json": json.dumps(BOARD)}
    texts |= {"target.json": json.dumps(target_fields(path(1)[0]))}
    for name, text in texts.items():
        (home / name).write_text(text)
    writer = cv2.VideoWriter(str(home / "film.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 30.0, image.shape[::-1], True)
    for _ in range(5):
        writer.write(cv2.applyColorMap(image, cv2.COLORMAP_JET))
    writer.release()
    (home / "codec.avi").write_bytes((home / "film.avi").read_bytes().replace(b"MJPG", b"QQQQ"))
    return home


TABLE = [
    ("track", {"images": "codec.avi"}, "codec.avi cannot be read as a video"),
    ("track", {"images": "hollow"}, "hollow/0.png cannot be read as a picture"),
    ("track", {"images": "empty"}, "the folder empty holds no picture"),
    ("track", {"images": "none.mp4"}, "there is no none.mp4"),
    ("track", {"images": "no*.png"}, "nothing matches the pattern no*.png"),
    ("track", {"images": "deep"}, "8 bits a channel are needed"),
    ("calibrate", {"images": "resized"}, "1.png is of 320 x 200 pixels"),
    ("track", {"calibration": "other.json"}, "of images of 640 x 240 pixels, got 320 x 240"),
    ("track", {"calibration": "nan.json"}, "focal_px must be a finite number"),
    ("track", {"calibration": "twice.json"}, "focal_px is there twice"),
    ("track", {"calibration": "words.json"}, "words.json is no JSON"),
    ("track", {"calibration": "board.json"}, "board.json holds no lens"),
    ("track", {"calibration": "none.json"}, "No such file"),
    ("track", {"target": "lens.json"}, "lens.json lacks corners_px, height, kind, width"),
    ("track", {"target": "board.json"}, "shows 0 of the 24 corners"),
    ("track", {"times": "none.txt"}, "--times: none.txt: No such file"),
    ("track", {"rate": "0"}, "rate must be a positive number"),
    ("track", {"out": "lens.json"}, "'lens.json' is no folder to write to"),
    ("calibrate", {}, "was found in 0 pictures"),
    ("calibrate", {"images": "rare"}, "was found in 0 pictures"),
]
"""(command, options that are wrong, what is said)."""


@pytest.mark.parametrize(("command", "wrong", "said"), TABLE, ids=lambda value: str(value)[:40])
def test_a_bad_input_is_one_line(command, wrong, said, home, capfd, monkeypatch) -> None:
    monkeypatch.chdir(home)
    if wrong.get("images") == "codec.avi":
        pytest.importorskip("av", reason="PyAV is not installed")
    options = {**(GOOD if command == "track" else PICTURES), **wrong}
    try:
        status = main([command, *(f"--{name}={value}" for name, value in options.items())])
    except SystemExit as end:  # of the parser
        status = end.code
    lines = capfd.readouterr().err.splitlines(keepends=True)
    message = "".join(line for line in lines if "compiling kernels" not in line)  # where the first start compiles
    assert status == 2 and said in message and message.count("\n") == 1, message
    assert message.startswith(f"python -m activeslam_gym {command}: ") and len(message) < 300
