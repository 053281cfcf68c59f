"""A policy's share of the planner's lead over the best constant."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from agents.tools.statistics import Estimate, estimate_from_sums

PLANNER, BASE = "rollout", "best-constant"
Scores = Mapping[str, Mapping[int, float]]
"""Policy → seed → log score gained [bit]."""


def shares(scores: Scores, planner: str, base: str) -> dict[str, Estimate]:
    """Policy → its lead over `base`, over that of `planner`: of sums over the rooms that all three have seen."""
    return {name: _share(own, scores[planner], scores[base]) for name, own in scores.items()}


def _share(own: Mapping[int, float], planner: Mapping[int, float], base: Mapping[int, float]) -> Estimate:
    seeds = [seed for seed in own if seed in planner and seed in base]
    leads = np.reshape([(own[seed] - base[seed], planner[seed] - base[seed]) for seed in seeds], (-1, 2))
    return estimate_from_sums(leads, _ratio)


def _ratio(sums: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of sums (2, ...); NaN where the planner has no lead to share."""
    return np.where(sums[1] > 0.0, sums[0] / sums[1], np.nan)
