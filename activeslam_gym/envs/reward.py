"""Rewards: each the gain of a named potential, so that it telescopes to what was learned.

| reward | potential |
|---|---|
| `entropy` | -H, H = 1/2 log2((2 pi e)^(12+3N) abs(P_counted) abs(Sigma_prior)^(N-m)) [bit] |
| `log_score` | log2 N(truth; belief) over camera and true landmarks [bit]: a proper score |
| `pose_entropy` | -H of the camera's position and rotation (6 dimensions) [bit] |
| `map_entropy` | -H of the map (3 N dimensions) [bit] |
| `d_optimality` | -abs(P)^(1/n), n = 12 + 3 N |
| `a_optimality` | -tr P over the positions of camera and map [m^2] |
| `variance_reduction` | -tr P over everything (mixed units) |
"""

from __future__ import annotations

import numpy as np

from activeslam_gym.compilation import part
from activeslam_gym.information import LOG2_2PIE, MAP, POSE, TOTAL
from activeslam_gym.motion import CAMERA_DIM

REWARDS = (
    "entropy",
    "log_score",
    "pose_entropy",
    "map_entropy",
    "d_optimality",
    "a_optimality",
    "variance_reduction",
)
"""Names of the rewards, in the order of `potentials`."""


def reward_number(reward: str) -> int:
    """Position of a reward in `REWARDS`.

    Raises:
        ValueError: there is no such reward; the message lists those that there are.
    """
    if reward not in REWARDS:
        raise ValueError(f"reward must be one of {', '.join(REWARDS)}, got {reward!r}")
    return REWARDS.index(reward)


@part
def potentials(
    log2_dets: np.ndarray, density: float, positions: float, everything: float, landmarks: int
) -> np.ndarray:
    """The potentials (7,) in the order of `REWARDS`.

    ``log2_dets`` (4,) as in `information`; ``density`` log2 N(truth; belief); ``positions`` and ``everything`` the
    traces of `information.variance_sums`; ``landmarks`` N.
    """
    n = CAMERA_DIM + 3 * landmarks
    return np.array(
        (
            -0.5 * (n * LOG2_2PIE + log2_dets[TOTAL]),
            density,
            -0.5 * (6 * LOG2_2PIE + log2_dets[POSE]),
            -0.5 * (3 * landmarks * LOG2_2PIE + log2_dets[MAP]),
            -(2.0 ** (log2_dets[TOTAL] / n)),
            -positions,
            -everything,
        )
    )
