"""What the study notes of a run beside the episode: sights of fiducials, births, loop closures, distances."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from activeslam_gym.envs.frame import Simulation
from activeslam_gym.motion import CAMERA_DIM, POSITION

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


class Observer(gym.Wrapper):
    """Passes everything on, and takes notes after each step."""

    def __init__(self, env: gym.Env) -> None:
        super().__init__(env)
        core: Any = env.unwrapped
        self._core = core
        self._simulation: Simulation = core._run.simulation  # a referee's look inside: there is no public way
        self._fiducials = core.scenario.fiducial_count
        self._start()

    def _start(self) -> None:
        self._steps: list[tuple[int, int, int, float]] = []
        self._visited: list[float] = []
        self._last_match: dict[tuple[bool, int], float] = {}

    def reset(self, **arguments: Any) -> tuple[Any, dict[str, Any]]:
        """Begin anew."""
        self._start()
        return self.env.reset(**arguments)

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """One step, and what there is to note of it."""
        result = self.env.step(action)
        info = result[-1]
        rows = self._matched_rows()
        fiducials = int(np.count_nonzero(rows < self._fiducials))
        self._steps.append((fiducials, info["events"]["births"], self._closures(rows), self._nearest()))
        if info["landmarks_mapped"] > len(self._visited):
            self._note_visited(info["landmarks_mapped"])
        return result

    def _matched_rows(self) -> Array:
        """Rows (fiducials, then slots) that the detections of the last frame were matched to."""
        match = self._simulation.match[: self._simulation.detections.used[0]]
        return match[match >= 0]

    def _closures(self, rows: Array) -> int:
        """How many fiducials and features are back after a long absence."""
        belief, now, back = self._simulation.belief, float(self._core.time), 0
        for row in rows.tolist():
            fiducial = row < self._fiducials
            key = (fiducial, row if fiducial else int(belief.serial[row - self._fiducials]))
            back += now - self._last_match.get(key, now) >= CLOSURE_GAP
            self._last_match[key] = now
        return back

    def _nearest(self) -> float:
        world, detections = self._simulation.world, self._simulation.detections
        labels = detections.labels[: detections.used[0]]
        points = world.points[labels[labels >= 0]]
        return float(np.linalg.norm(points - world.camera[POSITION], axis=1).min()) if len(points) else np.nan

    def _note_visited(self, mapped_count: int) -> None:
        belief = self._core.belief
        oldest = np.flatnonzero(belief.mapped)
        for j in range(len(self._visited) + 1, mapped_count + 1):
            columns = (CAMERA_DIM + 3 * oldest[:j, None] + np.arange(3)).ravel()
            rows = np.concatenate((np.arange(CAMERA_DIM), columns))
            sign, log_det = np.linalg.slogdet(belief.covariance[np.ix_(rows, rows)])
            self._visited.append(log_det / np.log(2.0) if sign > 0 else np.nan)

    @property
    def notes(self) -> Notes:
        """What has been noted since the reset."""
        fiducials, births, closures, nearest = (np.array(column) for column in zip(*self._steps, strict=True))
        return Notes(fiducials, births, closures, nearest, np.array(self._visited))
