"""The named scenarios, the task of each, and the seeds of their episodes."""

import math
from collections.abc import Mapping
from dataclasses import asdict, fields, is_dataclass, replace
from typing import Any

from activeslam_gym.config.filter import DEPTH_PARTICLES
from activeslam_gym.config.room import ANYWHERE, CLUSTERS, CORNER, SURFACES, WALL
from activeslam_gym.config.scenario import Scenario
from activeslam_gym.registry import did_you_mean, name_of

_CALM = {"pixel_std": 1.0, "acceleration_std": 0.2, "angular_acceleration_std": 0.2}
"""Less noise, for rooms where visible landmarks are up to 6 m away, and often none is in view."""
_FURNISHED = {
    "room_size": (7.0, 2.4, 7.0), "landmark_count": 48, "landmark_layout": SURFACES, "start": ANYWHERE,
    "point_spacing": 0.3, "fiducial_distance": (1.2, 2.2), "miss_spacing": 0.3,
    "inverse_depth_mean": 0.25, "inverse_depth_std": 0.3,  # most visible landmarks are 3 to 7 m away
}  # fmt: skip
"""A room with furniture, and landmarks on surfaces."""
_HAND_HELD = {
    "frame_time": 1.0 / 15.0, "filter_acceleration_std": 4.0, "filter_angular_acceleration_std": 6.0,
    "command_known": False, "scripted_gaze_amplitude": math.radians(30.0), "amortised_decision": True,
    "motion_criterion": "mutual_information_position_map",
}  # fmt: skip
"""The paper's live camera."""
_PIXELS = {
    "landmark_count": 36,
    "fiducial_count": 4,
    "pixel_std": 0.7,
    "gaze_horizon": 3.0,
    "plan_horizon": 35.0,  # the episode: a whole turn is worth what no part of it is
    "inverse_depth_mean": 0.38,  # of the features' true depths
    "inverse_depth_std": 0.6,  # a wall at half a metre is within three deviations
}  # with 13 spare features, a map of 49
"""Images of a textured room; the fiducials are the corners of the target."""
_BARE = {
    **_PIXELS, "room_size": (7.0, 2.4, 7.0), "landmark_layout": CLUSTERS, "cluster_count": 3, "plan_position_std": 0.05,
}  # fmt: skip
"""Images of a bare room, in which groups of posters alone have features."""

SCENARIOS = dict[str, Scenario]()
"""The named scenarios, by name; more may be added."""
ASKED: dict[str, str] = {}
"""The task of a policy in each of them."""


def _add(name: str, asked: str, /, *shared: Mapping[str, Any], **own: Any) -> None:
    """Add a named scenario; where fields are given twice, the last value holds."""
    given = {field: value for part in (*shared, own) for field, value in part.items()}
    SCENARIOS[name], ASKED[name] = Scenario(**{"name": name, **given}), asked


# fmt: off
_add("paper", "the paper's simulation: improve the map and keep the camera localised")
_add("paper-literal", "the paper's simulation with its vague first pose and depth particles",
     orientation_std=math.radians(45.0), labelled_first_match=True, initialisation=DEPTH_PARTICLES,
     negative_information=False, gaze_horizon=None, gaze_period=0.05)
_add("paper-2006", "the paper's simulation with settings fitted to its six numbers (studies.paper)",
     focal_px=123.0, distortion=0.0, linearity_threshold=0.068, new_feature_detections=23, landmark_prior_scale=3.58,
     acceleration_std=0.025, angular_acceleration_std=0.61, filter_acceleration_std=0.074,
     filter_angular_acceleration_std=1.81, gaze_horizon=3.0)
_add("clutter", "false detections and missed detections",
     missed_detection_probability=0.05, clutter_rate=2.0, detection_probability=0.93, plan_horizon=16.0)
_add("hall", "many landmarks in a large hall", room_size=(14.0, 4.0, 14.0), landmark_count=120,
     gaze_horizon=3.0, plan_position_std=0.5)
_add("hand-held", "the paper's live system: a person moves the camera, and the gaze swings by a script",
     _HAND_HELD, landmark_count=48)  # "fewer than 50"
_add("office", "8 s along a wall of a large furnished office: turn to the side with landmarks",
     _FURNISHED, _CALM, room_size=(9.0, 2.4, 9.0), start=WALL, duration=8.0, box_count=(4, 8),
     gaze_horizon=3.0, plan_horizon=8.0)
_add("corridor", "8 s along a wall of a long room: turn in the direction with more landmarks",
     _FURNISHED, _CALM, room_size=(12.0, 2.4, 5.0), start=WALL, duration=8.0, box_count=(3, 6),
     gaze_horizon=8.0, plan_horizon=4.0, plan_position_std=0.125)
_add("rooms", "90 s in two or three rooms, whose plan is known: find the doors and close the loop",
     _FURNISHED, room_size=(8.0, 2.4, 4.5), landmark_count=72, inverse_depth_mean=0.3, duration=90.0,
     inner_walls=(1, 2), box_count=(0, 2), boxes_known=True,
     pixel_std=1.0, acceleration_std=0.1, angular_acceleration_std=0.1, plan_horizon=4.0)
_add("clusters", "a few distant groups of landmarks, of which only near ones are visible",
     room_size=(10.0, 2.4, 10.0), landmark_count=40, landmark_layout=CLUSTERS, cluster_count=5, start=ANYWHERE,
     maximum_distance=4.5,
     pixel_std=1.0, acceleration_std=0.07, angular_acceleration_std=0.07, plan_horizon=16.0)
_add("corner", "12 s from a corner, facing a wall: turn to the room and keep landmarks in view",
     _FURNISHED, _CALM, start=CORNER, duration=12.0,
     plan_horizon=8.0, plan_position_std=1.0)
_add("sprint", "10 s along a wall, with the room on one side: choose where to look, as time is short",
     start=WALL, duration=10.0, gaze_horizon=3.0, plan_horizon=8.0, plan_position_std=0.5)
_add("noisy", "10 s along a wall with 4 px of measurement noise and a strong process noise",
     room_size=(8.0, 2.4, 5.0), landmark_count=40, fiducial_count=10, inverse_depth_mean=0.3,
     start=WALL, duration=10.0, pixel_std=4.0, acceleration_std=0.4, angular_acceleration_std=0.4,
     gaze_horizon=8.0, plan_horizon=8.0, plan_position_std=1.0)
_add("mixed", "generalise: each reset draws the size of the room, the boxes and the noise",
     _FURNISHED, landmark_count=56, box_count=(0, 5), plan_horizon=8.0, plan_position_std=0.5, varied=(
         ("room_size", (5.0, 2.0, 5.0), (8.0, 2.8, 8.0)), ("pixel_std", 1.0, 1.5),
         ("acceleration_std", 0.05, 0.2), ("angular_acceleration_std", 0.05, 0.2)))
_add("pixels", "images of a textured room instead of points", _PIXELS)
_add("gallery-pixels", "20 s of images of a bare room with three groups of posters: find them, and lose none",
     _BARE, duration=20.0, plan_horizon=4.0)
_add("corner-pixels", "12 s of images from a corner of that room, facing a wall: find a group, and lose none",
     _BARE, start=CORNER, duration=12.0, plan_horizon=8.0)
_add("corridor-pixels", "8 s of images along a wall of a long bare room with five groups: turn to the nearest",
     _BARE, room_size=(12.0, 2.4, 5.0), cluster_count=5, start=WALL, duration=8.0, plan_horizon=8.0)
_add("hand-held-pixels", "images, with a hand-held camera whose motion the filter does not know", _PIXELS, _HAND_HELD)
# fmt: on

IMAGE_SCENARIOS = tuple(name for name in SCENARIOS if name.endswith("pixels"))
"""Those of `ActiveSLAMPixels-v0`."""
TRAINING_SEED = 2**32
"""Seeds of training episodes start here; those of benchmarks and of validation are smaller."""
_SEEDS = {
    "office": 11,
    "rooms": 21,
    "clusters": 31,
    "corner": 41,
    "sprint": 51,
    "corridor": 61,
    "mixed": 71,
    "noisy": 81,
    "gallery-pixels": 91,
    "corner-pixels": 101,
    "corridor-pixels": 111,
}
"""First seed of each scenario's benchmark, in millions."""


def benchmark_seed(name: str, validation: bool = False) -> int:
    """First of the 500 000 seeds of a scenario's held-out episodes, for the benchmark or for validation.

    A scenario without seeds of its own has those of ``paper``.
    """
    return 1_000_000 * _SEEDS.get(name, 1) + 500_000 * validation


def fields_of(scenario: Scenario) -> dict[str, Any]:
    """The fields of a scenario by name, JSON-plain: parts that are objects by their names, a mesh by its own fields."""
    values = {field.name: getattr(scenario, field.name) for field in fields(scenario)}
    if is_dataclass(scene := scenario.scene) and not isinstance(scene, type):
        values["scene"] = asdict(scene)
    return {name: name_of(value) if callable(value) else value for name, value in values.items()}


def scenario_from(value: str | Mapping[str, Any] | Scenario) -> Scenario:
    """A `Scenario` from its name, from a dict of fields, or as it is.

    Absent fields of a dict are those of the named scenario whose ``name`` it has, or else those of ``paper``.

    Raises:
        ValueError: the name or a field is unknown, or a field is outside its range.
    """
    if isinstance(value, Scenario):
        return value
    if isinstance(value, str):
        if value not in SCENARIOS:
            allowed = f"one of {', '.join(SCENARIOS)}"
            raise ValueError(f"scenario must be {allowed}, got {value!r}{did_you_mean(value, SCENARIOS)}")
        return SCENARIOS[value]
    if not isinstance(value, Mapping):
        raise ValueError(f"scenario must be a name, a dict of fields or a Scenario, got {value!r}")
    known = sorted(field.name for field in fields(Scenario))
    if unknown := [key for key in value if key not in known]:
        named = ", ".join(f"{key}{did_you_mean(key, known)}" for key in unknown)
        raise ValueError(f"scenario has no field {named}; its fields are {', '.join(known)}")
    return replace(SCENARIOS.get(str(value.get("name")), Scenario(name="custom")), **value)
