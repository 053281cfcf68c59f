"""One way to play an episode, one record of it, and one store of records."""

from activeslam_gym.evaluation.episode import TARGET, Episode, gaze_counts, motion_counts, row_of
from activeslam_gym.evaluation.play import Measure, Observer, Predictor, bound, matched_ids, play, run_episode
from activeslam_gym.evaluation.store import Store

__all__ = [
    "TARGET",
    "Episode",
    "Observer",
    "Measure",
    "Predictor",
    "Store",
    "bound",
    "gaze_counts",
    "matched_ids",
    "motion_counts",
    "row_of",
    "play",
    "run_episode",
]
