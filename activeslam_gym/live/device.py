"""The camera of the device that shows the page: a source of images, the script that asks for it, and its socket."""

import asyncio
import json
import math
import struct
import time
from contextlib import suppress
from html import escape
from pathlib import Path
from queue import Empty, Full, Queue
from typing import Any

import numpy as np

from activeslam_gym.files import argument, demand_writable_file, written_whole
from activeslam_gym.live.source import GuidanceError, RealCamera
from activeslam_gym.vision.board import BOARD, BoardCalibration, View, find_board, sheet, way_between
from activeslam_gym.vision.calibration import Calibration
from activeslam_gym.vision.frontend import FrontEnd
from activeslam_gym.vision.opencv import opencv
from activeslam_gym.vision.other_lenses import Straighten, lens_from
from activeslam_gym.vision.sources import Frame
from activeslam_gym.vision.target import read_target

BROWSER = "browser"
"""The name of this source."""
_ROUGHLY: tuple[Calibration, Straighten] = (Calibration(640, 480, 520.0, 319.5, 239.5, 0.0), Straighten())
"""A lens until the true one is known."""
_REST, _AT_REST = 2.0, 0.01
"""Time for which a board that was waved must rest [s], after the words are read; and way of its corners, in widths."""
_NAP = 0.005
"""Time between two looks whether the tracker has taken an image [s]."""


class Device(RealCamera):
    """A device's camera before a known ``target``, of about ``rate`` images a second [Hz].

    Without a ``calibration`` it is calibrated first, by waving the board of `board_calibration`, and the lens is
    written to ``unknown``, or lens.json. Without a ``target`` that board is it, as soon as it rests. ``kept``: the
    folder of a recording.

    Raises:
        ValueError, OSError: a file or the rate is bad.
    """

    is_camera, name = True, "the device's camera"

    def __init__(
        self,
        calibration: str | Path | None,
        target: str | Path | None,
        rate: float,
        unknown: str | Path | None = None,
        camera: str | None = None,
        kept: str | None = None,
    ) -> None:
        self._images: Queue[tuple[Any, Frame]] = Queue(1)  # and the connections that they came over
        self._frame: Frame | None = None
        self._filmed: Any = None  # the connection of the last image
        self._filming: Any = None
        self._newest = -math.inf  # time of an image from any connection
        self._kept = "They are not kept." if kept is None else f"They are kept there, with the trajectory, in {kept}."
        self._board_calibration = BoardCalibration() if calibration is None else None
        self._calibrates = "Calibration"
        self._waved = calibration is None and target is None
        self._rest: tuple[float, View] | None = None  # since when, and where the board is
        self._time = 0.0  # of the last image
        self._file = Path(unknown or "lens.json")
        if calibration is None:
            with argument("calibrate"):
                demand_writable_file(self._file)
        lens, straighten = _ROUGHLY if calibration is None else lens_from(calibration, camera)
        super().__init__(lens, straighten, BOARD if target is None else read_target(target, straighten.pixels), rate)
        self._warm_up()

    # The source -------------------------------------------------------------------------------------------------------

    @property
    def calibrating(self) -> bool:
        """Whether the lens is still unknown."""
        return self._board_calibration is not None

    def restart(self) -> None:
        """Start again, without the views of a calibration; the device goes on."""
        if self._board_calibration is not None:
            self._board_calibration, self._calibrates = BoardCalibration(), "Calibration from the start"

    def wait(self, seconds: float) -> bool:
        """Whether an image comes within so many ``seconds``."""
        if self._frame is None:
            try:
                connection, self._frame = self._images.get(timeout=seconds)
            except Empty:
                return False
            if self._filmed not in (None, connection):
                self.restart()  # another device may have another lens
            self._filmed = connection
        return True

    def next(self) -> Frame:
        """The next image.

        Raises:
            GuidanceError: it is of another size than the calibration.
        """
        while not self.wait(1.0):
            pass
        assert self._frame
        frame, self._frame = self._frame, None
        self._time = frame[0]
        try:
            return frame if self.calibrating else self._mapped(frame)
        except ValueError as error:
            turned = frame[1].shape == self._calibration[:2]
            way = "Turn the device" if turned else "Film with the calibrated camera, or calibrate this one"
            raise GuidanceError(f"{way}: {error}.") from None

    def start(self, image: np.ndarray) -> FrontEnd:
        """A front end that has seen the first ``image``.

        Raises:
            GuidanceError: it is being calibrated, or the board is still waved.
            ValueError: the image does not show the target.
        """
        if self._board_calibration is not None:
            self._calibrate(self._board_calibration, image)
        if self._waved:
            self._await_rest(image)
        return super().start(image)

    def _calibrate(self, views: BoardCalibration, image: np.ndarray) -> None:
        """Take in an ``image`` (h, w) of the board. Raises GuidanceError: the lens is not known yet."""
        words = views.add(image)
        if views.fit is None:
            raise GuidanceError(f"{self._calibrates}: {words}")
        self._see_through(views.fit.calibration)
        self._board_calibration = None
        with written_whole(self._file) as unfinished:
            unfinished.write_text(json.dumps(self._calibration._asdict(), indent=1) + "\n")

    def _await_rest(self, image: np.ndarray) -> None:
        """Raises GuidanceError: the board in the ``image`` (h, w) does not rest yet."""
        view = find_board(image, BOARD.kind, BOARD.columns, BOARD.rows)
        if view is None:
            self._rest = None
        elif self._rest is None or way_between(self._rest[1], view) > _AT_REST * image.shape[1]:
            self._rest = self._time, view
        if self._rest is None or self._time - self._rest[0] < _REST:
            raise GuidanceError("Calibrated. Put the board down in view of the camera, and let both rest.")
        self._waved = False

    # Its parts of the page --------------------------------------------------------------------------------------------

    @property
    def head(self) -> bytes:
        """What the page's head holds for it."""
        (width, height), board = self._calibration[:2], self.calibrating or ""
        data = f'data-width="{width}" data-height="{height}" data-board="{board}" data-kept="{escape(self._kept)}"'
        return f'<script src="device.js" {data}></script>'.encode()

    @property
    def files(self) -> dict[str, tuple[str, bytes]]:
        """Types and contents of the files that the page needs, by their paths."""
        script = Path(__file__).with_name("device.js").read_bytes()
        return {"/device.js": ("text/javascript; charset=utf-8", script), "/board.svg": ("image/svg+xml", sheet())}

    async def take(self, connection: Any) -> None:
        """Take images over the websocket ``connection``, each with its time, until the device leaves, or until another
        one films; the next one is asked for when there is room."""
        from websockets.exceptions import ConnectionClosed
        from websockets.protocol import OPEN

        before, self._filming, zero = self._filming, connection, None
        if before is not None:  # which may have left long ago: its answer is not awaited
            self._closing = asyncio.create_task(before.close(1000, "Another device films now."))
        try:
            async for message in connection:
                try:
                    seconds, image = _unpacked(message, max(self._calibration[:2]))
                except ValueError as error:
                    await connection.close(1003, str(error))
                    return
                if zero is None:
                    zero = max(time.monotonic(), self._newest + 1.0 / self._rate) - seconds
                while zero + seconds > self._newest and self._filming is connection and connection.state == OPEN:
                    try:
                        self._images.put_nowait((connection, (zero + seconds, image)))
                        self._newest = zero + seconds
                    except Full:
                        await asyncio.sleep(_NAP)
                await connection.send("next")
        except ConnectionClosed:
            pass


def _unpacked(message: Any, side: int) -> tuple[float, np.ndarray]:
    """The time [s] and grey image (h, w) uint8 of a ``message``. Raises ValueError: it holds none, or has more bytes
    than a colour image of ``side`` x ``side`` pixels."""
    if len(message) > (most := 3 * side**2):
        raise ValueError(f"The image has {len(message)} bytes; at most {most} are taken.")
    cv2, seconds, image = opencv(), math.nan, None
    if isinstance(message, bytes) and len(message) > 8:
        (seconds,) = struct.unpack_from("<d", message)
        with suppress(cv2.error):
            image = cv2.imdecode(np.frombuffer(message, np.uint8, offset=8), cv2.IMREAD_GRAYSCALE)
    if image is None or not math.isfinite(seconds):
        raise ValueError("What was sent is no image.")
    return seconds, image
