"""A live run on disk, written image by image, so that no way of ending loses images; and its reader.

A folder with ``images/`` (PNG, by number), ``live.json`` (its `About`), ``states.jsonl`` (a state a line),
``frames.csv`` and ``trajectory.tum`` as `track` writes them, growing, and ``map.csv``, written at the end and when
asked.
"""

import json
from collections.abc import Iterator
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any, get_args

import numpy as np

from activeslam_gym.files import Lines, demand_writable, written_whole
from activeslam_gym.live.messages import About
from activeslam_gym.live.state import OVER, WAITING, State, plain, scalar, state_of
from activeslam_gym.vision.frontend import FrameLog
from activeslam_gym.vision.opencv import opencv
from activeslam_gym.vision.track import TrackFiles

ABOUT, STATES = "live.json", "states.jsonl"
_FAST = 1
"""PNG's compression, of 0 … 9."""
_LONGEST = 2**24
"""Greatest number of characters of a line, and of `live.json`."""
_RANGES = {"image_size": (1, 8192), "focal": (1e-3, 1e9), "rate": (1e-6, 1e6), "room_size": (1e-3, 1e6)}
"""Least and greatest numbers of an `About`."""


def check_folder(folder: Path) -> None:
    """Check that a recording can start in ``folder``, which need not exist.

    Raises:
        OSError: it holds a recording already, or cannot be written to.
    """
    demand_writable(folder)
    if (folder / STATES).exists():
        raise OSError(f"{folder} holds a live recording already; choose another folder")


class Recording:
    """Writes a run into ``folder``, which it makes.

    Raises:
        OSError: it cannot be written to, or holds a recording already.
        ModuleNotFoundError: OpenCV is not installed.
    """

    def __init__(self, folder: str | Path, about: About) -> None:
        self.folder = Path(folder)
        self._cv2 = opencv()
        check_folder(self.folder)
        (self.folder / "images").mkdir(parents=True, exist_ok=True)
        with written_whole(self.folder / ABOUT) as unfinished:
            unfinished.write_text(json.dumps(asdict(about), indent=1) + "\n")
        self._states, self._track = Lines(self.folder / STATES), TrackFiles(self.folder, metric=True)
        self._last: State | None = None
        self.count = 0
        """Images kept."""

    def add(self, state: State, log: FrameLog | None) -> None:
        """Write a state, its image, and the ``log`` of the image where there is one.

        Raises:
            OSError: the disk is full, or gone.
        """
        if state.standing == OVER:
            return
        path = self.folder / "images" / f"{self.count:06d}.png"
        if not self._cv2.imwrite(str(path), state.image, [self._cv2.IMWRITE_PNG_COMPRESSION, _FAST]):
            raise OSError(f"{path} cannot be written")
        self._states.write(json.dumps(plain(state)) + "\n")
        if state.standing != WAITING:
            self._track.add(state.time, state.camera, log)
            self._last = state
        self.count += 1

    def save(self) -> None:
        """Write the present map."""
        if self._last is not None:
            self._track.save(self._last.ids, self._last.points, self._last.stds)

    def close(self) -> None:
        """Write the map and finish."""
        self.save()
        self._states.close()
        self._track.close()


def read_about(folder: str | Path) -> About:
    """The `About` of a recording.

    Raises:
        OSError: there is none.
        ValueError: it is damaged.
    """
    path = Path(folder) / ABOUT
    if not path.is_file():
        raise FileNotFoundError(f"{folder} holds no live recording ({ABOUT} is missing)")
    kinds = {field.name: field.type for field in fields(About)}
    try:
        with path.open() as file:
            values = _object(file.read(_LONGEST))
        values = {name: _of_about(name, kinds[name], value) for name, value in values.items()}
        return About(**{**values, "replay": True})
    except (ValueError, TypeError, KeyError) as error:
        raise ValueError(f"{path} is damaged ({error})") from None


def _of_about(name: str, kind: Any, value: Any) -> Any:
    """The field ``name`` of an `About`, of ``kind``: a `scalar`, or a tuple of them."""
    many = get_args(kind)
    if many and not (isinstance(value, list) and len(value) == len(many)):
        raise ValueError(f"{name}: {value!r:.40}; allowed: a list of {len(many)} numbers")
    numbers = value if many else [value]
    made = tuple(scalar(name, one, number) for one, number in zip(many or (kind,), numbers))
    low, high = _RANGES.get(name, (None, None))
    if low is not None and not all(low <= number <= high for number in made):
        raise ValueError(f"{name}: {value!r:.40}; allowed: {low:g} to {high:g}")
    return made if many else made[0]


def read_states(folder: str | Path) -> Iterator[State]:
    """The states of a recording, one by one. A last line that was cut off is left out.

    Raises:
        OSError: there is no recording.
        ValueError: a line or an image is damaged.
    """
    cv2, home = opencv(), Path(folder)
    with (home / STATES).open(errors="replace") as lines:
        for k, line in enumerate(iter(lambda: lines.readline(_LONGEST), "")):
            if not line.endswith("\n") and len(line) < _LONGEST:
                return
            path = home / "images" / f"{k:06d}.png"
            image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
            if image is None:
                raise ValueError(f"{path} cannot be read as a picture")
            if image.ndim != 2 or image.dtype != np.uint8:
                raise ValueError(f"{path} is no 8-bit grey picture")
            try:
                state = state_of(_object(line), image)
            except ValueError as error:
                raise ValueError(f"line {k + 1} of {home / STATES} is damaged ({error})") from None
            yield state


def _object(text: str) -> dict[str, Any]:
    """The JSON object in ``text``."""
    try:
        value = json.loads(text)
    except RecursionError:
        raise ValueError("nested too deeply") from None
    if not isinstance(value, dict):
        raise ValueError("no JSON object")
    return value
