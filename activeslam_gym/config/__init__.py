"""Scenarios: every physical and filter setting of an experiment, by subject, with units and bounds.

Angles are in radians, lengths in metres and times in seconds unless a suffix says otherwise. World axes: Y is up, X and
Z are horizontal, the origin is the centre of the room. Camera axes: x left, y up, z forward (the paper's equation 1).
"""

from activeslam_gym.config.bounds import MOST_FRAMES, is_number, plain, positive_number, whole_multiple, whole_number
from activeslam_gym.config.filter import DEPTH_PARTICLES, INITIALISATIONS, INVERSE_DEPTH, KNOWN, UNKNOWN
from activeslam_gym.config.named import (
    ASKED,
    IMAGE_SCENARIOS,
    SCENARIOS,
    TRAINING_SEED,
    benchmark_seed,
    fields_of,
    scenario_from,
)
from activeslam_gym.config.room import ANYWHERE, BOXES, CENTRE, CLUSTERS, CORNER, SURFACES, UNIFORM, WALL, NoRoomError
from activeslam_gym.config.scenario import BOUNDS, MOST_HELD_FRAMES, RANGES, VARIABLE, Scenario
from activeslam_gym.registry import did_you_mean

__all__ = [
    "ANYWHERE", "ASKED", "BOUNDS", "BOXES", "CENTRE", "CLUSTERS", "CORNER", "DEPTH_PARTICLES", "IMAGE_SCENARIOS",
    "INITIALISATIONS", "INVERSE_DEPTH", "KNOWN", "MOST_FRAMES", "MOST_HELD_FRAMES", "RANGES", "SCENARIOS", "SURFACES",
    "TRAINING_SEED", "UNIFORM", "UNKNOWN", "VARIABLE", "WALL", "NoRoomError", "Scenario", "benchmark_seed",
    "did_you_mean", "fields_of", "is_number", "plain", "positive_number", "scenario_from", "whole_multiple",
    "whole_number",
]  # fmt: skip
