"""The room: its size, landmarks, fiducials, boxes and inner walls, and the first pose of the camera."""

import math
from dataclasses import dataclass
from typing import Annotated

from activeslam_gym.config import bounds

UNIFORM, SURFACES, CLUSTERS = "uniform", "surfaces", "clusters"
"""Layouts of landmarks."""
CENTRE, CORNER, WALL, ANYWHERE = "centre", "corner", "wall", "anywhere"
"""First poses of the camera."""
BOXES = "boxes"
"""The compiled scene; see `world.scenes` for others."""
_OF_BOXES = ("boxes", "box_count", "inner_walls", "boxes_known", "landmark_layout")
"""Fields that another scene than `boxes` has no use for."""
_DOOR_MARGIN = 0.4
"""Least distance between the door of an inner wall and the walls of the room [m]."""


class NoRoomError(RuntimeError, ValueError):
    """A scenario leaves no space for its room: a bad value of the scenario, found at a reset."""


@dataclass(frozen=True)
class RoomSettings(bounds.Settings):
    """Geometry of the room and of the first pose."""

    scene: bounds.SceneOrMesh = BOXES
    """Scene that hides landmarks and stops the camera: `boxes`, a mesh, or one of your own (`world.scenes`)."""
    room_size: bounds.PositiveXYZ = (6.0, 2.0, 6.0)
    """Extent along X, Y (height) and Z [m]."""
    landmark_count: bounds.PositivePointCount = 27
    """Unknown point landmarks."""
    landmark_layout: Annotated[str, bounds.among(UNIFORM, SURFACES, CLUSTERS)] = UNIFORM
    """``uniform`` in the room; on ``surfaces`` of walls and boxes, by area, seen from the front; in ``clusters``."""
    cluster_count: bounds.PositivePointCount = 4
    """Number of clusters."""
    cluster_std: bounds.PositiveFloat = 0.3
    """Standard deviation of a cluster, each axis [m]."""
    point_spacing: bounds.NonNegativeFloat = 0.0
    """Least distance between two points, landmarks and fiducials, as a detector suppresses neighbours [m]."""
    landmark_prior_scale: bounds.PositiveFloat = 1.0
    """Standard deviation of an unvisited landmark's prior, over that of a landmark anywhere in the room."""
    facing_angle: bounds.Angle = math.radians(75.0)
    """Greatest angle from its surface's normal at which a landmark on a surface is seen [rad]."""
    start: Annotated[str, bounds.among(CENTRE, CORNER, WALL, ANYWHERE)] = CENTRE
    """``centre``, facing +Z; a random ``corner``, facing one of its walls; along a random ``wall``; ``anywhere``."""
    fiducial_count: bounds.PointCount = 6
    """Points of known position, in view of the first pose."""
    fiducial_distance: bounds.PositiveRange = (1.2, 2.0)
    """Nearest and farthest depth of a fiducial from the first pose [m]; on surfaces up to 1.5 times that."""
    goal_margin: bounds.NonNegativeFloat = 0.4
    """Goals are clipped to stay this far from the walls [m]."""
    wall_margin: bounds.NonNegativeFloat = 0.1
    """Least distance of the camera's centre from a wall or a box [m]."""
    boxes: bounds.Boxes = ()
    """Boxes that occlude points and stop the camera, lowest and highest corner of each [m]."""
    box_count: bounds.CountRange = (0, 0)
    """Fewest and most boxes that a reset tries to place on the floor at random."""
    box_width: bounds.PositiveRange = (0.5, 1.2)
    """Smallest and greatest side of a random box along X and Z [m]."""
    box_height: bounds.PositiveRange = (0.8, 1.8)
    """Lowest and highest random box [m]; none is higher than the room."""
    inner_walls: bounds.CountRange = (0, 0)
    """Fewest and most walls that a reset adds across the room's longer side, each with a door."""
    door_width: bounds.PositiveFloat = 1.1
    """Width of each door [m]."""
    boxes_known: bounds.Switch = False
    """Whether the filter, the scores and the observation know the boxes and the occlusion by them."""

    def _check(self) -> None:
        super()._check()
        self._demand("goal_margin", 2 * self.goal_margin < min(self.room_size), "less than half of the smallest side")
        self._demand("wall_margin", self.wall_margin <= self.goal_margin, "at most goal_margin")
        farthest, margin = self._farthest_apart, self.wall_margin
        self._demand("point_spacing", self.point_spacing <= farthest, f"at most {farthest:.3g}: its points must fit")
        for name in _OF_BOXES if self.has_foreign_scene else ():
            default = getattr(RoomSettings, name)
            self._demand(name, getattr(self, name) == default, f"{default!r} where scenario.scene is {self.scene!r}")
        around = any(all(a - margin < 0.0 < b + margin for a, b in zip(low, high)) for low, high in self.boxes)
        free = self.start != CENTRE or not around
        self._demand("boxes", free, f"{margin:g} m or more from the start at the centre")
        widest = min(self.room_size[::2]) - 2.0 * _DOOR_MARGIN
        fits = self.inner_walls[1] == 0 or self.door_reach >= 0.0
        self._demand("door_width", fits, f"at most {widest:.3g} m, with {_DOOR_MARGIN} m of wall beside the door")

    @property
    def _farthest_apart(self) -> float:
        """Spacing at which points placed one by one still fit: a square, or cube, for each fills half the space [m]."""
        (x, y, z), points = self.room_size, self.landmark_count + self.fiducial_count
        if self.on_surfaces:
            return math.sqrt(y * (x + z) / points)
        space = min(x * y * z, (4.0 * self.cluster_std) ** 3) if self.landmark_layout == CLUSTERS else x * y * z
        return (0.5 * space / points) ** (1.0 / 3.0)

    @property
    def box_capacity(self) -> int:
        """The most boxes that a room can have; a wall with a door is two."""
        return len(self.boxes) + self.box_count[1] + 2 * self.inner_walls[1]

    @property
    def door_reach(self) -> float:
        """The greatest distance between the middles of an inner wall and of its door [m]."""
        return 0.5 * min(self.room_size[::2]) - _DOOR_MARGIN - 0.5 * self.door_width

    @property
    def has_boxes(self) -> bool:
        """Whether a room may have boxes."""
        return self.box_capacity > 0

    @property
    def has_foreign_scene(self) -> bool:
        """Whether the scene is a mesh or a user's own, which runs in Python."""
        return self.scene != BOXES

    @property
    def has_bodies(self) -> bool:
        """Whether something beside the room's walls may stop the camera."""
        return self.has_boxes or self.has_foreign_scene

    @property
    def has_normals(self) -> bool:
        """Whether landmarks are on surfaces with normals."""
        return self.on_surfaces or self.has_foreign_scene

    @property
    def on_surfaces(self) -> bool:
        """Whether landmarks are on surfaces, seen from their front alone."""
        return self.landmark_layout == SURFACES

    @property
    def landmark_prior_variance(self) -> tuple[float, float, float]:
        """Prior variance of an unvisited landmark along X, Y, Z [m^2]: a uniform one's, times the squared scale."""
        x, y, z = (self.landmark_prior_scale * side for side in self.room_size)
        return x * x / 12.0, y * y / 12.0, z * z / 12.0
