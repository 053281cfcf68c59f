"""Sources of images: a folder, a pattern, a list, a video, a live camera. Each is an iterator of `Frame`.

Pictures are as their sensor stored them, since the lens belongs to the sensor. A tag that asks a viewer to turn them is
followed only where the lens is of the turned size.
"""

import glob
import itertools
import math
import re
import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import suppress
from decimal import Decimal
from operator import length_hint
from pathlib import Path
from typing import NamedTuple

import numpy as np

from activeslam_gym.files import text_of
from activeslam_gym.vision.opencv import opencv

Frame = tuple[float, np.ndarray]
"""Time [s] and grey image (h, w) uint8."""
PICTURES = (".png", ".pgm", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".ppm", ".pnm", ".jp2")
"""Endings of the pictures that a folder is searched for."""
LISTS = (".txt", ".csv")
"""Endings of files with times, and names, of images."""
_LINE = re.compile(r"""([^\s,;]+)([\s,;]+"?(?P<name>.+?\.[a-zA-Z]\w+)(["\s,;].*)?)?""")  # of a list
_NUMBER = re.compile(r"((?<![^\W_])(?<!\.)\d+\.\d+(?!\.?\d)|\d+)")
"""A number in a name. It is a decimal number after no letter, and with one point: neither cam0.1 nor 2026.1.15."""
CAMERA = "camera:"
"""The name of a live camera begins with it; its number follows."""
USUAL_RATE = 30.0
"""Images a second [Hz] where nothing tells."""
_TURNS = {6: -1, 8: 1}  # quarter turns to the left of EXIF's Orientation
_CLOCK, _NEVER, _NANOSECONDS = 1e8, 1e11, 1e17  # a name over the first is a time [s]; over the last it is in ns
_RATES = 0.5, 1e4  # fewest and most images a second that times may mean [Hz]


class SourceError(ValueError):
    """Images are missing or are not as they should be. Those before have been handed out and stay valid."""


class Images(NamedTuple):
    """The images of a source, from time 0 on."""

    frames: Iterator[Frame]
    rate: float  # images a second [Hz]
    total: int | None  # of images, or about so many; None: unknown
    origin: float = 0.0  # time of the first image in the source's own clock [s]
    names: tuple[str, ...] = ()  # of the pictures, where they are files


class _Stored(NamedTuple):
    """An image as it is stored."""

    name: str
    time: float | None  # [s]
    pixels: np.ndarray  # (h, w) grey or (h, w, 3) red, green, blue
    tag: str = ""  # that asks to turn it
    turns: int = 0  # by so many quarters, to the left


def images_of(
    path: str | Path,
    rate: float | None = None,
    times: str | Path | None = None,
    size: tuple[int, int] | None = None,
    timed: bool = True,
) -> Images:
    """The images of the source ``path``: a folder, a pattern (``shots/*.png``), a list (TUM's rgb.txt, EuRoC's
    data.csv), a video, or the live camera ``camera:0``, in grey.

    Their times are those in the file ``times`` or the list, or ``rate`` [Hz] a second, or the video's own or those in
    the pictures' names, or `USUAL_RATE` a second. Where they need not be ``timed``, no times are read.
    The lens is of ``size`` (width, height) [px].

    Raises:
        SourceError: there is nothing there (said at once), or an image is unreadable or of another size than the
            first (said when it is reached).
        ValueError: ``rate`` is not positive and finite, or ``times`` is no list of times.
        ModuleNotFoundError: PyAV, for a video, or OpenCV is not installed.
    """
    if rate is not None and not 0.0 < rate < math.inf:
        raise ValueError(f"rate must be a positive number of images a second, got {rate!r}")
    if str(path).startswith(CAMERA):
        if times is not None:
            raise ValueError("times are for stored images; a live camera has its own")
        return Images(_begun(_live(str(path), size)), rate or USUAL_RATE, None)
    file, kind, own, files = Path(path), Path(path).suffix.lower(), None, list[Path]()
    rows, numbers = read_times(times or path) if times or kind in LISTS else [], _numbers_in([])
    stamps = [stamp for stamp, _ in rows] if timed else []
    if is_video := file.is_file() and kind not in LISTS + PICTURES:
        stored, own, count = _video(file)
    else:
        files = _picture_files(path, read_times(path) if times and kind in LISTS else rows)
        if times is not None:
            files, stamps = _at_times(files, rows, times)
        elif timed and not rows:
            stamps = _times_in([file.stem for file in files])
            numbers = numbers if stamps else _numbers_in(files)
            if rate is not None:  # which they give way to, with a word
                step = float(np.median(np.diff(stamps))) if len(stamps) > 1 else 0.0
                own, stamps = 1.0 / step if step > 0.0 else None, []
        stored, count = _pictures(files), len(files)
    if len(stamps) > 1:
        own = _rate_of(stamps, times or path)
    if rate and own and abs(rate / own - 1.0) > 0.02:
        used = "the times are used" if stamps else "--rate is used"
        print(f"{path} has {own:.2f} images a second by its times, and --rate is {rate:g}: {used}", file=sys.stderr)
    elif stamps and ((counted := own and own <= 1.0 and all(map(float.is_integer, stamps))) or not rows):
        say = f"{own or 0.0:.2f} images a second, by {'its times' if rows else 'the times in their names'}"
        say += "; if they are numbers of images, give the pictures and --rate instead" if counted else ""
        print(f"{times or path}: {say}", file=sys.stderr)
    elif timed and not (stamps or rate or own):
        print(f"{path}: {USUAL_RATE:g} images a second are assumed; --rate or --times gives others", file=sys.stderr)
    usual = (own or rate if stamps else rate or own) or USUAL_RATE
    numbered = (k / usual for k in numbers)
    clock = None if timed and is_video and not stamps and not rate else iter(stamps or numbered)
    names = tuple(file.name for file in files)
    return Images(_begun(_timed(stored, clock, size)), usual, count, stamps[0] if stamps else 0.0, names)


def _rate_of(stamps: list[float], source: str | Path) -> float:
    """Images a second [Hz] by their ``stamps`` [s] from a ``source``, the median. ValueError: they cannot be times."""
    steps = np.diff(stamps)
    if steps.min() <= 0.0:
        raise ValueError(f"{source}: times must increase, and time {steps.argmin() + 2} does not")
    rate = 1.0 / float(np.median(steps))
    if not _RATES[0] <= rate <= _RATES[1]:
        said = f"by these, {rate:.3g} images a second, and {_RATES[0]:g} to {_RATES[1]:g} are allowed"
        raise ValueError(f"{source}: times must be in s, or in ns since 1970; {said}")
    return rate


def read_times(path: str | Path) -> list[tuple[float, str]]:
    """Times [s] and names of images, a line each, as TUM's rgb.txt, EuRoC's data.csv (in ns) or bare times have them.

    Raises:
        OSError: it cannot be read.
        ValueError: a line does not begin with a time.
    """
    rows = list[tuple[float, str]]()
    for number, line in enumerate(text_of(path, 2**24).splitlines(), 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        try:
            parts = _LINE.fullmatch(line.strip()) or {1: "", "name": ""}
            rows.append((_seconds(float(parts[1])), (parts["name"] or "").replace("\\", "/")))
        except ValueError:
            form = "a time in s, or in ns since 1970, and may name a picture"
            raise ValueError(f"{path}: line {number} must have {form}, got {line[:60]!r}") from None
    if not rows or len({not name for _, name in rows}) > 1:
        raise ValueError(f"{path} names a picture in some lines only" if rows else f"{path} holds no time")
    return rows


def _seconds(time: float) -> float:
    """The time in seconds, which may be in nanoseconds; in milliseconds it is refused."""
    if not abs(time) < math.inf or _NEVER < time <= _NANOSECONDS:
        raise ValueError
    return 1e-9 * time if time > _NANOSECONDS else time


def _times_in(names: list[str]) -> list[float]:
    """The times in pictures' names, where all have one of TUM's or EuRoC's kind."""
    numbers = [float(name) for name in names if re.fullmatch(r"\d+(\.\d+)?", name)]
    clocks = [_seconds(x) for x in numbers if _CLOCK < x <= _NEVER or x > _NANOSECONDS]
    if len(clocks) < len(names) and max(numbers, default=0.0) > _NEVER:
        print("the pictures' names are not used as times: not all are in s, or in ns since 1970", file=sys.stderr)
    return clocks if len(clocks) == len(names) else []


def _numbers_in(files: list[Path]) -> Iterator[int]:
    """0, 1, 2 ... of ``files``, and with gaps where their names differ in one whole number alone, which has gaps."""
    parts = [_NUMBER.split(str(file)) for file in files]
    columns = [column for column in zip(*parts) if len({*column}) > 1] if len({*map(len, parts)}) == 1 else []
    if len(columns) != 1 or not all(map(str.isdecimal, columns[0])):
        return itertools.count()
    steps = [int(after) - int(before) for before, after in itertools.pairwise(columns[0])]
    usual = max(sorted({*steps}), key=steps.count)
    if min(steps) == max(steps) or min(steps) < 1 or any(step % usual for step in steps):
        return itertools.count()
    missing = sum(steps) // usual - len(steps)
    print(f"of the numbers in the pictures' names {missing} are missing; times follow the numbers", file=sys.stderr)
    return itertools.accumulate((step // usual for step in steps), initial=0)


def _at_times(files: list[Path], rows: list[tuple[float, str]], times: str | Path) -> tuple[list[Path], list[float]]:
    """The ``files`` that are named in the ``rows`` of ``times``, or all, and their times."""
    if all(name for _, name in rows):
        known, count = {file.name: file for file in files}, len(files)
        named, rows = len(rows), [(stamp, Path(name).name) for stamp, name in rows if Path(name).name in known]
        if 0 < len(rows) < named:
            print(f"{named - len(rows)} of {named} pictures that {times} names are missing", file=sys.stderr)
        if 0 < len(rows) < len(files):
            print(f"{times} names {len(rows)} of {len(files)} images, which are used", file=sys.stderr)
        files = [known[name] for _, name in rows]
        if not rows or len(known) < count:
            raise ValueError(f"{times} must name pictures of different names, and names {len(rows)} of {count} images")
    if len(rows) != len(files):
        raise ValueError(f"{times} has {len(rows)} times, and there are {len(files)} images")
    return files, [stamp for stamp, _ in rows]


def _picture_files(path: str | Path, rows: list[tuple[float, str]]) -> list[Path]:
    """The pictures in a folder, of a pattern, or in the ``rows`` of a list; a SourceError: there are none."""
    folder = Path(path)
    if folder.is_file() and folder.suffix.lower() in LISTS:
        beside = ((folder.parent / name, folder.parent / "data" / name) for _, name in rows)
        files = [near if near.is_file() else inside for near, inside in beside]
        if gone := [name for (_, name), file in zip(rows, files) if not file.is_file()]:
            raise SourceError(f"{path} must name pictures beside it, or in data/; there is no {gone[0]!r}")
        return files
    if folder.is_file():
        return [folder]
    if folder.is_dir():
        shown = _shown(folder.iterdir())
        files = [file for file in shown if file.suffix.lower() in PICTURES]
        if files and (others := sorted({file.suffix for file in shown if file not in files})):
            print(f"{path}: left out: files that end with {', '.join(others)}", file=sys.stderr)
        nothing = f"the folder {path} holds no picture ({', '.join(PICTURES)})"
    else:
        files, nothing = _shown(map(Path, glob.glob(str(path)))), f"nothing matches the pattern {path}"
        if not glob.has_magic(str(path)):
            nothing = f"there is no {path}; allowed: a folder, a pattern, a list, a video, or {CAMERA}0"
    if not files:
        raise SourceError(nothing)
    if len({file.with_suffix("") for file in files}) < len(files):
        raise SourceError(f"{path} holds pictures with one name and several endings: choose one, as '{path}/*.png'")
    return files


def _shown(paths: Iterable[Path]) -> list[Path]:
    """The files among ``paths`` that are not hidden, in the order of their numbers: 2 before 10, 0.25 before 0.5. A
    SourceError, where 1.9 and 1.10 may be either."""
    shown = [path for path in paths if not path.name.startswith(".") and not path.is_dir()]
    numbers = [part for path in shown if path.suffix.lower() in PICTURES for part in _NUMBER.findall(path.name)]
    fractions = [number.partition(".")[2] for number in numbers if "." in number]
    if len({*map(len, fractions)}) > 1 and any(re.fullmatch(r"\d+0", fraction) for fraction in fractions):
        raise SourceError("decimal numbers in the names of pictures need as many digits in all, or end with no zero")
    return sorted(shown, key=lambda path: [Decimal(x) if k % 2 else x for k, x in enumerate(_NUMBER.split(str(path)))])


def _begun(frames: Iterator[Frame]) -> Iterator[Frame]:
    """The same, so that errors of the first come at once."""
    return itertools.chain([next(frames)], frames)


def _timed(images: Iterator[_Stored], clock: Iterator[float] | None, size: tuple[int, int] | None) -> Iterator[Frame]:
    """The images with their times, from 0 on, by the ``clock`` or their own; each grey and of the first one's size."""
    shape, first, last, reported = None, 0.0, -math.inf, {""}
    for name, own, pixels, tag, turns in images:
        if turns and size not in (None, pixels.shape[1::-1]) and size == pixels.shape[:2]:
            pixels = np.rot90(pixels, turns)
        elif tag not in reported:
            reported.add(tag)
            print(f"{name}: its {tag} is not followed: the lens is of the picture as it is stored", file=sys.stderr)
        grey, stamp = _grey(pixels), own if clock is None else next(clock, None)
        if shape is None:
            shape, first = grey.shape, stamp or 0.0
        if grey.shape != shape:
            now, then = (f"{w} x {h}" for h, w in (grey.shape, shape))
            raise SourceError(f"{name} is of {now} pixels, the first image of {then}")
        if stamp is None or stamp <= last:
            raise SourceError(f"{name} has no time after that of the image before: give --rate, or more --times")
        last = stamp
        yield stamp - first, grey
    if clock and (left := length_hint(clock)):
        print(f"{left} times are left over after the last image: are they of these images?", file=sys.stderr)


def _grey(pixels: np.ndarray) -> np.ndarray:
    """(h, w) uint8: of colours the luminance, and of three equal channels their value."""
    pixels = np.ascontiguousarray(pixels)
    return pixels if pixels.ndim == 2 else opencv().cvtColor(pixels, opencv().COLOR_RGB2GRAY)


def _pictures(files: list[Path]) -> Iterator[_Stored]:
    from PIL import Image

    for file in files:
        try:
            with Image.open(file) as image:
                kind, pages = image.mode, getattr(image, "n_frames", 1) if image.format != "MPO" else 1
                tag, is_tiff = image.getexif().get(0x0112, 1), image.format == "TIFF"
                pixels = np.array(image.convert("L" if kind in ("1", "L", "LA", "La") else "RGB"))
        except (OSError, SyntaxError, ValueError, Image.DecompressionBombError):
            raise SourceError(f"{file} cannot be read as a picture") from None
        if kind[0] in "IF":
            raise SourceError(f"{file} has {kind} pixels; 8 bits a channel are needed")
        if is_tiff and tag != 1:  # Pillow follows it, and not rightly
            raise SourceError(f"{file} is a TIFF with Orientation {tag}, which is not read: store it without that tag")
        if pages > 1:
            raise SourceError(f"{file} holds {pages} pages; one picture a file is needed")
        yield _Stored(file.name, None, pixels, f"EXIF Orientation {tag}" if tag != 1 else "", _TURNS.get(tag, 0))


def _video(path: Path) -> tuple[Iterator[_Stored], float | None, int | None]:
    """The images of a video with their times, its images a second, and about how many there are."""
    try:
        import av
    except ModuleNotFoundError:
        raise ModuleNotFoundError("PyAV is needed for videos: pip install av") from None
    try:
        container = av.open(str(path))
        stream = container.streams.video[0]
    except IndexError:
        raise SourceError(f"{path} holds no images") from None
    except (av.error.FFmpegError, OSError):
        why = "it is empty" if path.stat().st_size == 0 else "it is damaged, or its codec is unknown"
        raise SourceError(f"{path} cannot be read as a video: {why}") from None
    if container.format.name == "tty":  # FFmpeg would draw its letters
        raise SourceError(f"{path} is a text; a list of images ends with {' or '.join(LISTS)}")
    stream.thread_type = "AUTO"
    stated = float(stream.average_rate or 0.0) or None
    rate = stated or _rate_of_packets(path)
    length = float((stream.duration or 0) * (stream.time_base or 0)) or (container.duration or 0) / av.time_base

    def images() -> Iterator[_Stored]:
        count, last, damage = 0, 0.0, ""
        try:
            for count, frame in enumerate(container.decode(stream), 1):
                grey = frame.format.name.startswith("gray")
                pixels = frame.to_ndarray(format="gray" if grey else "rgb24")
                tag = f"rotation of {frame.rotation} degrees" if frame.rotation else ""
                name, stamp = f"image {count - 1} of {path.name}", frame.time
                if stamp is not None:
                    even = round(stamp * stated) / stated if stated else stamp
                    if last < even and abs(even - stamp) < 0.501 * float(frame.time_base or 0):
                        stamp = even  # its clock is coarse: Matroska's has milliseconds
                    last = stamp
                yield _Stored(name, stamp, pixels, tag, round(frame.rotation / 90) % 4)
        except av.error.FFmpegError as error:
            damage = f" ({error})"
        finally:
            container.close()
        if count == 0:
            raise SourceError(f"{path} cannot be read as a video: it is damaged, or its codec is unknown{damage}")
        if damage or (rate and last + 3.0 / rate < length):
            ending = f"{path} announces {length:.2f} s; its images end at {last:.2f} s{damage}"
            print(f"{ending}: is its end cut off?", file=sys.stderr)

    return images(), rate, stream.frames or (round(length * rate) if rate else 0) or None


def _rate_of_packets(path: Path) -> float | None:
    """Images a second by the times of the first images of a video whose container states no rate."""
    import av

    times = list[float]()
    with suppress(av.error.FFmpegError), av.open(str(path)) as container:  # where it is damaged, those before
        for packet in itertools.islice(container.demux(video=0), 200):
            times += [] if packet.pts is None else [float(packet.pts * packet.time_base)]
    return (len(times) - 1) / (max(times) - min(times)) if len({*times}) > 1 else None


def _live(name: str, size: tuple[int, int] | None) -> Iterator[Frame]:
    """The images of a live camera, of which that ``size`` is asked, until it stops."""
    cv2, number = opencv(), name.removeprefix(CAMERA)
    if not number.isdecimal():
        raise SourceError(f"a camera is camera:0, camera:1 and so on, got {name}")
    capture = cv2.VideoCapture(int(number))
    if not capture.isOpened():
        raise SourceError(f"{name} is not there or cannot be opened")
    for side, pixels in zip((cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT), size or ()):
        capture.set(side, pixels)
    began = time.monotonic()
    try:
        while (frame := capture.read())[0]:
            image = frame[1]
            yield time.monotonic() - began, image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        raise SourceError(f"{name} has stopped")
    finally:
        capture.release()
