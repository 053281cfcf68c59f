"""A policy of your own: the motion by mutual information; the gaze turns LEFT for half of the episode, then rests."""

from typing import Any

import numpy as np

from activeslam_gym import Gaze


def look_around(env: Any) -> np.ndarray:
    """(2,) motion and gaze, or (B, 2) of a batch: `compare --policies examples.extend_policy:look_around` plays it."""
    core = env.unwrapped
    motion = core.motion_scores("mutual_information").argmax(axis=-1)
    gaze = np.where(np.less(core.time, 0.5 * core.duration), Gaze.LEFT, Gaze.STAY)
    return np.stack((motion, gaze), axis=-1)
