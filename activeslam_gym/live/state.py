"""The `State` of a live run after each image: a page shows it, and a recording keeps it as JSON."""

from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np

from activeslam_gym.motion import Motion
from activeslam_gym.vision.film import Moment
from activeslam_gym.vision.frontend import Searched


class Standing(str, Enum):
    """How the tracking goes: no target seen yet; well; few matches; the camera is lost; no image is left."""

    WAITING = "waiting"
    TRACKING = "tracking"
    UNSURE = "unsure"
    LOST = "lost"
    OVER = "over"


@dataclass
class State:
    """After an image, in the world axes of the filter; metres, seconds, pixels, bits.

    The map has n features and K fiducials, of which m were searched.
    """

    frame: int
    """Images that were tracked, this one included."""
    time: float
    image: np.ndarray
    """(h, w) uint8."""
    standing: Standing
    words: str
    """The standing as a sentence."""
    camera: np.ndarray
    """(13,) float. Estimate: position, quaternion, velocity, angular velocity."""
    camera_covariance: np.ndarray
    """(3, 3) float. Of the position."""
    ids: np.ndarray
    """(n,) int. Of the features."""
    points: np.ndarray
    """(n, 3) float."""
    covariances: np.ndarray
    """(n, 3, 3) float."""
    mapped: np.ndarray
    """(n,) bool. As in `slam.estimate.Estimate`."""
    fiducials: np.ndarray
    """(K, 3) float. Corners of the target."""
    searched: np.ndarray
    """(m,) int. Ids of the features and fiducials that were searched in the image."""
    pixels: np.ndarray
    """(m, 2) float. Predicted measurements."""
    ellipses: np.ndarray
    """(m, 2, 2) float. Covariances of the innovations."""
    outcomes: np.ndarray
    """(m,) int. `vision.frontend` MISSED, MATCHED or DOUBTED."""
    command: Motion
    """The present advice."""
    scores: np.ndarray
    """(7,) float. Information of each motion when the command was chosen; NaN before the first."""
    advised: np.ndarray
    """(7,) int. Times that each motion was advised."""
    log2_dets: np.ndarray
    """(3,) float. log2 |P| of camera, map and total."""
    landmarks: int
    """Features that were ever mapped."""
    initialised: int
    """Features initialised in this image."""
    milliseconds: float
    """Processor time of this image."""
    rate: float = 0.0
    """Images a second, by the clock."""
    follows: bool | None = None
    """Whether the simulated person follows the advice; None for a real one."""
    truth: np.ndarray | None = None
    """(13,) float. The true camera, in a rendered room."""

    @property
    def moment(self) -> Moment:
        """Its picture and map."""
        searched = Searched(self.searched, self.pixels, self.ellipses, self.outcomes)
        return Moment(self.image, searched, self.points, self.covariances, self.mapped, self.fiducials, self.camera)

    @property
    def stds(self) -> np.ndarray:
        """(n, 3) standard deviations of the points [m]."""
        return np.sqrt(np.maximum(np.einsum("nii->ni", self.covariances), 0.0))


def plain(state: State) -> dict[str, Any]:
    """The state without its image as JSON holds it; numbers to six digits, NaN as None."""
    return {name: _plain(value) for name, value in vars(state).items() if name != "image"}


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, list):
        return [_plain(one) for one in value]
    if isinstance(value, float):
        return float(f"{value:.6g}") if np.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value
