"""Why images were lost, and what would help: words for the end of a track."""

from collections import Counter

import numpy as np

from activeslam_gym.vision.corners import new_corners
from activeslam_gym.vision.frontend import FrameLog
from activeslam_gym.vision.settings import FrontEndSettings
from activeslam_gym.vision.templates import TEMPLATE_HALF, TEMPLATE_SIDE

_DARK = 40  # an image is dark where 99 % of its pixels are no brighter, of 255
_FEW_CORNERS = 8  # an image with fewer is blank
_LOOKED_AT = 60  # lost images whose reason is sought
_PROVEN = 30  # tracked images after which the lens is not to blame
_TURNING = 0.2  # share of the map with a known depth, under which the camera has moved sideways too little

DARK = "is dark (99 % of its pixels have {level} of 255 or less): more light, or a longer exposure, would help"
TURNED = "the camera had moved sideways by next to nothing, and turning gives no depth"
BLANK = "has no corners (a blank wall, or blur): keep textured objects in view"


def blemish(image: np.ndarray) -> str:
    """What keeps features from being found in the ``image`` (h, w) uint8, as ``DARK`` or ``BLANK``; or "" ."""
    level = int(np.percentile(image, 99))
    if level <= _DARK:
        return DARK.format(level=level)
    s, edge = FrontEndSettings(), TEMPLATE_HALF + 8
    corners = new_corners(image, np.zeros((0, 2)), _FEW_CORNERS, TEMPLATE_SIDE, edge, s.least_corner)
    return BLANK if len(corners) < _FEW_CORNERS else ""


class Diagnosis:
    """Collects the reasons of lost images."""

    def __init__(self) -> None:
        self._reasons: Counter[str] = Counter()
        self._first: dict[str, str] = {}  # the words on the first dark image, and on the first blank one
        self._mapped = 1.0

    def add(self, image: np.ndarray, log: FrameLog, mapped: np.ndarray, tracked: int = 0) -> None:
        """A lost ``image`` (h, w), its ``log``, which features of the map (n,) have a known depth, and how many images
        were ``tracked`` before."""
        if self._reasons.total() >= _LOOKED_AT:
            return
        if not self._reasons:
            self._mapped = float(mapped.mean()) if len(mapped) else 1.0
        if spot := blemish(image):
            reason = f"a lost image {self._first.setdefault(spot.split(' (')[0], spot)}"
        elif log.found > 2 * max(log.matched, 3) and tracked < _PROVEN:
            reason = "the matches fit no motion of the camera: check that the calibration is of this lens"
        elif log.searched < 3:
            reason = (
                "the map was out of view, or the motion too quick: slower motion, or more images a second, would help"
            )
        else:
            reason = (
                "features were not found again (blur, or too quick a motion): slower motion, or more light, would help"
            )
        self._reasons[reason] += 1

    def advice(self, target: bool) -> str:
        """The commonest reason and what would help; ``target``: whether the track started from one."""
        if not self._reasons:
            return "nothing was lost"
        reason, advice = self._reasons.most_common(1)[0][0], []
        if not reason.startswith("a lost image"):
            if self._mapped < _TURNING:
                advice.append(TURNED)
            if not target:
                advice.append("a target in the first image may help")
        return "; ".join([reason, *advice])
