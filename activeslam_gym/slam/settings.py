"""Constants of the filter, as the compiled kernels take them."""

from __future__ import annotations

import math
from typing import NamedTuple

from activeslam_gym import config
from activeslam_gym.config import Scenario

_SHARP_STDS = 2.0
"""A predicted ellipse is sharp when its longest axis is at most so many standard deviations of the image noise."""
_CLEAR_MARGIN = 8.0
"""Lead over its rivals that a match of a sharp row needs, in -2 ln of the likelihood."""
_SUPPORT_MARGIN = 12.0
"""The same for a match of a vague row, whose worth includes what it makes others explain."""
_EDGE_WORTH = 18.0
"""Worth that a match of a vague row needs where its ellipse reaches over the image's edge, in ln of the likelihood."""


class FilterModel(NamedTuple):
    """Settings of association, initialisation and deletion; see the fields of `Scenario`."""

    gate: float
    birth_gate: float
    sharp_std_px: float
    clear_margin: float
    support_margin: float
    edge_worth: float
    clutter_cost: float
    birth_detections: int
    mapped_depth_ratio: float
    maximum_misses: int
    inverse_depth: bool
    inverse_depth_mean: float
    inverse_depth_std: float
    inverse_depth_memory_frames: int
    linearity_threshold: float
    particle_near: float
    particle_far: float
    particle_prune: float
    particle_baseline: float
    ray_capacity: int
    ray_age_frames: int


def filter_of(scenario: Scenario) -> FilterModel:
    """The filter constants of a scenario."""
    return FilterModel(
        gate=chi_square_2_quantile(scenario.gate_probability),
        birth_gate=chi_square_2_quantile(scenario.birth_gate_probability),
        sharp_std_px=_SHARP_STDS * scenario.pixel_std,
        clear_margin=_CLEAR_MARGIN,
        support_margin=_SUPPORT_MARGIN,
        edge_worth=_EDGE_WORTH,
        clutter_cost=2.0 * math.log(scenario.image_width * scenario.image_height / (2.0 * math.pi)),
        birth_detections=scenario.birth_detections,
        mapped_depth_ratio=float(scenario.mapped_depth_ratio),
        maximum_misses=scenario.maximum_misses,
        inverse_depth=scenario.initialisation == config.INVERSE_DEPTH,
        inverse_depth_mean=float(scenario.inverse_depth_mean),
        inverse_depth_std=float(scenario.inverse_depth_std),
        inverse_depth_memory_frames=round(scenario.inverse_depth_memory / scenario.frame_time),
        linearity_threshold=float(scenario.linearity_threshold),
        particle_near=float(scenario.particle_depth[0]),
        particle_far=float(scenario.particle_depth[1]),
        particle_prune=float(scenario.particle_prune),
        particle_baseline=float(scenario.particle_baseline),
        ray_capacity=scenario.ray_capacity,
        ray_age_frames=round(scenario.ray_age / scenario.frame_time),
    )


def chi_square_2_quantile(probability: float) -> float:
    """Quantile of the chi-square distribution of 2 dof, -2 ln(1 - p): 9.21 at 99 %."""
    return -2.0 * math.log(1.0 - probability)
