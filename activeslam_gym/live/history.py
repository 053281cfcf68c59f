"""The past as curves show it: bounded, however long a run lasts."""

import numpy as np

from activeslam_gym.live.state import State

_MOST = 1200
"""Moments kept; when there are more, every second one of the old is dropped."""


class History:
    """Entropies over time with the moments of new landmarks, and the way that the camera went."""

    def __init__(self) -> None:
        self._rows: list[tuple[float, ...]] = []
        self._way: list[np.ndarray] = []
        self._landmarks = 0
        self._frame = -1

    def add(self, state: State) -> None:
        """A state after those before; one that is earlier begins anew."""
        if state.frame < self._frame:
            self.__init__()  # type: ignore[misc]
        if state.frame == self._frame or not np.isfinite(state.log2_dets).any():
            return
        self._frame = state.frame
        new = state.landmarks > self._landmarks
        self._landmarks = state.landmarks
        self._rows.append((state.time, *state.log2_dets, float(new)))
        self._way.append(state.camera[:3])
        if len(self._rows) > _MOST:
            self._thin()

    def _thin(self) -> None:
        """Keep every second moment, and of each pair whether there was a new landmark."""
        pairs = [self._rows[k : k + 2] for k in range(0, len(self._rows), 2)]
        self._rows = [(*pair[-1][:4], max(row[4] for row in pair)) for pair in pairs]
        self._way = [self._way[min(k + 1, len(self._way) - 1)] for k in range(0, len(self._way), 2)]

    @property
    def curves(self) -> tuple[np.ndarray, ...]:
        """Times [s], log2 |P| of camera, map and total, and the total where a landmark was new (NaN elsewhere)."""
        rows = np.array(self._rows or [(0.0, np.nan, np.nan, np.nan, 0.0)])
        return rows[:, 0], rows[:, 1], rows[:, 2], rows[:, 3], np.where(rows[:, 4] > 0.0, rows[:, 3], np.nan)

    @property
    def way(self) -> np.ndarray:
        """(k, 3) places of the camera [m]."""
        return np.array(self._way).reshape(-1, 3)
