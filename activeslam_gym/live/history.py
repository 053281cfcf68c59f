"""The past as curves show it: bounded, however long a run lasts."""

import numpy as np

from activeslam_gym.live.state import State

_MOST = 1200
"""Moments kept; when there are more, every second one of the old is dropped."""


_FIRST = 3
"""Images in which a start that was only guessed is corrected: that is no motion."""


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
        if state.frame > _FIRST:
            self._way.append(state.camera[:3])
        if len(self._rows) > _MOST:
            self._thin()

    def _thin(self) -> None:
        """Keep every second moment, and of each pair whether there was a new landmark."""
        pairs = [self._rows[k : k + 2] for k in range(0, len(self._rows), 2)]
        self._rows = [(*pair[-1][:4], max(row[4] for row in pair)) for pair in pairs]
        self._way = [*self._way[::2], self._way[-1]]

    @property
    def curves(self) -> np.ndarray:
        """(k, 5) time [s], log2 |P| of camera, map and total, and whether a landmark was new: 1 or 0."""
        return np.array(self._rows).reshape(-1, 5)

    @property
    def way(self) -> np.ndarray:
        """(k, 3) places of the camera [m]."""
        return np.array(self._way).reshape(-1, 3)
