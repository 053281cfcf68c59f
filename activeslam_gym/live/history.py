"""The past of a run for its curves, of bounded size."""

import numpy as np

from activeslam_gym.live.state import State

_MOST = 1200
"""Greatest number of moments; beyond it, every second one is dropped."""
_FIRST = 3
"""First images, whose corrections of the start are no motion."""


class History:
    """Entropies over time with the moments of new landmarks, and the camera's path."""

    def __init__(self) -> None:
        self._rows: list[tuple[float, ...]] = []
        self._landmarks, self._frame = 0, -1

    def add(self, state: State) -> None:
        """Add a state; an earlier one starts a new history."""
        if state.frame < self._frame:
            self.__init__()  # type: ignore[misc]
        if state.frame == self._frame or not np.isfinite(state.log2_dets).any():
            return
        position = state.camera[:3] if state.frame > _FIRST else np.full(3, np.nan)
        self._rows.append((state.time, *state.log2_dets, float(state.landmarks > self._landmarks), *position))
        self._frame, self._landmarks = state.frame, state.landmarks
        if len(self._rows) > _MOST:  # keep every second moment, and whether a landmark was new in either of a pair
            pairs = [self._rows[k : k + 2] for k in range(0, len(self._rows), 2)]
            self._rows = [(*pair[-1][:4], max(row[4] for row in pair), *pair[-1][5:]) for pair in pairs]

    @property
    def curves(self) -> np.ndarray:
        """(k, 5) time [s], log2 |P| of camera, map and total, and whether a landmark was new: 1 or 0."""
        return np.array(self._rows).reshape(-1, 8)[:, :5]

    @property
    def way(self) -> np.ndarray:
        """(k, 3) positions of the camera [m]."""
        way = np.array(self._rows).reshape(-1, 8)[:, 5:]
        return way[np.isfinite(way).all(1)]
