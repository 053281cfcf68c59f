"""What one episode came to: the numbers of a row of episodes.csv."""

from __future__ import annotations

from typing import Any

import numpy as np

from activeslam_gym import Gaze, Motion
from agents.evaluate import Episode


def outcome(episode: Episode, target_landmarks: int) -> dict[str, Any]:
    """One row: names, what was learned [bits], errors at the end [m, rad], times [s], counts of the commands.

    A lost belief has removed no bits of entropy; its log score stands as it is, for the score itself punishes it.
    What did not happen (no landmark mapped, `target_landmarks` not reached) is NaN.
    """
    reached = len(episode.landmark_times) >= target_landmarks
    return {
        "policy": episode.policy,
        "seed": episode.seed,
        "steps": len(episode.actions),
        "end_time": float(episode.times[-1]),
        "lost": int(episode.lost),
        "bits": 0.0 if episode.lost else float(episode.entropy[0] - episode.entropy[-1]),
        "log_score_gain": float(episode.log_score[-1] - episode.log_score[0]),
        "reward": float(episode.rewards.sum()),
        "landmarks_mapped": int(episode.landmarks_mapped[-1]),
        "distinct_landmarks": int(episode.distinct_landmarks[-1]),
        "landmark_rmse": float(episode.landmark_rmse[-1]) if np.isfinite(episode.landmark_rmse[-1]) else np.nan,
        "position_error": float(episode.position_error[-1]),
        "orientation_error": float(episode.orientation_error[-1]),
        "target_reached": int(reached),
        "target_time": float(episode.landmark_times[target_landmarks - 1]) if reached else np.nan,
        "target_log2_det": float(episode.landmark_log2_det[target_landmarks - 1]) if reached else np.nan,
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


def honesty(episode: Episode, time: float) -> dict[str, float]:
    """NEES per degree of freedom of position, orientation and landmarks at `time` [s]; NaN where the run is over.

    A run that was lost by then is over too: these are the figures of the runs alive.
    """
    names = ("position_nees", "orientation_nees", "landmark_nees")
    half_sample = 0.5 * float(np.median(np.diff(episode.times)))
    alive = time <= episode.times[-1] + half_sample and not (episode.lost and time >= episode.times[-1])
    index = int(np.abs(episode.times - time).argmin())
    return {name: float(getattr(episode, name)[index]) if alive else np.nan for name in names}
