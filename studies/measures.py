"""What the studies measure in an episode, beside its record, and numbers of records."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from activeslam_gym import Motion
from activeslam_gym.evaluation.episode import TARGET, Episode
from activeslam_gym.metrics import LoopClosures

LATERAL = (Motion.RIGHT, Motion.LEFT, Motion.UP, Motion.DOWN)  # perpendicular to the optical axis
CHANCE = 100.0 * len(LATERAL) / len(Motion)  # per cent of lateral commands, if all are as likely
MINUTE = 60.0  # the time of the paper's figure 5 b [s]


def matched_ids(core: Any) -> list[int]:
    """Ids of the matches of the last frame: of features, also new ones, and −1 − k of fiducial k."""
    matched = core.labels.matched
    return matched[(matched != 0) & (matched >= -core.scenario.fiducial_count)].tolist()


class Matches:
    """A measure: ``matches`` of the episode, counted in the last frame of each step for every frame of it."""

    matches = 0

    def __call__(self, core: Any, info: dict[str, Any]) -> None:
        """Count the matches of a step."""
        if core.time > 0.0:
            self.matches += round(core.gaze_period / core.scenario.frame_time) * len(matched_ids(core))

    def result(self, episode: Episode) -> dict[str, Any]:
        """The count."""
        return {"matches": self.matches}


class Loops:
    """A measure: ``fiducials`` matched in a frame, ``closure``, the time of the first loop closure [s], and ``drop``.

    The drop is the change of the camera's log2 |P| in the second from a closure on, less that in the second before.
    """

    def __init__(self) -> None:
        self._loops, self._closed, self._fiducials = LoopClosures(), [0], [0]
        self._times, self._log2_det = list[float](), list[float]()

    def __call__(self, core: Any, info: dict[str, Any]) -> None:
        """Count the closures and the fiducials of a step."""
        self._times.append(core.time)
        self._log2_det.append(info["log2_det"]["camera"])
        if core.time > 0.0:
            ids = matched_ids(core)
            self._closed.append(self._loops.count(ids, core.time))
            self._fiducials.append(sum(id < 0 for id in ids))

    def result(self, episode: Episode) -> dict[str, Any]:
        """The three numbers; without a closure its time is that of the end, and the drop NaN."""
        det, closed = np.array(self._log2_det), np.flatnonzero(self._closed)
        second = round(1.0 / float(np.median(np.diff(self._times))))
        alone = (np.diff(closed, prepend=0) > second) & (closed + second <= len(det))
        before = closed[alone] - 1
        change = det[before + second] - 2.0 * det[before] + det[before - second]
        return {
            "fiducials": float(np.mean(self._fiducials[1:])),
            "closure": float(self._times[closed[0] if len(closed) else -1]),
            "drop": float(change.mean()) if len(change) else np.nan,
        }


class WithoutExpected:
    """Moves the expected landmarks to where no camera sees them, so that no score counts them."""

    def __call__(self, core: Any, info: dict[str, Any]) -> None:
        """Move them after the reset."""
        if core.time == 0.0:
            core._run.expected["point"] = 0.0, -1000.0, 0.0


def at_target(runs: Sequence[Episode], name: str, otherwise: float) -> np.ndarray:
    """The time or log2 |P| at the 14th landmark, ``otherwise`` where so many are never mapped."""
    return np.array([(*getattr(one, name)[TARGET - 1 : TARGET], otherwise)[0] for one in runs])


def unless_lost(runs: Sequence[Episode], value: Callable[[Episode], float]) -> np.ndarray:
    """A number of each episode, NaN where it was lost."""
    return np.array([np.nan if one.lost else value(one) for one in runs])


def noted(runs: Sequence[Episode], name: str) -> np.ndarray:
    """What a measure noted in each episode."""
    return np.array([one.notes[name] for one in runs], float)


def share(runs: Sequence[Episode], motions: Sequence[Motion], after: str = "", until: float = np.inf) -> np.ndarray:
    """Per cent of the commands before ``until`` [s] that are ``motions``; of those ``after`` a period with an event."""
    out = []
    for one in runs:
        times = np.linspace(0.0, one.times[-1], len(one.actions), endpoint=False)
        read = np.flatnonzero(one.motion_read & (times < until))
        if after:
            read = np.array([b for a, b in zip(read[:-1], read[1:]) if one.events[after][a:b].any()], int)
        out.append(100.0 * np.isin(one.actions[read, 0], motions).mean() if len(read) else np.nan)
    return np.array(out)


def nearest(runs: Sequence[Episode]) -> np.ndarray:
    """Distance from the camera to the nearest landmark or fiducial, mean over an episode [m]."""
    points = [np.concatenate((one.true_landmarks, one.fiducials)) for one in runs]
    away = (np.linalg.norm(one.true_position[:, None] - y, axis=-1) for one, y in zip(runs, points))
    return np.array([distances.min(axis=1).mean() for distances in away])


def nees(runs: Sequence[Episode]) -> np.ndarray:
    """(2, episodes, T) per degree of freedom, of the pose (mean of position and orientation) and the landmarks."""
    pose = [(one.position_nees + one.orientation_nees) / 2.0 for one in runs]
    return np.array([pose, [one.landmark_nees for one in runs]])


def mean_nees(runs: Sequence[Episode]) -> np.ndarray:
    """(2, episodes) of `nees` the mean over the samples after the start, NaN where there is none."""
    values = nees(runs)[:, :, 1:]
    with np.errstate(invalid="ignore"):
        return np.nansum(values, axis=2) / (~np.isnan(values)).sum(axis=2)


def within(runs: Sequence[Episode]) -> np.ndarray:
    """Per cent of the position errors within two of the filter's standard deviations."""
    return np.array([100.0 * (np.abs(one.position_offset) <= 2.0 * one.position_std).mean() for one in runs])


def orientation_rms(run: Episode) -> float:
    """Root mean square of the orientation error [degree]."""
    return float(np.degrees(np.sqrt(np.mean(run.orientation_error**2))))


def middle(several: Sequence[Sequence[Episode]]) -> int:
    """The number of the episode with the median log score of several policies together, if any is not lost of these."""
    gains = np.sum([[one.log_score[-1] for one in runs] for runs in several], axis=0)
    lost = np.any([[one.lost for one in runs] for runs in several], axis=0)
    kept = np.flatnonzero(lost.all() | ~lost)
    return int(kept[np.argsort(gains[kept])[len(kept) // 2]])
