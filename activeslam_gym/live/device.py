"""The camera of the device that shows the page, as a source of images."""

import json
from multiprocessing import get_context
from pathlib import Path
from queue import Empty
from threading import Thread
from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter

from activeslam_gym.files import demand_writable, written_whole
from activeslam_gym.live.advice import CandidateScores, MakeAdviser
from activeslam_gym.live.expected import ExpectedMap
from activeslam_gym.live.source import GuidanceError, posed
from activeslam_gym.vision.board_calibration import BOARD, BoardCalibration
from activeslam_gym.vision.calibration import Calibration
from activeslam_gym.vision.frontend import FrontEnd
from activeslam_gym.vision.other_lenses import Straighten, lens_from
from activeslam_gym.vision.sources import Frame
from activeslam_gym.vision.target import read_target
from activeslam_gym.vision.track import start

BROWSER = "browser"
"""The name of this source."""
_COMPILING = "Getting ready: the first time here it compiles, for a minute or two."
_ROUGHLY: tuple[Calibration, Straighten] = (Calibration(640, 480, 520.0, 319.5, 239.5, 0.0), lambda frame: frame)
"""A lens until the true one is known."""


class Device:
    """A device's camera before a known ``target``, of about ``rate`` images a second [Hz].

    Without a ``calibration`` it is calibrated first, by waving the board of `board_calibration`, and the lens is
    written to ``unknown``, or lens.json. Without a ``target`` that board is it.

    Raises:
        ValueError, OSError: a file or the rate is bad.
    """

    person, is_camera, name = None, True, "the device's camera"

    def __init__(
        self,
        calibration: str | Path | None,
        target: str | Path | None,
        rate: float,
        unknown: str | Path | None = None,
        adviser: MakeAdviser = CandidateScores,
        camera: str | None = None,
    ) -> None:
        self.images: Any = get_context("spawn").Queue(1)
        """Times [s] and images, of the page's process."""
        self._board_calibration = BoardCalibration() if calibration is None else None
        self._file = Path(unknown or "lens.json")
        if calibration is None:
            demand_writable(self._file.parent)
        self._calibration, self._straighten = _ROUGHLY if calibration is None else lens_from(calibration, camera)
        self._target, self._rate, self._frame = BOARD if target is None else read_target(target), rate, None
        self._fields, self.scenario = posed(self._calibration, rate)
        self._warming = Thread(target=self._warm_up, args=(adviser,), daemon=True)
        self._warming.start()

    def _warm_up(self, make: MakeAdviser) -> None:
        """Compile what two seconds of tracking need: with a minute between the first two images the camera is lost."""
        texture = gaussian_filter(np.random.default_rng(0).normal(128.0, 400.0, self._calibration[1::-1]), 3.0)
        image = np.clip(texture, 0.0, 255.0).astype(np.uint8)
        front_end = start(image, self._calibration, None, self._rate, scenario_fields=self._fields)
        adviser = make(self.scenario, ExpectedMap(self.scenario, front_end, np.random.SeedSequence(0)))
        for k in range(1, round(2.0 * self._rate) + 1):
            front_end.step(image, k / self._rate)
            adviser.expected.update()
            adviser.consider()

    @property
    def calibrating(self) -> bool:
        """Whether the lens is still unknown."""
        return self._board_calibration is not None

    def _calibrate(self, board_calibration: BoardCalibration, image: np.ndarray) -> None:
        """Take a view; once the lens is known, write it and use it. Raises GuidanceError: it is not known."""
        words = board_calibration.add(image)
        if board_calibration.fit is None:
            raise GuidanceError(f"Calibration: {words}")
        self._calibration, self._board_calibration = board_calibration.fit.calibration, None
        self._fields, self.scenario = posed(self._calibration, self._rate)
        with written_whole(self._file) as unfinished:
            unfinished.write_text(json.dumps(self._calibration._asdict(), indent=1) + "\n")

    @property
    def side(self) -> int:
        """The longest side of its images [px]."""
        return max(self._calibration[:2])

    def restart(self) -> None:
        """Start again; the device goes on."""

    def wait(self, seconds: float) -> bool:
        """Whether an image comes within so many ``seconds``."""
        try:
            self._frame = self._frame or self.images.get(timeout=seconds)
        except Empty:
            return False
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
        try:
            frame = self._straighten(frame)
            if not self.calibrating:
                self._calibration.check_image(frame[1])
        except ValueError as error:
            raise GuidanceError(f"Turn the device: {error}.") from None
        return frame

    def start(self, image: np.ndarray) -> FrontEnd:
        """A front end that has seen the first ``image``.

        Raises:
            GuidanceError: it is being calibrated, or kernels are still compiled.
            ValueError: the image does not show the target.
        """
        if self._board_calibration is not None:
            self._calibrate(self._board_calibration, image)
        if self._warming.is_alive():
            raise GuidanceError(_COMPILING)
        return start(image, self._calibration, self._target, self._rate, scenario_fields=self._fields)
