"""The page's end of a device that films: the script that asks for its camera, and the socket that takes its images."""

import asyncio
import math
import struct
import time
from collections.abc import Callable
from html import escape
from pathlib import Path
from queue import Full
from typing import Any

import numpy as np

from activeslam_gym.vision.board_calibration import sheet
from activeslam_gym.vision.opencv import opencv

SIDE = 640
"""Longest side of the images that a device is asked for [px]."""
_LONGEST = 2**20
"""Most bytes of an image."""
_NAP = 0.005
"""Time between two looks whether the tracker has taken an image [s]."""


class Filming:
    """Hands the images of the device that films last on to a queue ``images`` of times [s] and images, and waits with
    the next one until there is room.

    Args:
        images: Of `multiprocessing`.
        kept: What is kept of the images, as the page says before it films.
        side: The longest side of the images [px].
        calibrates: Whether the page shows the board to be waved.
    """

    def __init__(self, images: Any, kept: str, side: int = SIDE, calibrates: bool = False) -> None:
        self._images, self._device = images, None
        data = f'data-side="{side}" data-board="{calibrates or ""}" data-kept="{escape(kept)}"'
        self.head = f'<script src="device.js" {data}></script>'.encode()
        """What the page's head holds for it."""

    @property
    def files(self) -> dict[str, tuple[str, bytes]]:
        """Types and contents of the files that the page needs, by their paths."""
        script = Path(__file__).with_name("device.js").read_bytes()
        return {"/device.js": ("text/javascript", script), "/board.svg": ("image/svg+xml", sheet())}

    @property
    def sockets(self) -> dict[str, Callable[[Any], Any]]:
        """Handlers of websockets by their paths."""
        return {"/device": self.take}

    async def take(self, connection: Any) -> None:
        """Take the images of a device until it leaves, or until another one films."""
        from websockets.exceptions import ConnectionClosed

        before, self._device = self._device, connection
        if before is not None:
            await before.close(1000, "Another device films now.")
        first, last = None, -math.inf
        try:
            async for message in connection:
                seconds, image = _unpacked(message)
                if image is None:
                    await connection.close(1003, "What was sent is no image.")
                    return
                first = first or time.monotonic() - seconds
                while seconds > last and self._device is connection:
                    try:
                        self._images.put_nowait((first + seconds, image))
                        last = seconds
                    except Full:
                        await asyncio.sleep(_NAP)
                await connection.send("next")
        except ConnectionClosed:
            pass


def _unpacked(message: Any) -> tuple[float, np.ndarray | None]:
    """The time [s] and the grey image (h, w) uint8 of a ``message``; None where it holds none."""
    if not isinstance(message, bytes) or not 8 < len(message) <= _LONGEST:
        return 0.0, None
    cv2, (seconds,) = opencv(), struct.unpack_from("<d", message)
    try:
        image = cv2.imdecode(np.frombuffer(message, np.uint8, offset=8), cv2.IMREAD_GRAYSCALE)
    except cv2.error:
        image = None
    return seconds, image if math.isfinite(seconds) else None
