"""Scenarios: every physical and filter setting of an experiment, as one frozen dataclass with units and bounds.

A field's type is its bound too: ``PositiveFloat``, ``Probability``, ... are defined above `Scenario`.

Angles are in radians, lengths in metres and times in seconds unless a suffix says otherwise. World axes: Y is up, X and
Z are horizontal, the origin is the centre of the room. Camera axes: x left, y up, z forward (the paper's equation 1).
"""

import dataclasses
import math
import operator
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple, get_type_hints

from activeslam_gym.registry import Registry

DEPTH_PARTICLES = "depth_particles"
INVERSE_DEPTH = "inverse_depth"
INITIALISATIONS = (DEPTH_PARTICLES, INVERSE_DEPTH)
UNKNOWN = "unknown"
KNOWN = "known"
UNIFORM, SURFACES, CLUSTERS = "uniform", "surfaces", "clusters"
"""Where landmarks are."""
CENTRE, CORNER, WALL, ANYWHERE = "centre", "corner", "wall", "anywhere"
"""Where a run starts."""
_DOOR_MARGIN = 0.4
"""Between the door of an inner wall and the walls of the room, at least [m]."""
MOST_FRAMES = 10**9
"""Nothing lasts longer."""
MOST_HELD_FRAMES = 10**4
"""No action is held for more frames: the time that its score takes grows with them."""
BOXES = "boxes"
"""The compiled scene; another is registered (`world.scenes`)."""
_OF_BOXES = ("boxes", "box_count", "inner_walls", "boxes_known", "landmark_layout")
"""Fields that a registered scene has no use for."""


class Bound(NamedTuple):
    """What a field may be."""

    allowed: str
    """In words: "scenario.pixel_std must be <allowed>"."""
    holds: Callable[[Any], bool]
    """Of a value of any type. Where a field has several bounds, it is asked only if those to the left hold."""


def is_number(value: Any) -> bool:
    """Whether it is an int or a float, finite, and not so large that it is no float."""
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) <= sys.float_info.max


def _number(allowed: str, holds: Callable[[Any], bool] = lambda x: True) -> Bound:
    return Bound(allowed, lambda value: is_number(value) and holds(value))


def _positive_numbers(count: int) -> Bound:
    def holds(value: Any) -> bool:
        return isinstance(value, tuple) and len(value) == count and all(map(_POSITIVE.holds, value))

    return Bound(f"{count} positive numbers", holds)


def _at_most(largest: int) -> Bound:
    return Bound(f"at most {largest}", lambda value: value <= largest)


def _among(*words: str) -> Bound:
    return Bound(f"one of {', '.join(words)}", lambda value: isinstance(value, str) and value in words)


def _is_box(value: Any) -> bool:
    """Whether it is two corners, the lowest and the highest along X, Y and Z."""
    if not (isinstance(value, tuple) and len(value) == 2 and all(isinstance(corner, tuple) for corner in value)):
        return False
    low, high = value
    return len(low) == len(high) == 3 and all(map(is_number, low + high)) and all(a < b for a, b in zip(low, high))


_BOXES = Bound(
    "boxes ((x, y, z), (x, y, z)), the lowest and the highest corner of each",
    lambda value: isinstance(value, tuple) and all(map(_is_box, value)),
)
_WHOLE = _number("a whole number", lambda x: isinstance(x, int))
_POSITIVE = _number("a positive number", lambda x: x > 0)
_NOT_NEGATIVE = _number("zero or a positive number", lambda x: x >= 0)
_POSITIVE_OR_NONE = Bound("a positive number or None", lambda value: value is None or _POSITIVE.holds(value))
_NOT_NEGATIVE_OR_NONE = Bound(
    "zero, a positive number or None", lambda value: value is None or _NOT_NEGATIVE.holds(value)
)
_COUNTS = Bound(
    "two whole numbers from 0 to 100, in no decreasing order",
    lambda value: (
        isinstance(value, tuple)
        and len(value) == 2
        and all(map(_WHOLE.holds, value))
        and 0 <= value[0] <= value[1] <= 100
    ),
)
VARIABLE = (
    "room_size",
    "pixel_std",
    "missed_detection_probability",
    "acceleration_std",
    "angular_acceleration_std",
    "fiducial_distance",
    "box_width",
    "box_height",
)
"""Fields that a scenario may draw anew at each reset; the sizes of arrays depend on none of them."""
_VARIED = Bound(
    f"triples (field, least, greatest), of the fields {', '.join(VARIABLE)}",
    lambda value: (
        isinstance(value, tuple)
        and all(isinstance(one, tuple) and len(one) == 3 for one in value)
        and all(isinstance(name, str) and name in VARIABLE for name, _, _ in value)
    ),
)
_INCREASING = Bound("in increasing order", lambda pair: pair[0] < pair[1])
_SENSIBLE = Bound("of a size from 1e-12 to 1e12", lambda value: _sensible(value))


def _sensible(value: Any) -> bool:
    """Whether neither a square nor a quotient of such numbers runs out of a float's range."""
    if isinstance(value, tuple):
        return all(map(_sensible, value))
    return value is None or value == 0 or 1e-12 <= abs(value) <= 1e12


FiniteFloat = Annotated[float, _number("a finite number"), _SENSIBLE]
PositiveFloat = Annotated[float, _POSITIVE, _SENSIBLE]
NonNegativeFloat = Annotated[float, _NOT_NEGATIVE, _SENSIBLE]
NonNegativeFloatOrNone = Annotated[float | None, _NOT_NEGATIVE_OR_NONE, _SENSIBLE]
PositiveFloatOrNone = Annotated[float | None, _POSITIVE_OR_NONE, _SENSIBLE]
ClutterRate = Annotated[float, _NOT_NEGATIVE, _SENSIBLE, _at_most(200)]
Probability = Annotated[float, _number("in [0, 1)", lambda x: 0 <= x < 1)]
PositiveXYZ = Annotated[tuple[float, float, float], _positive_numbers(3), _SENSIBLE]
PositiveRange = Annotated[tuple[float, float], _positive_numbers(2), _INCREASING, _SENSIBLE]
PositiveInt = Annotated[int, _WHOLE, _POSITIVE, _at_most(10**6)]
PointCount = Annotated[int, _WHOLE, _NOT_NEGATIVE, _at_most(1000)]
PositivePointCount = Annotated[int, _WHOLE, _POSITIVE, _at_most(1000)]
ParticleCount = Annotated[int, _WHOLE, _number("at least 2", lambda x: x >= 2), _at_most(10000)]
Boxes = Annotated[tuple[tuple[tuple[float, float, float], tuple[float, float, float]], ...], _BOXES, _SENSIBLE]
CountRange = Annotated[tuple[int, int], _COUNTS]
Varied = Annotated[tuple[tuple[str, Any, Any], ...], _VARIED]
Angle = Annotated[float, _POSITIVE, Bound("at most pi / 2", lambda value: value <= math.pi / 2)]
Layout = Annotated[str, _among(UNIFORM, SURFACES, CLUSTERS)]
Start = Annotated[str, _among(CENTRE, CORNER, WALL, ANYWHERE)]
Switch = Annotated[bool, Bound("True or False", lambda value: isinstance(value, bool))]
String = Annotated[str, Bound("a string", lambda value: isinstance(value, str))]
Initialisation = Annotated[str, _among(*INITIALISATIONS)]
Association = Annotated[str, _among(UNKNOWN, KNOWN)]


@dataclass(frozen=True)
class Scenario:
    """One experiment. The defaults are the paper's simulation, with the choices that the paper leaves open made sound.

    Raises:
        ValueError: a field is outside its range; the message names the field, its value and what is allowed.
    """

    name: String = "paper"
    """What the scenario is called in tables."""

    duration: PositiveFloat = 35.0
    """Time of an episode, where the environment is not told another [s]."""

    # The room -------------------------------------------------------------------------------------------------------
    scene: String = BOXES
    """What hides landmarks and stops the camera: `boxes`, or the name of a registered scene (`world.scenes`)."""
    room_size: PositiveXYZ = (6.0, 2.0, 6.0)
    """Extent along X, Y (height) and Z [m]."""
    landmark_count: PositivePointCount = 27
    """Unknown point landmarks."""
    landmark_layout: Layout = UNIFORM
    """``uniform`` in the room; on ``surfaces`` of walls and boxes, by area, seen from the front; in ``clusters``."""
    cluster_count: PositivePointCount = 4
    """How many clusters there are."""
    cluster_std: PositiveFloat = 0.3
    """Standard deviation of a cluster, each axis [m]."""
    point_spacing: NonNegativeFloat = 0.0
    """No two points, landmarks and fiducials, are nearer to each other than this, as a detector keeps its own [m]."""
    facing_angle: Angle = math.radians(75.0)
    """Greatest angle from its surface's normal at which a landmark on a surface is seen [rad]."""
    start: Start = CENTRE
    """``centre``, facing +Z; a random ``corner``, facing one of its walls; along a random ``wall``; ``anywhere``."""
    fiducial_count: PointCount = 6
    """Points of known position, in view of the first pose."""
    fiducial_distance: PositiveRange = (1.2, 2.0)
    """Nearest and farthest depth of a fiducial from the first pose [m]."""
    goal_margin: NonNegativeFloat = 0.4
    """Goals are clipped to stay this far from the walls [m]."""
    wall_margin: NonNegativeFloat = 0.1
    """The physical wall: the camera's centre comes no closer [m]."""
    boxes: Boxes = ()
    """What hides the points behind it and stops the camera, lowest and highest corner of each [m]."""
    box_count: CountRange = (0, 0)
    """Fewest and most boxes that a reset draws beside them; they stand on the floor."""
    box_width: PositiveRange = (0.5, 1.2)
    """Smallest and greatest side of a drawn box along X and Z [m]."""
    box_height: PositiveRange = (0.8, 1.8)
    """Lowest and highest drawn box [m]; none is higher than the room."""
    inner_walls: CountRange = (0, 0)
    """Fewest and most walls that a reset draws across the room's longer side, each with a door."""
    door_width: PositiveFloat = 1.1
    """[m]"""
    boxes_known: Switch = False
    """Whether the belief knows the boxes, so that filter, scores and observation reckon with what they hide."""
    varied: Varied = ()
    """Fields that each reset draws anew, uniformly between two values: (field, least, greatest)."""

    # The camera -----------------------------------------------------------------------------------------------------
    frame_time: PositiveFloat = 0.05
    """Time between images [s]."""
    image_width: PositiveInt = 320
    """[px]"""
    image_height: PositiveInt = 240
    """[px]"""
    focal_px: PositiveFloat = 195.0
    """f k_u = f k_v [px]."""
    principal_x_px: FiniteFloat = 162.0
    """u0 [px]."""
    principal_y_px: FiniteFloat = 125.0
    """v0 [px]."""
    distortion: NonNegativeFloat = 1.8e-5
    """K_d of equation 1 [1/px^2]."""
    true_focal_px: PositiveFloatOrNone = None
    """The true camera's, where the calibration is wrong [px]; None: ``focal_px``."""
    true_distortion: NonNegativeFloatOrNone = None
    """The true camera's [1/px^2]; None: ``distortion``."""
    minimum_depth: PositiveFloat = 0.1
    """Points nearer than this along the optical axis are not seen [m]."""
    maximum_distance: PositiveFloatOrNone = None
    """Points farther than this are not seen [m]; None: seen at any distance."""
    pixel_std: PositiveFloat = 2.0
    """Standard deviation of the image noise, each axis [px]."""
    missed_detection_probability: Probability = 0.0
    """Chance that a visible point yields no detection in a frame."""
    clutter_rate: ClutterRate = 0.0
    """Mean number of false detections in a frame (Poisson, uniform in the image)."""

    # The motion -----------------------------------------------------------------------------------------------------
    step_length: PositiveFloat = 0.3
    """Length of one commanded translation [m]."""
    turn_rate: PositiveFloat = 0.2
    """Rate of a commanded turn about the vertical [rad/s]."""
    controller_frequency: PositiveFloat = 5.8
    """Natural frequency of the critically damped PD controller [rad/s]."""
    rate_loop_time: PositiveFloat = 0.1
    """Time constant of the loop on the angular velocity [s]."""
    acceleration_std: NonNegativeFloat = 0.5
    """True disturbance of the linear acceleration, each axis, held for a frame [m/s^2]."""
    angular_acceleration_std: NonNegativeFloat = 0.5
    """True disturbance of the angular acceleration, each axis, held for a frame [rad/s^2]."""
    filter_acceleration_std: PositiveFloatOrNone = None
    """What the filter assumes [m/s^2]; None: the truth."""
    filter_angular_acceleration_std: PositiveFloatOrNone = None
    """What the filter assumes [rad/s^2]; None: the truth."""
    command_known: Switch = True
    """Whether the filter knows the commanded acceleration. False: it assumes zero, and a person holds the camera, who
    moves it by own senses and not by the filter's estimate."""
    scripted_gaze_amplitude: NonNegativeFloat = 0.0
    """If positive, the gaze swings by this angle to each side by itself and gaze actions have no effect [rad]."""
    scripted_gaze_period: PositiveFloat = 20.0
    """Period of that swing [s]."""

    # The prior ------------------------------------------------------------------------------------------------------
    position_std: PositiveXYZ = (0.06, 0.046, 0.06)
    """Prior of the first position along X, Y, Z [m]."""
    orientation_std: PositiveFloat = math.radians(2.0)
    """Prior of the first orientation, each axis [rad]."""
    velocity_std: PositiveFloat = 0.01
    """Prior of the first velocity, each axis [m/s]."""
    angular_velocity_std: PositiveFloat = 0.01
    """Prior of the first angular velocity, each axis [rad/s]."""
    labelled_first_match: Switch = False
    """Whether the first match of the fiducials is given with its labels (needed for a large ``orientation_std``)."""

    # The filter -----------------------------------------------------------------------------------------------------
    initialisation: Initialisation = INVERSE_DEPTH
    """``inverse_depth`` (undelayed, Montiel, Civera and Davison 2006) or ``depth_particles`` (the paper's)."""
    estimator: String = "ekf"
    """The estimator: `ekf`, or the name of a registered one (`slam.estimator`)."""
    sensor: String = "points"
    """The sensor: `points`, `images`, or the name of a registered one (`sensors`)."""
    association: Association = UNKNOWN
    """``unknown``; ``known``: every detection tells what it is of, the ceiling of all matching."""
    detection_probability: Probability = 0.98
    """What the belief assumes: the chance that what stands in the image is detected. Lower it where things hide."""
    gate_probability: Probability = 0.99
    """Mass of the chi-square gate of a match (2 dof)."""
    birth_gate_probability: Probability = 0.9999
    """A new feature must lie outside this gate of every predicted feature."""
    birth_detections: PositiveInt = 3
    """Consecutive detections that give birth to a feature."""
    mapped_depth_ratio: PositiveFloat = 0.3
    """A feature is mapped when the standard deviation of its depth over its depth is under this."""
    maximum_misses: PositiveInt = 10
    """A feature predicted well inside the image and not matched in so many consecutive frames is deleted."""
    miss_spacing: NonNegativeFloat = 0.0
    """Misses from places nearer to each other than this count once: what hides a feature hides it from there [m]."""
    restarts: Switch = True
    """Whether a belief that the fiducials contradict for a while is given up, and begun anew (`slam.restart`)."""
    particle_count: ParticleCount = 100
    """Depth particles of a ray."""
    particle_depth: PositiveRange = (0.3, 9.0)
    """Nearest and farthest depth of a particle [m]."""
    particle_prune: Probability = 0.05
    """A particle with less than this share of the mean weight is dropped."""
    particle_baseline: PositiveFloat = 0.1
    """Motion between two re-weightings of the same ray [m]."""
    ray_capacity: PositiveInt = 8
    """Rays that may be followed at the same time."""
    ray_age: PositiveFloat = 10.0
    """A ray that is no point after this time is deleted [s]."""
    inverse_depth_mean: PositiveFloat = 0.5
    """First inverse depth of a feature [1/m]."""
    inverse_depth_std: PositiveFloat = 0.3
    """Its standard deviation [1/m]."""
    inverse_depth_memory: PositiveFloat = 1.0
    """An inverse-depth feature, which is no point yet, is deleted when it was not matched for so long [s]."""
    linearity_threshold: PositiveFloat = 0.2
    """Linearity index under which an inverse-depth feature becomes a point (Civera, Davison and Montiel 2008)."""

    # The policies' metrics ------------------------------------------------------------------------------------------
    motion_criterion: String = "mutual_information"
    """Criterion of the paper's strategies for motion in this scenario."""
    negative_information: Switch = False
    """Whether an expected landmark that was looked at and not found is expected elsewhere; the paper's would stay."""
    gaze_horizon: PositiveFloatOrNone = None
    """For how long a candidate turn is held before it is scored [s], at least a gaze period; None: one gaze period."""
    amortised_decision: Switch = False
    """Whether one motion candidate is evaluated a frame and a command issued a second (section V of the paper)."""

    def __post_init__(self) -> None:
        for name, bounds in BOUNDS.items():
            object.__setattr__(self, name, _plain(getattr(self, name)))
            for bound in bounds:
                self._demand(name, bound.holds(getattr(self, name)), bound.allowed)
        self._check_together()

    def _check_together(self) -> None:
        """What binds several fields to each other."""
        self._demand("goal_margin", 2 * self.goal_margin < min(self.room_size), "less than half of the smallest side")
        self._demand("wall_margin", self.wall_margin <= self.goal_margin, "at most goal_margin")
        farthest = self._farthest_apart
        self._demand("point_spacing", self.point_spacing <= farthest, f"at most {farthest:.3g}: its points must fit")
        for name in _OF_BOXES if self.has_registered_scene else ():
            default = getattr(Scenario, name)
            self._demand(name, getattr(self, name) == default, f"{default!r} where scenario.scene is {self.scene!r}")
        self._check_varied()
        self._check_boxes()
        frame, fastest = self.frame_time, 2.0 * (math.sqrt(2.0) - 1.0) / self.frame_time
        self._demand(
            "controller_frequency",
            self.controller_frequency < fastest,
            f"under {fastest:.3g} rad/s, 0.83 / frame_time: a faster controller is unstable",
        )
        self._demand(
            "rate_loop_time",
            self.rate_loop_time > frame / 2,
            f"over {frame / 2:.3g} s, half of frame_time, to be stable",
        )
        longest, horizon = MOST_HELD_FRAMES * frame, self.gaze_horizon
        allowed = f"at most {longest:g} s, {MOST_HELD_FRAMES} times frame_time"
        self._demand("gaze_horizon", horizon is None or horizon <= longest, allowed)

    def _check_varied(self) -> None:
        """Both ends of each varied field are legal and in order: all values between them are legal then."""
        for name, least, greatest in self.varied:
            for end in (least, greatest):
                dataclasses.replace(self, varied=(), **{name: end})
            pairs = zip(least, greatest) if isinstance(least, tuple) else [(least, greatest)]
            ordered = all(low <= high for low, high in pairs)
            self._demand("varied", ordered, f"triples with least at most greatest ({name} is not)")

    def _check_boxes(self) -> None:
        """The start at the centre is outside of the scenario's own boxes, and a door fits into an inner wall."""
        margin = self.wall_margin
        around = any(all(a - margin < 0.0 < b + margin for a, b in zip(low, high)) for low, high in self.boxes)
        free = self.start != CENTRE or not around
        self._demand("boxes", free, f"{margin:g} m or more from the start at the centre")
        widest = min(self.room_size[::2]) - 2.0 * _DOOR_MARGIN
        fits = self.inner_walls[1] == 0 or self.door_reach >= 0.0
        self._demand("door_width", fits, f"at most {widest:.3g} m, with {_DOOR_MARGIN} m of wall beside the door")

    def _demand(self, name: str, holds: bool, allowed: str) -> None:
        if not holds:
            raise ValueError(f"scenario.{name} must be {allowed}, got {getattr(self, name)!r}")

    @property
    def _farthest_apart(self) -> float:
        """So far apart points drawn one by one still fit: a square, or cube, for each fills half of the space [m]."""
        x, y, z = self.room_size
        points = self.landmark_count + self.fiducial_count
        if self.on_surfaces:
            return math.sqrt(y * (x + z) / points)
        space = min(x * y * z, (4.0 * self.cluster_std) ** 3) if self.landmark_layout == CLUSTERS else x * y * z
        return (0.5 * space / points) ** (1.0 / 3.0)

    @property
    def filter_acceleration_stds(self) -> tuple[float, float]:
        """What the filter assumes of the accelerations: linear [m/s^2] and angular [rad/s^2]."""
        linear, angular = self.filter_acceleration_std, self.filter_angular_acceleration_std
        return (
            self.acceleration_std if linear is None else linear,
            self.angular_acceleration_std if angular is None else angular,
        )

    @property
    def box_capacity(self) -> int:
        """The most boxes that a room can have; a wall with a door is two."""
        return len(self.boxes) + self.box_count[1] + 2 * self.inner_walls[1]

    @property
    def door_reach(self) -> float:
        """The greatest distance between the middles of an inner wall and of its door [m]."""
        return 0.5 * min(self.room_size[::2]) - _DOOR_MARGIN - 0.5 * self.door_width

    @property
    def draws_boxes(self) -> bool:
        """Whether a reset draws boxes or walls."""
        return self.box_count[1] + self.inner_walls[1] > 0

    @property
    def has_boxes(self) -> bool:
        """Whether a room may have boxes."""
        return self.box_capacity > 0

    @property
    def has_registered_scene(self) -> bool:
        """Whether the scene is a registered one, which runs in Python."""
        return self.scene != BOXES

    @property
    def has_bodies(self) -> bool:
        """Whether something beside the room's walls may stop the camera."""
        return self.has_boxes or self.has_registered_scene

    @property
    def has_normals(self) -> bool:
        """Whether landmarks are on surfaces with normals."""
        return self.on_surfaces or self.has_registered_scene

    @property
    def on_surfaces(self) -> bool:
        """Whether landmarks are on surfaces, seen from their front alone."""
        return self.landmark_layout == SURFACES

    @property
    def landmark_prior_variance(self) -> tuple[float, float, float]:
        """Variance of a uniform landmark along X, Y, Z [m^2]."""
        x, y, z = self.room_size
        return x * x / 12.0, y * y / 12.0, z * z / 12.0


BOUNDS: dict[str, tuple[Bound, ...]] = {
    name: hint.__metadata__ for name, hint in get_type_hints(Scenario, include_extras=True).items()
}
"""The bounds of each field, as its type states them."""
RANGES = tuple(name for name in VARIABLE if _INCREASING in BOUNDS[name])
"""The variable fields that have a lower and an upper end."""


def _plain(value: Any, levels: int = 3) -> Any:
    """The value as JSON would hold it, but for tuples: of JSON's lists, and of NumPy's scalars Python's own numbers.

    No field has more ``levels`` of nesting; an ellipsis stands for deeper ones, so that a message can show the value.
    """
    if isinstance(value, (list, tuple, dict)) and levels == 0:
        return ...
    if isinstance(value, (list, tuple)):
        return tuple(_plain(part, levels - 1) for part in value)
    if isinstance(value, dict):
        return {name: _plain(part, levels - 1) for name, part in value.items()}
    return value.item() if getattr(value, "shape", None) == () else value


_ON_SURFACES: dict[str, Any] = {
    "landmark_layout": SURFACES,
    "start": ANYWHERE,
    "point_spacing": 0.3,
    "fiducial_distance": (1.2, 2.2),
    "negative_information": True,
    "miss_spacing": 0.3,
}
"""What places have in common where landmarks are on surfaces."""
_CALM: dict[str, Any] = {"pixel_std": 1.0, "acceleration_std": 0.2, "angular_acceleration_std": 0.2}
"""A steadier hand and a sharper detector, where what is in view may be 6 m away, and often nothing is in view."""
_FURNISHED: dict[str, Any] = {
    "room_size": (7.0, 2.4, 7.0),
    "landmark_count": 48,
    "gaze_horizon": 3.0,
    "inverse_depth_mean": 0.25,  # most of what is seen is 3 to 7 m away
    "inverse_depth_std": 0.3,
} | _ON_SURFACES
"""A furnished room, as large as an office."""
_PLACES = (
    Scenario(
        name="office", duration=8.0, box_count=(4, 8), **_CALM,
        **(_FURNISHED | {"room_size": (9.0, 2.4, 9.0), "start": WALL}),
    ),
    Scenario(
        name="corridor", duration=8.0, box_count=(3, 6), **_CALM,
        **(_FURNISHED | {"room_size": (12.0, 2.4, 5.0), "start": WALL}),
    ),
    Scenario(
        name="rooms", inner_walls=(1, 2), box_count=(0, 2), boxes_known=True, duration=90.0,
        pixel_std=1.0, acceleration_std=0.1, angular_acceleration_std=0.1,
        **(_FURNISHED | {"room_size": (8.0, 2.4, 4.5), "landmark_count": 72, "inverse_depth_mean": 0.3}),
    ),
    Scenario(
        name="clusters", room_size=(10.0, 2.4, 10.0), landmark_count=40, landmark_layout=CLUSTERS, cluster_count=5,
        start=ANYWHERE, maximum_distance=4.5, negative_information=True,
        pixel_std=1.0, acceleration_std=0.07, angular_acceleration_std=0.07,
    ),
    Scenario(name="corner", duration=12.0, **(_FURNISHED | {"start": CORNER}), **_CALM),
    Scenario(name="sprint", start=WALL, duration=10.0, negative_information=True, gaze_horizon=3.0),
    Scenario(
        name="noisy", room_size=(8.0, 2.4, 5.0), landmark_count=40, fiducial_count=10, inverse_depth_mean=0.3,
        pixel_std=4.0, acceleration_std=0.4, angular_acceleration_std=0.4,
        start=WALL, duration=10.0, negative_information=True, gaze_horizon=3.0,
    ),
    Scenario(
        name="mixed", box_count=(0, 5), **(_FURNISHED | {"landmark_count": 56}),
        varied=(
            ("room_size", (5.0, 2.0, 5.0), (8.0, 2.8, 8.0)),
            ("pixel_std", 1.0, 1.5),
            ("acceleration_std", 0.05, 0.2),
            ("angular_acceleration_std", 0.05, 0.2),
        ),
    ),
)  # fmt: skip
"""Places in which looking around blindly fails."""

_HAND_HELD: dict[str, Any] = {
    "frame_time": 1.0 / 15.0,
    "filter_acceleration_std": 4.0,
    "filter_angular_acceleration_std": 6.0,
    "command_known": False,
    "scripted_gaze_amplitude": math.radians(30.0),
    "motion_criterion": "mutual_information_position_map",
    "amortised_decision": True,
}
"""The paper's live camera."""
_PIXELS: dict[str, Any] = {
    "landmark_count": 36,  # with the spare places, a map of 49: "fewer than 50"
    "fiducial_count": 4,  # the corners of the target
    "pixel_std": 0.7,
}
"""Images of a room in the place of points."""

_OWN = {
    scenario.name: scenario
    for scenario in (
        Scenario(),
        Scenario(
            name="paper-literal",
            orientation_std=math.radians(45.0),
            labelled_first_match=True,
            initialisation=DEPTH_PARTICLES,
        ),
        Scenario(name="clutter", missed_detection_probability=0.05, clutter_rate=2.0, detection_probability=0.93),
        Scenario(name="hall", room_size=(14.0, 4.0, 14.0), landmark_count=120),
        Scenario(name="hand-held", landmark_count=48, **_HAND_HELD),  # "fewer than 50"
        *_PLACES,
        Scenario(name="pixels", **_PIXELS),
        Scenario(name="hand-held-pixels", **_PIXELS, **_HAND_HELD),
    )
}
SCENARIOS: Registry[Scenario] = Registry("scenario", _OWN)
"""The named scenarios, by name."""

ASKED: dict[str, str] = {
    "paper": "the paper's simulation: how good is an action for what is known, and for what is not?",
    "paper-literal": "the same by the letter: a vague first pose, and depth particles",
    "clutter": "false detections, and missed ones",
    "hall": "many landmarks in a large hall",
    "hand-held": "the paper's live system: a hand moves the camera, and the gaze swings by itself",
    "office": "8 s along a wall of a large office, among furniture: turn to the room, where something is to be seen",
    "corridor": "8 s along a wall of a long room: which way has it more to show?",
    "rooms": "two or three rooms, with their plan: find the doors, and close the loop, in 90 s",
    "clusters": "a few groups of landmarks, far apart, in much emptiness, of which only the near is seen",
    "corner": "12 s from a corner, facing a wall: turn to the room, on the side where it is, without losing sight",
    "sprint": "10 s along a wall, the room to the left or to the right: no time to look everywhere",
    "noisy": "10 s along a wall with 4 px of image noise and a rough hand: what is worth a look?",
    "mixed": "generalise: size, furniture, image noise and roughness are drawn at each reset",
    "pixels": "images of a textured room in the place of points",
    "hand-held-pixels": "the same, with a hand-held camera whose motion the filter does not know",
}
"""What each of them asks of a policy."""

TRAINING_SEED = 2**32
"""Training draws its seeds from here up; those of benchmarks and of validation are below."""
_SEEDS = {
    "office": 11, "rooms": 21, "clusters": 31, "corner": 41, "sprint": 51, "corridor": 61, "mixed": 71, "noisy": 81,
}  # fmt: skip
"""Where each scenario's frozen rooms begin, in millions."""


def benchmark_seed(name: str, validation: bool = False) -> int:
    """The first seed of a scenario's frozen benchmark rooms, or of those for validation; each range has 500 000.

    Of a scenario with no range of its own they are those of ``paper``.
    """
    return 1_000_000 * _SEEDS.get(name, 1) + 500_000 * validation


def scenario_from(value: str | Mapping[str, Any] | Scenario) -> Scenario:
    """The scenario that ``value`` means: a name, a dict of fields (absent ones as in ``paper``), or a `Scenario`.

    Raises:
        ValueError: the name or a field is unknown, or a field is outside its range.
    """
    if isinstance(value, Scenario):
        return value
    if isinstance(value, str):
        return SCENARIOS[value]
    if isinstance(value, Mapping):
        known = {field.name for field in dataclasses.fields(Scenario)}
        if unknown := [key for key in value if key not in known]:
            raise ValueError(
                f"scenario has no field {', '.join(map(str, unknown))}; its fields are {', '.join(sorted(known))}"
            )
        return Scenario(**{"name": "custom", **value})
    raise ValueError(f"scenario must be a name, a dict of fields or a Scenario, got {value!r}")


def whole_multiple(name: str, value: float, unit_name: str, unit: float, most: int = MOST_FRAMES) -> int:
    """How many times ``unit`` fits in ``value``, which must be a whole number of them (0.15 / 0.05 counts as 3).

    Raises:
        ValueError: ``value`` is no positive finite number, no whole multiple of ``unit``, or over ``most`` of them.
    """
    value = _plain(value)
    if not is_number(value) or value <= 0:
        raise ValueError(f"{name} must be a positive number of seconds, got {value!r}")
    count = round(min(value / unit, sys.float_info.max))  # the quotient of two floats may be infinite
    if count > most:
        raise ValueError(f"{name} must be at most {most} times {unit_name} ({unit:g} s), got {value!r}")
    if count < 1 or abs(value / unit - count) > 1e-6 * count:
        raise ValueError(f"{name} must be a whole multiple of {unit_name} ({unit:g} s), got {value!r}")
    return count


def whole_number(name: str, value: Any, least: int = 1) -> int:
    """``value``, a number of Python's or NumPy's, as an int.

    Raises:
        ValueError: it is no whole number of ``least`` or more; the message names it.
    """
    try:
        number = operator.index(value)
    except TypeError:
        number = least - 1
    if number < least or isinstance(value, bool):
        raise ValueError(f"{name} must be a whole number of {least} or more, got {value!r}")
    return number


def positive_number(name: str, value: Any, unit: str) -> float:
    """``value``, a number of Python's or NumPy's, as a float; it may be infinite.

    Raises:
        ValueError: it is no positive number; the message names it.
    """
    number = _plain(value)
    if not (is_number(number) or (isinstance(number, float) and number == math.inf)) or number <= 0:
        raise ValueError(f"{name} must be a positive number of {unit}, got {value!r}")
    return float(number)
