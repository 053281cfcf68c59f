"""What the study notes of a run beside the episode: sights of fiducials, births, loop closures, distances."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activeslam_gym.evaluation import matched_ids
from activeslam_gym.motion import CAMERA_DIM

Array = NDArray[Any]

CLOSURE_GAP = 5.0
"""A loop closes when something known is matched again after so long without a match [s]. The paper names no number."""


@dataclass(frozen=True)
class Notes:
    """Of K steps."""

    fiducials: Array
    """(K,) fiducials matched in the step's last frame."""
    births: Array
    """(K,) features born."""
    closures: Array
    """(K,) features and fiducials matched again after `CLOSURE_GAP`."""
    nearest: Array
    """(K,) distance of the true camera to the nearest point that was detected [m]; NaN without any."""
    visited_log2_det: Array
    """(J,) log₂|P| of the camera and the j oldest mapped landmarks, when j = 1 … J of them were first mapped."""


class Observer:
    """Takes notes after each step; see `look`."""

    def __init__(self) -> None:
        self._steps: list[tuple[int, int, int, float]] = []
        self._visited: list[float] = []
        self._last_match: dict[int, float] = {}

    def look(self, core: Any, info: dict[str, Any]) -> None:
        """See what there is to note of a step."""
        if core.time == 0.0:
            return
        matches = matched_ids(core)
        fiducials = sum(id < 0 for id in matches)
        self._steps.append((fiducials, info["events"]["births"], self._closures(matches, core.time), _nearest(core)))
        if info["landmarks_mapped"] > len(self._visited):
            self._note_visited(core.belief, info["landmarks_mapped"])

    def _closures(self, ids: list[int], now: float) -> int:
        """How many fiducials and features are back after a long absence."""
        back = 0
        for id in ids:
            back += now - self._last_match.get(id, now) >= CLOSURE_GAP
            self._last_match[id] = now
        return back

    def _note_visited(self, belief: Any, mapped_count: int) -> None:
        oldest = np.flatnonzero(belief.mapped)
        for j in range(len(self._visited) + 1, mapped_count + 1):
            rows = np.r_[:CAMERA_DIM, (CAMERA_DIM + 3 * oldest[:j, None] + np.arange(3)).ravel()]
            sign, log_det = np.linalg.slogdet(belief.covariance[np.ix_(rows, rows)])
            self._visited.append(log_det / np.log(2.0) if sign > 0 else np.nan)

    @property
    def notes(self) -> Notes:
        """What has been noted since the reset."""
        fiducials, births, closures, nearest = (np.array(column) for column in zip(*self._steps, strict=True))
        return Notes(fiducials, births, closures, nearest, np.array(self._visited))


def _nearest(core: Any) -> float:
    """Distance of the true camera to the nearest point that was detected [m]; NaN without any."""
    truth, detected = core.truth, core.labels.detected
    points = np.concatenate((truth.fiducials, truth.landmarks))[detected[detected >= 0]]
    distances = np.linalg.norm(points - truth.position, axis=1)
    return float(distances.min()) if len(distances) else np.nan
