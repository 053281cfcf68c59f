"""The hidden labels of a run, frame by frame: depth errors at conversion, wrong associations, duplicates.

A step must be one frame, or conversions would be seen some frames late.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from activeslam_gym.evaluation import Episode, matched_ids
from activeslam_gym.motion import CAMERA_DIM

Array = NDArray[Any]


class Witness:
    """Takes down what the labels say after each frame: a measure of the consistency report.

    It adds to the record's notes: ``depth_errors`` (C,), standardised, of the features that became points and have a
    true landmark (see `depth_error`); ``conversions``, features that became points, those without a landmark too;
    ``matches`` of detections to fiducials or to features of earlier frames; ``wrong_matches``, as the environment
    counts them (a feature initialised by clutter is one); ``features`` that ever had a true landmark;
    ``duplicates``, those of them that at some frame had it in common with an older feature of the map.
    """

    whole = False

    def __init__(self) -> None:
        self._depth_errors: list[float] = []
        self._counts = {"conversions": 0, "matches": 0, "wrong_matches": 0}
        self._owned: set[int] = set()
        self._duplicates: set[int] = set()
        self._anchors: dict[int, Array] = {}

    def look(self, core: Any, info: dict[str, Any]) -> None:
        """Take down a frame. Raises ValueError for steps of several frames."""
        if round(core.gaze_period / core.scenario.frame_time) != 1:
            raise ValueError(f"gaze_period: {core.gaze_period!r}; allowed: one frame, or conversions are seen late")
        belief, owners, events = core.belief, core.labels.owners, info["events"]
        if core.time > 0.0:
            for k in np.flatnonzero(belief.converted).tolist():
                if (anchor := self._anchors.get(int(belief.ids[k]))) is not None:
                    self._depth_errors.append(depth_error(belief, core.truth, k, int(owners[k]), anchor))
            self._counts["matches"] += len(matched_ids(core)) - events["births"]
            self._counts["conversions"] += events["conversions"]
            self._counts["wrong_matches"] += events["wrong_matches"]
            self._note_owners(owners, belief.ids)
        waiting = ~belief.converted
        self._anchors = dict(zip(belief.ids[waiting].tolist(), belief.anchors[waiting]))

    def _note_owners(self, owners: Array, ids: Array) -> None:
        """Features come oldest first: one whose landmark an older one has is a duplicate."""
        seen: set[int] = set()
        for owner, id in zip(owners.tolist(), ids.tolist()):
            if owner >= 0:
                self._owned.add(id)
                if owner in seen:
                    self._duplicates.add(id)
                seen.add(owner)

    def result(self, episode: Episode) -> dict[str, Any]:
        """The notes."""
        errors = np.array(self._depth_errors)
        counts = self._counts | {"features": len(self._owned), "duplicates": len(self._duplicates)}
        return {"depth_errors": errors[~np.isnan(errors)], **counts}


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
