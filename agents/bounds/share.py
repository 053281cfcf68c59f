"""A policy's share of the planner's lead over the best constant."""

from collections.abc import Mapping

from agents.tools.statistics import Estimate, estimate_ratio

PLANNER, BASE = "rollout", "best-constant"
Scores = Mapping[str, Mapping[int, float]]
"""Policy → seed → log score gained [bit]."""


def shares(scores: Scores, planner: str, base: str) -> dict[str, Estimate]:
    """Policy → its lead over `base`, over that of `planner`: interquartile means over the rooms that all three saw."""
    return {name: _share(own, scores[planner], scores[base]) for name, own in scores.items()}


def _share(own: Mapping[int, float], planner: Mapping[int, float], base: Mapping[int, float]) -> Estimate:
    seeds = [seed for seed in own if seed in planner and seed in base]
    return estimate_ratio(*([one[seed] - base[seed] for seed in seeds] for one in (own, planner)))
