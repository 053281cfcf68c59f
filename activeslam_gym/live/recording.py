"""A live run on disk, written image by image, so that no way of ending loses images.

A folder holds ``images/`` (PNG, by number) and ``states.jsonl`` (a state a line). Beside them stand ``frames.csv`` and
``trajectory.tum``, which grow as those of `track` do, and ``map.csv``, which is written at the end and on demand.
"""

import json
from contextlib import ExitStack
from pathlib import Path

from activeslam_gym.files import Lines, demand_writable
from activeslam_gym.live.state import About, Standing, State, plain
from activeslam_gym.vision.film import film_to
from activeslam_gym.vision.opencv import opencv
from activeslam_gym.vision.outcome import FrameLog
from activeslam_gym.vision.track_files import TrackFiles

STATES = "states.jsonl"
_FAST = 1
"""PNG's compression, of 0 … 9."""


def check_folder(folder: Path) -> None:
    """Check that a recording can start in ``folder``, which need not exist.

    Raises:
        OSError: it holds a recording already, or cannot be written to.
    """
    demand_writable(folder)
    if (folder / STATES).exists():
        raise OSError(f"{folder} holds a live recording already; choose another folder")


class Recording:
    """Writes a run into ``folder``, which it makes, and with ``film`` film.mp4, which is there once it is closed.

    Raises:
        OSError: it cannot be written to, or holds a recording already.
        ModuleNotFoundError: OpenCV is not installed.
    """

    def __init__(self, folder: str | Path, about: About, film: bool = False) -> None:
        self.folder = Path(folder)
        self._cv2 = opencv()
        check_folder(self.folder)
        (self.folder / "images").mkdir(parents=True, exist_ok=True)
        self._states, self._track = Lines(self.folder / STATES), TrackFiles(self.folder, metric=True)
        self._last: State | None = None
        self._count, self._at_close = 0, ExitStack()
        room = about.room_size if about.person else None
        to = self.folder / "film.mp4"
        self._film = self._at_close.enter_context(film_to(to, about.rate, room)) if film else None

    def add(self, state: State, log: FrameLog | None) -> None:
        """Write a state, its image, and the ``log`` of the image where there is one.

        Raises:
            OSError: the disk is full, or gone.
        """
        if state.standing == Standing.OVER:
            return
        path = self.folder / "images" / f"{self._count:06d}.png"
        if not self._cv2.imwrite(str(path), state.image, [self._cv2.IMWRITE_PNG_COMPRESSION, _FAST]):
            raise OSError(f"{path} cannot be written")
        self._states.write(json.dumps(plain(state)) + "\n")
        if state.standing != Standing.WAITING:
            self._track.add(state.time, state.camera, log)
            self._last = state
            if self._film is not None:
                self._film(state.moment)
        self._count += 1

    def save(self) -> None:
        """Write the present map."""
        if self._last is not None:
            self._track.save(self._last.ids, self._last.points, self._last.stds)

    def close(self) -> None:
        """Write the map and finish."""
        self.save()
        self._states.close()
        self._track.close()
        self._at_close.close()
