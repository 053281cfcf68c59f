"""The scenario of an experiment: the settings of all subjects in one frozen dataclass."""

from dataclasses import dataclass, replace
from typing import Annotated, Any

from activeslam_gym.config import bounds
from activeslam_gym.config.filter import FilterSettings, PriorSettings
from activeslam_gym.config.lens import LensSettings
from activeslam_gym.config.motion import MotionSettings
from activeslam_gym.config.room import RoomSettings

MOST_HELD_FRAMES = 10**4
"""No action is held for more frames: the cost of its score grows by about 2 µs with each."""
VARIABLE = (
    "room_size", "pixel_std", "missed_detection_probability", "acceleration_std", "angular_acceleration_std",
    "fiducial_distance", "box_width", "box_height",
)  # fmt: skip
"""Fields that may vary from reset to reset; the sizes of arrays depend on none of them."""
_is_variable = bounds.among(*VARIABLE).holds
_VARIED = bounds.Bound(
    f"triples (field, least, greatest), of the fields {', '.join(VARIABLE)}",
    lambda value: bounds.is_tuple(value, None, lambda one: bounds.is_tuple(one, 3) and _is_variable(one[0])),
)


@dataclass(frozen=True)
class EpisodeSettings(bounds.Settings):
    """Length of an episode, differences between episodes, and the metrics of the policies."""

    name: bounds.String = "paper"
    """Name of the scenario in tables."""
    duration: bounds.PositiveFloat = 35.0
    """Time of an episode, unless the environment is given another [s]."""
    gaze_period: bounds.PositiveFloat = 0.25
    """Time of a step [s], unless the environment is given another: rounded down to whole frames, at least one, of which
    motion period and duration are whole numbers (0.2 s where a frame is 1/15 s)."""
    varied: Annotated[tuple[tuple[str, Any, Any], ...], _VARIED] = ()
    """Fields that each reset draws uniformly between two values: (field, least, greatest)."""
    motion_criterion: bounds.Part = "mutual_information"
    """Criterion of the paper's strategies for motion in this scenario."""
    negative_information: bounds.Switch = True
    """Whether an expected landmark moves when the camera looks at it and does not find it; the paper's stays."""
    gaze_horizon: bounds.PositiveFloatOrNone = 5.0
    """Time for which a scored candidate turn is held [s], at least a gaze period; None: one gaze period."""
    plan_horizon: bounds.PositiveFloat = 12.0
    """Time over which `greedy-plus` judges each held action, to the end of the episode at most [s]."""
    plan_position_std: bounds.PositiveFloat = 0.25
    """`greedy-plus` avoids plans on which the position's standard deviation is foreseen to exceed this [m]."""
    amortised_decision: bounds.Switch = False
    """Whether one motion candidate is evaluated a frame and a command issued a second (section V of the paper)."""


# A dataclass collects the fields of its bases from the last to the first.
@dataclass(frozen=True)
class Scenario(FilterSettings, PriorSettings, MotionSettings, LensSettings, RoomSettings, EpisodeSettings):
    """One experiment. The defaults are the paper's simulation, with sound choices where the paper leaves them open.

    Raises:
        ValueError: a field is outside its range; the message names the field, its value and what is allowed.
    """

    def _check(self) -> None:
        super()._check()
        longest = MOST_HELD_FRAMES * self.frame_time
        allowed = f"at most {longest:g} s, {MOST_HELD_FRAMES} times frame_time"
        default = type(self).gaze_horizon
        self._demand("gaze_horizon", self.gaze_horizon in (None, default) or self.gaze_horizon <= longest, allowed)
        different = len({name for name, *_ in self.varied}) == len(self.varied)
        self._demand("varied", different, "triples of different fields")
        for name, least, greatest in self.varied:  # where both ends are legal, all values between them are
            for end in (least, greatest):
                replace(self, varied=(), **{name: end})
            pairs = zip(least, greatest) if isinstance(least, tuple) else [(least, greatest)]
            ordered = all(low <= high for low, high in pairs)
            self._demand("varied", ordered, f"triples with least at most greatest ({name} is not)")


BOUNDS = Scenario.BOUNDS
"""The bounds of each field, as its type states them."""
RANGES = tuple(name for name in VARIABLE if bounds.INCREASING in BOUNDS[name])
"""The variable fields that have a lower and an upper end."""
