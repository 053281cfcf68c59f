"""The filter: its prior, data association, and initialisation and deletion of features."""

import math
from dataclasses import dataclass
from typing import Annotated

from activeslam_gym.config import bounds

INITIALISATIONS = DEPTH_PARTICLES, INVERSE_DEPTH = "depth_particles", "inverse_depth"
UNKNOWN, KNOWN = "unknown", "known"


@dataclass(frozen=True)
class PriorSettings(bounds.Settings):
    """Prior of the camera's first state."""

    position_std: bounds.PositiveXYZ = (0.06, 0.046, 0.06)
    """Prior of the first position along X, Y, Z [m]."""
    orientation_std: bounds.PositiveFloat = math.radians(2.0)
    """Prior of the first orientation, each axis [rad]."""
    velocity_std: bounds.PositiveFloat = 0.01
    """Prior of the first velocity, each axis [m/s]."""
    angular_velocity_std: bounds.PositiveFloat = 0.01
    """Prior of the first angular velocity, each axis [rad/s]."""
    labelled_first_match: bounds.Switch = False
    """Whether the first match of the fiducials is given with its labels (needed for a large ``orientation_std``)."""


@dataclass(frozen=True)
class FilterSettings(bounds.Settings):
    """The estimator and its settings."""

    initialisation: Annotated[str, bounds.among(*INITIALISATIONS)] = INVERSE_DEPTH
    """``inverse_depth`` (undelayed, Montiel, Civera and Davison 2006) or ``depth_particles`` (the paper's)."""
    estimator: bounds.Part = "ekf"
    """The estimator: `ekf`, `ekf-plain`, or one of your own (`slam.estimate`)."""
    association: Annotated[str, bounds.among(UNKNOWN, KNOWN)] = UNKNOWN
    """``unknown``; ``known``: each detection carries the label of its landmark, an upper bound for data association."""
    detection_probability: bounds.Probability = 0.98
    """Detection probability that the filter assumes for a point in the image. Lower it where boxes occlude points."""
    gate_probability: bounds.Probability = 0.99
    """Mass of the chi-square gate of a match made at once (2 dof)."""
    new_feature_gate_probability: bounds.Probability = 0.9999
    """A new feature must lie outside this gate of every predicted feature, a joint match inside."""
    new_feature_detections: bounds.PositiveInt = 3
    """Consecutive detections that initialise a feature."""
    mapped_depth_ratio: bounds.PositiveFloat = 0.3
    """A feature is mapped when the standard deviation of its depth over its depth is under this."""
    maximum_misses: bounds.PositiveInt = 10
    """A feature predicted well inside the image and not matched in so many consecutive frames is deleted."""
    miss_spacing: bounds.NonNegativeFloat = 0.0
    """Misses from positions nearer to each other than this count once, since one occlusion causes them all [m]."""
    restarts: bounds.Switch = True
    """Whether the filter is reset when the fiducials contradict its estimate for a while (`slam.restart`)."""
    particle_count: bounds.ParticleCount = 100
    """Depth particles of a ray."""
    particle_depth: bounds.PositiveRange = (0.3, 9.0)
    """Nearest and farthest depth of a particle [m]."""
    particle_prune: bounds.Probability = 0.05
    """A particle with less than this share of the mean weight is dropped."""
    particle_baseline: bounds.PositiveFloat = 0.1
    """Motion between two re-weightings of the same ray [m]."""
    ray_capacity: bounds.PositiveInt = 8
    """Rays that may be followed at the same time."""
    ray_age: bounds.PositiveFloat = 10.0
    """A ray that is no point after this time is deleted [s]."""
    inverse_depth_mean: bounds.PositiveFloat = 0.5
    """First inverse depth of a feature [1/m]."""
    inverse_depth_std: bounds.PositiveFloat = 0.3
    """Its standard deviation [1/m]."""
    inverse_depth_memory: bounds.PositiveFloat = 1.0
    """An inverse-depth feature that is not matched for this time is deleted [s]."""
    linearity_threshold: bounds.PositiveFloat = 0.2
    """Linearity index under which an inverse-depth feature is converted to XYZ (Civera, Davison and Montiel 2008)."""
