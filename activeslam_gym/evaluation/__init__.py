"""One way to play an episode, one record of it, and one store of records."""

from activeslam_gym.evaluation.episode import (
    TARGET,
    Episode,
    Measure,
    Observer,
    Predictor,
    bound,
    play,
    row_of,
    run_episode,
)
from activeslam_gym.evaluation.store import Store

__all__ = [
    "TARGET",
    "Episode",
    "Observer",
    "Measure",
    "Predictor",
    "Store",
    "bound",
    "row_of",
    "play",
    "run_episode",
]
