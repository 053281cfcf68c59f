"""One way to play an episode, one record of it, and one store of records."""

from activeslam_gym.evaluation.episode import Episode, Measure, Observer, Predictor, bound, play, row_of, run_episode
from activeslam_gym.evaluation.store import Store

__all__ = ["Episode", "Measure", "Observer", "Predictor", "Store", "bound", "play", "row_of", "run_episode"]
