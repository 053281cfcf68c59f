"""Scenarios: every physical and filter setting of an experiment, as one frozen dataclass with units.

Angles are in radians, lengths in metres and times in seconds unless a suffix says otherwise. World axes: Y is up, X and
Z are horizontal, the origin is the centre of the room. Camera axes: x left, y up, z forward (the paper's equation 1).
"""

from __future__ import annotations

import dataclasses
import math
import operator
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

DEPTH_PARTICLES = "depth_particles"
INVERSE_DEPTH = "inverse_depth"
INITIALISATIONS = (DEPTH_PARTICLES, INVERSE_DEPTH)


@dataclass(frozen=True)
class Scenario:
    """One experiment. The defaults are the paper's simulation, with the choices that the paper leaves open made sound.

    Raises:
        ValueError: a field is outside its range; the message names the field, its value and what is allowed.
    """

    name: str = "paper"
    """What the scenario is called in tables."""

    # The room -------------------------------------------------------------------------------------------------------
    room_size: tuple[float, float, float] = (6.0, 2.0, 6.0)
    """Extent along X, Y (height) and Z [m]."""
    landmark_count: int = 27
    """Unknown point landmarks, uniform in the room."""
    fiducial_count: int = 6
    """Points of known position, in view of the first pose."""
    fiducial_distance: tuple[float, float] = (1.2, 2.0)
    """Nearest and farthest depth of a fiducial from the first pose [m]."""
    goal_margin: float = 0.4
    """Goals are clipped to stay this far from the walls [m]."""
    wall_margin: float = 0.1
    """The physical wall: the camera's centre comes no closer [m]."""

    # The camera -----------------------------------------------------------------------------------------------------
    frame_time: float = 0.05
    """Time between images [s]."""
    image_width: int = 320
    """[px]"""
    image_height: int = 240
    """[px]"""
    focal_px: float = 195.0
    """f k_u = f k_v [px]."""
    principal_x_px: float = 162.0
    """u0 [px]."""
    principal_y_px: float = 125.0
    """v0 [px]."""
    distortion: float = 1.8e-5
    """K_d of equation 1 [1/px^2]."""
    minimum_depth: float = 0.1
    """Points nearer than this along the optical axis are not seen [m]."""
    pixel_std: float = 2.0
    """Standard deviation of the image noise, each axis [px]."""
    missed_detection_probability: float = 0.0
    """Chance that a visible point yields no detection in a frame."""
    clutter_rate: float = 0.0
    """Mean number of false detections in a frame (Poisson, uniform in the image)."""

    # The motion -----------------------------------------------------------------------------------------------------
    step_length: float = 0.3
    """Length of one commanded translation [m]."""
    turn_rate: float = 0.2
    """Rate of a commanded turn about the vertical [rad/s]."""
    controller_frequency: float = 5.8
    """Natural frequency of the critically damped PD controller [rad/s]."""
    rate_loop_time: float = 0.1
    """Time constant of the loop on the angular velocity [s]."""
    acceleration_std: float = 0.5
    """True disturbance of the linear acceleration, each axis, held for a frame [m/s^2]."""
    angular_acceleration_std: float = 0.5
    """True disturbance of the angular acceleration, each axis, held for a frame [rad/s^2]."""
    filter_acceleration_std: float | None = None
    """What the filter assumes [m/s^2]; None: the truth."""
    filter_angular_acceleration_std: float | None = None
    """What the filter assumes [rad/s^2]; None: the truth."""
    command_known: bool = True
    """Whether the filter knows the commanded acceleration (False: it assumes zero, as with a hand-held camera)."""
    scripted_gaze_amplitude: float = 0.0
    """If positive, the gaze swings by this angle to each side by itself and gaze actions have no effect [rad]."""
    scripted_gaze_period: float = 20.0
    """Period of that swing [s]."""

    # The prior ------------------------------------------------------------------------------------------------------
    position_std: tuple[float, float, float] = (0.06, 0.046, 0.06)
    """Prior of the first position along X, Y, Z [m]."""
    orientation_std: float = math.radians(2.0)
    """Prior of the first orientation, each axis [rad]."""
    velocity_std: float = 0.01
    """Prior of the first velocity, each axis [m/s]."""
    angular_velocity_std: float = 0.01
    """Prior of the first angular velocity, each axis [rad/s]."""
    labelled_first_match: bool = False
    """Whether the first match of the fiducials is given with its labels (needed for a large ``orientation_std``)."""

    # The filter -----------------------------------------------------------------------------------------------------
    initialisation: str = INVERSE_DEPTH
    """``inverse_depth`` (undelayed, Montiel, Civera and Davison 2006) or ``depth_particles`` (the paper's)."""
    gate_probability: float = 0.99
    """Mass of the chi-square gate of a match (2 dof)."""
    birth_gate_probability: float = 0.9999
    """A new feature must lie outside this gate of every predicted feature."""
    birth_detections: int = 3
    """Consecutive detections that give birth to a feature."""
    mapped_depth_ratio: float = 0.3
    """A feature is mapped when the standard deviation of its depth over its depth is under this."""
    maximum_misses: int = 10
    """A feature predicted well inside the image and not matched in so many consecutive frames is deleted."""
    particle_count: int = 100
    """Depth particles of a ray."""
    particle_depth: tuple[float, float] = (0.3, 9.0)
    """Nearest and farthest depth of a particle [m]."""
    particle_prune: float = 0.05
    """A particle with less than this share of the mean weight is dropped."""
    particle_baseline: float = 0.1
    """Motion between two re-weightings of the same ray [m]."""
    ray_capacity: int = 8
    """Rays that may be followed at the same time."""
    ray_age: float = 10.0
    """A ray that is no point after this time is deleted [s]."""
    inverse_depth_mean: float = 0.5
    """First inverse depth of a feature [1/m]."""
    inverse_depth_std: float = 0.3
    """Its standard deviation [1/m]."""
    inverse_depth_memory: float = 1.0
    """An inverse-depth feature, which is no point yet, is deleted when it was not matched for so long [s]."""
    linearity_threshold: float = 0.2
    """Linearity index under which an inverse-depth feature becomes a point (Civera, Davison and Montiel 2008)."""

    # The policies' metrics ------------------------------------------------------------------------------------------
    motion_criterion: str = "mutual_information"
    """Criterion of the paper's strategies for motion in this scenario."""
    amortised_decision: bool = False
    """Whether one motion candidate is evaluated a frame and a command issued a second (section V of the paper)."""

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):  # JSON turns tuples into lists
            if isinstance(getattr(self, field.name), list):
                object.__setattr__(self, field.name, tuple(getattr(self, field.name)))
        _check(self)

    @property
    def filter_acceleration_stds(self) -> tuple[float, float]:
        """What the filter assumes of the accelerations: linear [m/s^2] and angular [rad/s^2]."""
        linear, angular = self.filter_acceleration_std, self.filter_angular_acceleration_std
        return (
            self.acceleration_std if linear is None else linear,
            self.angular_acceleration_std if angular is None else angular,
        )

    @property
    def landmark_prior_variance(self) -> tuple[float, float, float]:
        """Variance of a uniform landmark along X, Y, Z [m^2]."""
        x, y, z = self.room_size
        return x * x / 12.0, y * y / 12.0, z * z / 12.0


_POSITIVE = (
    "landmark_count frame_time image_width image_height focal_px minimum_depth pixel_std step_length turn_rate "
    "controller_frequency rate_loop_time orientation_std velocity_std angular_velocity_std birth_detections "
    "mapped_depth_ratio maximum_misses particle_baseline ray_capacity ray_age inverse_depth_mean inverse_depth_std "
    "inverse_depth_memory linearity_threshold scripted_gaze_period"
).split()
_NOT_NEGATIVE = (
    "fiducial_count distortion clutter_rate acceleration_std angular_acceleration_std goal_margin wall_margin "
    "scripted_gaze_amplitude particle_prune"
).split()
_PROBABILITY = "missed_detection_probability gate_probability birth_gate_probability".split()
_INTEGER = (
    "landmark_count fiducial_count image_width image_height birth_detections maximum_misses particle_count ray_capacity"
).split()
_TRUE_OR_FALSE = "command_known labelled_first_match amortised_decision".split()


def _check(scenario: Scenario) -> None:
    def demand(name: str, holds: bool, allowed: str) -> None:
        if not holds:
            raise ValueError(f"scenario.{name} must be {allowed}, got {getattr(scenario, name)!r}")

    for name in _INTEGER:
        value = getattr(scenario, name)
        demand(name, isinstance(value, int) and not isinstance(value, bool), "a whole number")
    for name in _POSITIVE:
        demand(name, _is_number(getattr(scenario, name)) and getattr(scenario, name) > 0, "a positive number")
    for name in _NOT_NEGATIVE:
        demand(name, _is_number(getattr(scenario, name)) and getattr(scenario, name) >= 0, "zero or a positive number")
    for name in _PROBABILITY:
        demand(name, _is_number(getattr(scenario, name)) and 0 <= getattr(scenario, name) < 1, "in [0, 1)")
    for name in _TRUE_OR_FALSE:
        demand(name, isinstance(getattr(scenario, name), bool), "True or False")
    for name in ("filter_acceleration_std", "filter_angular_acceleration_std"):
        value = getattr(scenario, name)
        demand(name, value is None or (_is_number(value) and value > 0), "a positive number or None")
    for name, length in (("room_size", 3), ("position_std", 3), ("particle_depth", 2), ("fiducial_distance", 2)):
        value = getattr(scenario, name)
        positive = isinstance(value, tuple) and len(value) == length and all(_is_number(x) and x > 0 for x in value)
        demand(name, positive, f"{length} positive numbers")
    for name in ("particle_depth", "fiducial_distance"):
        demand(name, getattr(scenario, name)[0] < getattr(scenario, name)[1], "in increasing order")
    demand("initialisation", scenario.initialisation in INITIALISATIONS, f"one of {', '.join(INITIALISATIONS)}")
    demand("particle_count", scenario.particle_count >= 2, "at least 2")
    demand("goal_margin", 2 * scenario.goal_margin < min(scenario.room_size), "less than half of the smallest side")
    demand("wall_margin", scenario.wall_margin <= scenario.goal_margin, "at most goal_margin")


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


SCENARIOS: dict[str, Scenario] = {
    scenario.name: scenario
    for scenario in (
        Scenario(),
        Scenario(
            name="paper-literal",
            orientation_std=math.radians(45.0),
            labelled_first_match=True,
            initialisation=DEPTH_PARTICLES,
        ),
        Scenario(name="clutter", missed_detection_probability=0.05, clutter_rate=2.0),
        Scenario(name="hall", room_size=(14.0, 4.0, 14.0), landmark_count=120),
        Scenario(
            name="hand-held",
            landmark_count=48,  # "fewer than 50"
            frame_time=1.0 / 15.0,
            filter_acceleration_std=4.0,
            filter_angular_acceleration_std=6.0,
            command_known=False,
            scripted_gaze_amplitude=math.radians(30.0),
            motion_criterion="mutual_information_position_map",
            amortised_decision=True,
        ),
    )
}
"""The named scenarios, by name."""


def scenario_from(value: str | Mapping[str, Any] | Scenario) -> Scenario:
    """The scenario that ``value`` means: a name, a dict of fields (absent ones as in ``paper``), or a `Scenario`.

    Raises:
        ValueError: the name or a field is unknown, or a field is outside its range.
    """
    if isinstance(value, Scenario):
        return value
    if isinstance(value, str):
        if value not in SCENARIOS:
            raise ValueError(f"scenario must be one of {', '.join(SCENARIOS)}, got {value!r}")
        return SCENARIOS[value]
    if isinstance(value, Mapping):
        known = {field.name for field in dataclasses.fields(Scenario)}
        if unknown := sorted(set(value) - known):
            raise ValueError(f"scenario has no field {', '.join(unknown)}; its fields are {', '.join(sorted(known))}")
        return Scenario(**{"name": "custom", **value})
    raise ValueError(f"scenario must be a name, a dict of fields or a Scenario, got {value!r}")


def whole_multiple(name: str, value: float, unit_name: str, unit: float) -> int:
    """How many times ``unit`` fits in ``value``, which must be a whole number of them (0.15 / 0.05 counts as 3).

    Raises:
        ValueError: ``value`` is no positive finite number, or no whole multiple of ``unit``.
    """
    if not _is_number(value) or value <= 0:
        raise ValueError(f"{name} must be a positive number of seconds, got {value!r}")
    count = round(value / unit)
    if count < 1 or abs(value / unit - count) > 1e-6 * count:
        raise ValueError(f"{name} must be a whole multiple of {unit_name} ({unit:g} s), got {value!r}")
    return count


def positive_whole_number(name: str, value: Any) -> int:
    """``value`` as an int.

    Raises:
        ValueError: it is no whole number of 1 or more; the message names it.
    """
    try:
        number = operator.index(value)
    except TypeError:
        number = 0
    if number < 1 or isinstance(value, bool):
        raise ValueError(f"{name} must be a whole number of 1 or more, got {value!r}")
    return number
