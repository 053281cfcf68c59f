"""The past of a run for its curves, of bounded size."""

import numpy as np

from activeslam_gym.live.state import State

_MOST = 1200
"""At this number of moments, every second one is dropped."""
_FIRST = 3
"""First images, whose corrections of the start are no motion."""


class History:
    """Entropies over time with the moments of new landmarks, and the camera's path."""

    def __init__(self) -> None:
        self._rows = np.zeros((0, 8))
        self._landmarks, self._frame = 0, -1

    def add(self, state: State) -> None:
        """Add a state; an earlier one starts a new history."""
        if state.frame < self._frame:
            self.__init__()  # type: ignore[misc]
        if state.frame == self._frame or not np.isfinite(state.log2_dets).all():
            return
        position = state.camera[:3] if state.frame > _FIRST else np.full(3, np.nan)
        new = state.log2_dets[2] if state.landmarks > self._landmarks else np.nan
        self._rows = np.vstack((self._rows, (state.time, *state.log2_dets, new, *position)))
        self._frame, self._landmarks = state.frame, state.landmarks
        if len(self._rows) == _MOST:  # of each pair of moments the later one stays, unless the other alone has a dot
            has_dot = np.isfinite(self._rows[:, 4])
            self._rows = self._rows[np.arange(1, _MOST, 2) - (has_dot[::2] & ~has_dot[1::2])]

    @property
    def curves(self) -> tuple[np.ndarray, ...]:
        """(5 columns) time [s], log2 |P| of camera, map and total, and the total where a landmark is new, else NaN."""
        return tuple(self._rows[:, :5].T.copy())

    @property
    def way(self) -> np.ndarray:
        """(k, 3) positions of the camera [m]."""
        return self._rows[np.isfinite(self._rows[:, 5:]).all(1), 5:]
