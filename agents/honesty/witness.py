"""What the hidden labels say of a run, frame by frame: depth errors at conversion, wrong associations, duplicates.

A step must be one frame, or conversions would be seen some frames late.
"""

import json
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activeslam_gym.motion import CAMERA_DIM
from agents.episode import Episode
from agents.evaluate import matched_ids
from agents.task import Task

Array = NDArray[Any]


@dataclass(frozen=True)
class Testimony:
    """What the hidden labels said of one run."""

    depth_errors: Array
    """(C,) standardised depth errors of the features that became points, see `depth_error`."""
    conversions: int
    """Features that became points, those without an owner too: C of them have one."""
    matches: int
    """Detections matched to a fiducial or to a feature that was there before (births are none)."""
    wrong_matches: int
    """Wrong ones, as the environment counts them (a feature born of clutter is one)."""
    features: int
    """Features that ever had an owner: a true landmark that they were born of."""
    duplicates: int
    """Those of them that, at some frame, had their owner in common with an older feature of the map."""


@dataclass(frozen=True)
class WatchedRun:
    """One episode with what was said of it."""

    episode: Episode
    testimony: Testimony
    initialisation: str


class Witness:
    """Takes down what the labels say after each frame; see `look`."""

    def __init__(self) -> None:
        self._begin()

    def _begin(self) -> None:
        self._depth_errors: list[float] = []
        self._counts = {"conversions": 0, "matches": 0, "wrong_matches": 0}
        self._owned: set[int] = set()
        self._doubles: set[int] = set()
        self._anchors: dict[int, Array] = {}

    def look(self, core: Any, info: dict[str, Any]) -> None:
        """See what there is to say of a frame; a reset begins anew. Raises ValueError for steps of several frames."""
        if round(core.gaze_period / core.scenario.frame_time) != 1:
            raise ValueError(f"gaze_period: {core.gaze_period!r}; allowed: one frame, or conversions are seen late")
        belief, labels = core.belief, core.labels
        if core.time == 0.0:
            self._begin()
        else:
            self._note_conversions(belief, labels.owners, core.truth)
            self._counts["matches"] += len(matched_ids(core)) - info["events"]["births"]
            self._counts["conversions"] += info["events"]["conversions"]
            self._counts["wrong_matches"] += info["events"]["wrong_matches"]
            self._note_owners(labels.owners, belief.ids)
        waiting = ~belief.converted
        self._anchors = dict(zip(belief.ids[waiting].tolist(), belief.anchors[waiting]))

    def _note_conversions(self, belief: Any, owners: Array, truth: Any) -> None:
        for k in np.flatnonzero(belief.converted).tolist():
            if (anchor := self._anchors.get(int(belief.ids[k]))) is not None:
                self._depth_errors.append(depth_error(belief, truth, k, int(owners[k]), anchor))

    def _note_owners(self, owners: Array, ids: Array) -> None:
        """Features come oldest first: one whose owner an older one has is a double."""
        seen: set[int] = set()
        for owner, id in zip(owners.tolist(), ids.tolist()):
            if owner >= 0:
                self._owned.add(id)
                if owner in seen:
                    self._doubles.add(id)
                seen.add(owner)

    @property
    def testimony(self) -> Testimony:
        """What has been said since the reset."""
        errors, owned, doubles = np.array(self._depth_errors), len(self._owned), len(self._doubles)
        return Testimony(errors[~np.isnan(errors)], features=owned, duplicates=doubles, **self._counts)


def depth_error(belief: Any, truth: Any, k: int, owner: int, anchor: Array) -> float:
    """Standardised error of the depth of the belief's landmark `k`, along the line of sight from `anchor` (3,) [m].

    With m the unit vector from the anchor (as it was estimated before the frame) to the estimated point ŷ, depth is
    the distance along m between point and camera, both at this moment: the true one, mᵀ(y − p), minus the estimated
    one, mᵀ(ŷ − p̂), over its standard deviation √(mᵀ (P_yy − P_yp − P_py + P_pp) m). Taken after the update and the
    conversion of the frame. `owner` is the true landmark; NaN where there is none (−1).
    """
    if owner < 0:
        return np.nan
    y, y_hat = truth.landmarks[owner], belief.landmarks[k]
    m = (y_hat - anchor) / np.linalg.norm(y_hat - anchor)
    error = m @ ((y - truth.position) - (y_hat - belief.position))
    P, camera, point = belief.covariance, slice(0, 3), slice(CAMERA_DIM + 3 * k, CAMERA_DIM + 3 * k + 3)
    relative = P[point, point] - P[point, camera] - P[camera, point] + P[camera, camera]
    return float(error / np.sqrt(m @ relative @ m))


def watch(task: Task) -> WatchedRun:
    """Run one episode under the witness's eyes, in whichever process."""
    witness = Witness()
    episode = task.run([witness.look])
    return WatchedRun(episode, witness.testimony, json.loads(task.settings)["scenario"]["initialisation"])
