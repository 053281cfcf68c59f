"""From one run to the numbers of the claims."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from activeslam_gym import Motion
from activeslam_gym.evaluation import Episode, matched_ids, motion_counts, outcome
from activeslam_gym.metrics import LoopClosures
from activeslam_gym.motion import CAMERA_DIM

Array = NDArray[Any]

LATERAL = (Motion.RIGHT, Motion.LEFT, Motion.UP, Motion.DOWN)  # perpendicular to the optical axis
CLOSURE_WINDOW = 1.0  # the drop of entropy at a loop closure is measured over so long, and over as long before it [s]
FIRST_MINUTE = 60.0  # the time of figure 5 b [s]
POSITION_AXIS, QUATERNION_AXIS = 0.2, 0.02  # half heights of figure 3's axes: m, and a quaternion's component


class Notes(NamedTuple):
    """Of K steps."""

    fiducials: Array  # (K,) fiducials matched in the step's last frame
    births: Array  # (K,) features initialised
    closures: Array  # (K,) features and fiducials matched again after `metrics.CLOSURE_GAP`
    nearest: Array  # (K,) distance of the true camera to the nearest point that was detected [m]; NaN without any
    visited_log2_det: Array
    """(J,) log₂|P| of the camera and the j oldest mapped landmarks, when j = 1 … J of them were first mapped."""


class Observer:
    """The measure of the study: a row of numbers, from the whole episode and the notes after each step."""

    whole = True

    def __init__(self) -> None:
        self._steps: list[tuple[int, int, int, float]] = []
        self._visited: list[float] = []
        self._loops = LoopClosures()

    def look(self, core: Any, info: dict[str, Any]) -> None:
        """Note a step."""
        if core.time == 0.0:
            return
        matches, births = matched_ids(core), info["events"]["births"]
        closures, fiducials = self._loops.count(matches, core.time), sum(id < 0 for id in matches)
        truth, detected = core.truth, core.labels.detected
        points = np.concatenate((truth.fiducials, truth.landmarks))[detected[detected >= 0]]
        nearest = np.min(np.linalg.norm(points - truth.position, axis=1), initial=np.inf)
        self._steps.append((fiducials, births, closures, nearest if len(points) else np.nan))
        for j in range(len(self._visited) + 1, info["landmarks_mapped"] + 1):
            oldest = np.flatnonzero(core.belief.mapped)[:j]
            rows = np.r_[:CAMERA_DIM, (CAMERA_DIM + 3 * oldest[:, None] + np.arange(3)).ravel()]
            sign, log_det = np.linalg.slogdet(core.belief.covariance[np.ix_(rows, rows)])
            self._visited.append(log_det / np.log(2.0) if sign > 0 else np.nan)

    @property
    def notes(self) -> Notes:
        """The notes since the reset."""
        fiducials, births, closures, nearest = (np.array(column) for column in zip(*self._steps, strict=True))
        return Notes(fiducials, births, closures, nearest, np.array(self._visited))

    def result(self, episode: Episode) -> dict[str, Any]:
        """See `measures`."""
        return measures(episode, self.notes)


def measures(episode: Episode, notes: Notes) -> dict[str, Any]:
    """One row: plain numbers, NaN for what did not happen; and `ladder_*`, a value for each number of landmarks."""
    whole = outcome(episode)
    kept = ("seed", "end_time", "lost", "log_score_gain", "landmarks_mapped", "distinct_landmarks", "landmark_rmse")
    return {
        **{name: whole[name] for name in kept},
        "final_log2_det": float(episode.log2_det_total[-1]),
        **_errors(episode),
        **_sights(episode, notes),
        **_closures(episode, notes),
        **_commands(episode, notes),
        "ladder_time": episode.landmark_times.tolist(),
        "ladder_log2_det": episode.landmark_log2_det.tolist(),
        "ladder_visited": notes.visited_log2_det.tolist(),
    }


def _errors(episode: Episode) -> dict[str, float]:
    """Root mean squares over the run, and the shares of errors within figure 3's axes and within their 2σ bounds."""
    position, rotation = np.abs(episode.position_offset), np.abs(episode.rotation_offset)
    return {
        "orientation_rms": float(np.sqrt(np.mean(episode.orientation_error**2))),
        "position_in_axis": _mean(position <= POSITION_AXIS),
        "quaternion_in_axis": _mean(rotation / 2.0 <= QUATERNION_AXIS),
        "position_in_bounds": _mean(position <= 2.0 * episode.position_std),
        "orientation_in_bounds": _mean(rotation <= 2.0 * episode.rotation_std),
    }


def _sights(episode: Episode, notes: Notes) -> dict[str, float]:
    """Fiducials in a frame, and distances of the camera to detected points and to fiducials [m]."""
    away = np.linalg.norm(episode.true_position[:, None] - episode.fiducials[None], axis=-1)
    return {
        "fiducials_a_frame": _mean(notes.fiducials),
        "nearest_mean": _mean(notes.nearest[~np.isnan(notes.nearest)]),
        "fiducial_distance": _mean(away),
    }


def _closures(episode: Episode, notes: Notes) -> dict[str, float]:
    """Loop closures, and the change of log₂|P| in the second from one on, and in the second before it.

    Of closures with a second without another before them, and a second left.
    """
    closed, steps = np.flatnonzero(notes.closures), len(notes.closures)
    width = round(CLOSURE_WINDOW / float(np.median(np.diff(episode.times))))
    alone = closed[(np.diff(closed, prepend=-1) > width) & (closed >= width) & (closed + width <= steps)]
    row = {
        "closures": float(notes.closures.sum()),
        "first_closure": float(episode.times[closed[0] + 1]) if len(closed) else np.nan,
    }
    for part in ("camera", "total"):
        values = getattr(episode, f"log2_det_{part}")
        row[f"closure_change_{part}"] = _mean(values[alone + width] - values[alone])
        row[f"before_change_{part}"] = _mean(values[alone] - values[alone - width])
    return row


def _commands(episode: Episode, notes: Notes) -> dict[str, float]:
    """Shares of the commands; of lateral ones also within a period after an initialisation, and otherwise."""
    motions = np.array(motion_counts(episode))
    read = np.flatnonzero(episode.motion_read)
    lateral = np.isin(episode.actions[read, 0], LATERAL)
    after_birth = np.array([notes.births[a:b].any() for a, b in zip(read[:-1], read[1:])], dtype=bool)
    mapped = np.maximum.accumulate(episode.landmarks_mapped)
    after_mapping = mapped[read[1:]] > mapped[read[:-1]]
    return {
        "stay_share": float(motions[Motion.STAY] / motions.sum()),
        "forward_share": float(motions[Motion.FORWARD] / motions.sum()),
        "lateral_first_minute": _mean(lateral[episode.times[read] < FIRST_MINUTE]),
        "lateral_after_birth": _mean(lateral[1:][after_birth]),
        "lateral_after_mapping": _mean(lateral[1:][after_mapping]),
        "lateral_otherwise": _mean(lateral[1:][~after_birth & ~after_mapping]),
    }


def _mean(values: Array) -> float:
    return float(np.mean(values)) if len(values) else np.nan
