"""One episode: its record, and what it came to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activeslam_gym.metrics import write_tum
from activeslam_gym.motion import Gaze, Motion

Array = NDArray[Any]


@dataclass(frozen=True)
class Episode:
    """One episode of one policy. T samples in time (the start's is the first), K = T − 1 steps, L true landmarks.

    A NEES is per degree of freedom: 1 where the filter is consistent. Quaternions are scalar first. A standard
    deviation is the filter's own.
    """

    policy: str  # its name
    seed: int  # of the reset
    settings: str  # the environment's arguments as JSON: episodes with equal settings belong to one study
    lost: bool  # the belief was lost at some time
    room_size: Array  # (3,) along X, Y, Z [m]

    times: Array  # (T,) [s]
    entropy: Array  # (T,) [bit]
    log2_det_camera: Array  # (T,) log₂|P| of the camera
    log2_det_map: Array  # (T,) log₂|P| of the map, at constant dimension
    log2_det_total: Array  # (T,) log₂|P| of both
    log_score: Array  # (T,) log₂ N(truth | belief), less that of the start [bit]
    landmarks_mapped: Array  # (T,) features that are mapped
    distinct_landmarks: Array  # (T,) true landmarks among them
    position_error: Array  # (T,) [m]
    orientation_error: Array  # (T,) [rad]
    landmark_rmse: Array  # (T,) [m]; inf until a landmark is mapped
    position_nees: Array  # (T,)
    orientation_nees: Array  # (T,)
    landmark_nees: Array  # (T,) mean over the mapped landmarks; NaN before there are any
    position_std: Array  # (T, 3) [m]
    rotation_std: Array  # (T, 3) [rad]
    true_position: Array  # (T, 3) [m]
    true_quaternion: Array  # (T, 4)
    estimated_position: Array  # (T, 3) [m]
    estimated_quaternion: Array  # (T, 4)

    actions: Array  # (K, 2) motion and gaze
    motion_read: Array  # (K,) bool: the step read its motion; elsewhere the one under way went on
    rewards: Array  # (K,)
    decision_us: Array  # (K,) microseconds of `predict`; of a batch, each episode's share

    landmark_times: Array  # (J,) when the number of mapped landmarks first reached 1 … J [s]
    landmark_log2_det: Array  # (J,) log₂|P| of camera and map then

    true_landmarks: Array  # (L, 3) [m]
    fiducials: Array  # (F, 3) [m]
    landmark_errors: Array  # (L,) at the end [m]; NaN for a landmark that is not mapped
    estimated_landmarks: Array  # (n, 3) the mapped features at the end [m]
    landmark_covariance: Array  # (n, 3, 3) their covariances [m²]

    events: dict[str, Array] = field(default_factory=dict)  # of `info["events"]`: (K,) how often in each step
    notes: dict[str, Array] = field(default_factory=dict)  # what measures add, by name

    @property
    def position_offset(self) -> Array:
        """True − estimated position (T, 3) [m]."""
        return self.true_position - self.estimated_position

    @property
    def rotation_offset(self) -> Array:
        """δθ (T, 3) of R_true = Exp(δθ) R_estimated, in the world frame [rad]."""
        from scipy.spatial.transform import Rotation

        true, estimated = (
            Rotation.from_quat(np.roll(q, -1, -1)) for q in (self.true_quaternion, self.estimated_quaternion)
        )
        return (true * estimated.inv()).as_rotvec()

    @property
    def gain(self) -> float:
        """What the log score gained [bit]."""
        return float(self.log_score[-1] - self.log_score[0])

    def arrays(self) -> dict[str, Array]:
        """All of it as arrays, for a store: `events` and `notes` by names with a point."""
        values = {one.name: getattr(self, one.name) for one in fields(self)}
        nested = {f"{part}.{name}": value for part in NESTED for name, value in values.pop(part).items()}
        return {name: np.asarray(value) for name, value in (values | nested).items()}

    def write_trajectories(self, folder: Path, stem: str) -> list[Path]:
        """Write the true and the estimated trajectory into `folder`, for `evo_ape tum …`; the files."""
        files = {kind: folder / f"{stem}-{kind}.tum" for kind in ("true", "estimated")}
        for kind, path in files.items():
            write_tum(path, self.times, getattr(self, f"{kind}_position"), getattr(self, f"{kind}_quaternion"))
        return list(files.values())

    @classmethod
    def of(cls, arrays: Mapping[str, Array]) -> Episode:
        """The episode of its `arrays`."""
        values: dict[str, Any] = {part: {} for part in NESTED}
        for name, value in arrays.items():
            part, _, inner = name.partition(".")
            if inner:
                values[part][inner] = value
            else:
                values[name] = value if value.ndim else value.item()
        return cls(**values)


NESTED = ("events", "notes")  # the fields that are dicts of arrays


def nearest(times: Array, period: float) -> Array:
    """Indices of the ascending `times` (T,) that are nearest to the multiples of `period`, and of the last."""
    ticks = np.arange(0.0, times[-1] + period, period)
    return np.union1d(np.abs(times[None, :] - ticks[:, None]).argmin(axis=1), len(times) - 1)


TARGET = 14  # the landmark whose time the paper states


def row_of(episode: Episode) -> dict[str, Any]:
    """A row of episodes.csv: names, bits learned, errors at the end [m, rad], times [s], counts of the commands.

    A lost belief has removed no bits of entropy; its log score stands as it is, for the score itself punishes it.
    What did not happen (no landmark mapped, not `TARGET` of them) is NaN.
    """
    reached = len(episode.landmark_times) >= TARGET
    return {
        "policy": episode.policy,
        "seed": episode.seed,
        "steps": len(episode.actions),
        "end_time": float(episode.times[-1]),
        "lost": int(episode.lost),
        "bits": 0.0 if episode.lost else float(episode.entropy[0] - episode.entropy[-1]),
        "log_score_gain": episode.gain,
        "log_score_under_0": int(episode.gain < 0.0),
        "log_score_under_minus_1000": int(episode.gain < -1000.0),
        "reward": float(episode.rewards.sum()),
        "landmarks_mapped": int(episode.landmarks_mapped[-1]),
        "distinct_landmarks": int(episode.distinct_landmarks[-1]),
        "landmark_rmse": float(episode.landmark_rmse[-1]) if np.isfinite(episode.landmark_rmse[-1]) else np.nan,
        "position_error": float(episode.position_error[-1]),
        "orientation_error": float(episode.orientation_error[-1]),
        "position_nees": float(episode.position_nees[-1]),
        "landmark_nees": float(episode.landmark_nees[-1]),
        "target_reached": int(reached),
        "target_time": float(episode.landmark_times[TARGET - 1]) if reached else np.nan,
        "target_log2_det": float(episode.landmark_log2_det[TARGET - 1]) if reached else np.nan,
        "decision_us": float(episode.decision_us.mean()),
        **{f"motion_{motion.name.lower()}": count for motion, count in zip(Motion, motion_counts(episode))},
        **{f"gaze_{gaze.name.lower()}": count for gaze, count in zip(Gaze, gaze_counts(episode))},
    }


def motion_counts(episode: Episode) -> list[int]:
    """How often each motion was commanded: one command a motion period, in the enum's order."""
    return np.bincount(episode.actions[episode.motion_read, 0], minlength=len(Motion)).tolist()


def gaze_counts(episode: Episode) -> list[int]:
    """How often each gaze was commanded, in the enum's order."""
    return np.bincount(episode.actions[:, 1], minlength=len(Gaze)).tolist()
