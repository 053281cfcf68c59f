"""Deprecated: `run_episode` is in `activeslam_gym.evaluation`."""

import warnings

from activeslam_gym.evaluation import run_episode as run_episode

warnings.warn("agents.evaluate is deprecated: use activeslam_gym.evaluation", DeprecationWarning, stacklevel=2)
