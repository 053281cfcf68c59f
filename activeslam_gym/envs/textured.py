"""What the sensors of the textured room, `images` and `corners`, demand of a scenario."""

from typing import Any

from activeslam_gym.config import BOXES, CENTRE, CLUSTERS, CORNER, INVERSE_DEPTH, UNIFORM, WALL, Scenario
from activeslam_gym.slam.estimator import EKF
from activeslam_gym.vision.opencv import opencv
from activeslam_gym.vision.room.camera import TARGET_CORNERS

_DEMANDED: dict[str, Any] = {
    "fiducial_count": TARGET_CORNERS,
    "initialisation": INVERSE_DEPTH,
    "estimator": EKF,
    "boxes": (),
    "box_count": (0, 0),
    "inner_walls": (0, 0),
    "varied": (),
    "maximum_distance": None,
    "clutter_rate": 0.0,
    "missed_detection_probability": 0.0,
    "labelled_first_match": False,
}
"""Fields of a scenario, as a textured room needs them."""
_ALLOWED = {"start": (CENTRE, CORNER, WALL), "landmark_layout": (UNIFORM, CLUSTERS)}
"""Values that they may have."""
_UNUSED = "association", "restarts", "maximum_misses", "miss_spacing", "inverse_depth_memory"
"""Fields that the front end does not read: it associates and deletes features by their looks."""
_DEMANDED |= {name: getattr(Scenario(), name) for name in _UNUSED}


def require_textured(scenario: Scenario) -> None:
    """Raise where no textured room can be made of the scenario.

    Raises:
        ValueError: a field is not as `ActiveSLAMPixelsEnv` says.
        ModuleNotFoundError: OpenCV is not installed.
    """
    opencv()
    if scenario.has_foreign_scene:
        message = f"scenario.scene must be {BOXES!r} with the sensor {scenario.sensor!r}"
        raise ValueError(f"{message}, got {scenario.scene!r}")
    for name, value in _DEMANDED.items():
        if getattr(scenario, name) != value:
            got = getattr(scenario, name)
            raise ValueError(f"scenario.{name} must be {value!r} for {scenario.sensor}, got {got!r}")
    for name, allowed in _ALLOWED.items():
        if (value := getattr(scenario, name)) not in allowed:
            message = f"scenario.{name} must be one of {', '.join(allowed)} for {scenario.sensor}"
            raise ValueError(f"{message}, got {value!r}")
