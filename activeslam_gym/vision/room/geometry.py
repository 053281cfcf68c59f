"""The room as data: textured rectangles, on the room's inside and on the outsides of boxes, and rays that meet them.

A rectangle is corner + s along + t down with s and t in [0, 1]; to somebody who faces it, ``along`` runs to the right
and ``down`` downwards. It is seen from the side of its normal alone.
"""

import math
from typing import NamedTuple

import numpy as np

from activeslam_gym.camera import ray_from_pixel
from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.kernels import Record, compiled, record
from activeslam_gym.motion import QUATERNION
from activeslam_gym.vision.room.shading import SIZE

SURFACE = record(
    corner=("f8", 3),  # in the world [m], as the edges are
    along=("f8", 3),
    down=("f8", 3),
    normal=("f8", 3),
    owner="i8",  # the number of a box, or of boxes for the room itself
    texture="i8",
    texel=("f8", 2),  # at its corner
    texels=("f8", 2),  # how many it is long and high
    brightness="f8",  # the share of the light that it gets
)
"""A rectangle and what it shows."""

_COPLANAR = 1e-9
"""Depths that differ by less [m] are equal: a poster's and its wall's."""


class Scene(NamedTuple):
    """What is in the room."""

    surfaces: np.ndarray
    """(S,) of `SURFACE`. A poster stands before the face that it hangs on, so that it is met first."""
    boxes: np.ndarray
    """(B, 2, 3) their lowest and highest corners [m]. Their plans do not overlap."""
    target: np.ndarray
    """(4, 3) corners of the black rectangle [m]: top left, top right, bottom right, bottom left as seen."""
    textures: np.ndarray
    """The library that the surfaces refer to, see `texture_library`."""


def face(centre: np.ndarray, axis: int, sign: float, extent: np.ndarray) -> np.recarray:
    """A rectangle (1,) with the normal ``sign`` e_axis about ``centre``, as large as the box ``extent`` (3,) is there.

    Upright faces have ``down`` = -Y. Directions obey down x along = normal.
    """
    surface = np.zeros(1, SURFACE).view(np.recarray)
    normal, down = np.zeros(3), np.zeros(3)
    normal[axis] = sign
    down[1 if axis != 1 else 2] = -1.0
    along = np.cross(normal, down)
    along, down = along * np.abs(along @ extent), down * np.abs(down @ extent)
    surface.normal, surface.along, surface.down = normal, along, down
    surface.corner = centre - 0.5 * (along + down)
    surface.brightness = 1.0
    return surface


def box_faces(box: np.ndarray, inside: bool = False) -> list[np.recarray]:
    """The six faces of a box (2, 3), seen from outside or from ``inside``; -X, +X, -Y, +Y, -Z, +Z."""
    centre, extent = 0.5 * (box[0] + box[1]), box[1] - box[0]
    faces = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            middle = centre.copy()
            middle[axis] += 0.5 * sign * extent[axis]
            faces.append(face(middle, axis, -sign if inside else sign, extent))
    return faces


def decal(on: np.recarray, middle: np.ndarray, size: np.ndarray) -> np.recarray:
    """A rectangle of ``size`` (2,) [m] on a face, with its middle at ``middle`` (2,) [m] from the face's corner."""
    surface = on.copy()
    right, downwards = (edge / np.linalg.norm(edge) for edge in (on.along[0], on.down[0]))
    surface.corner = on.corner[0] + right * (middle[0] - 0.5 * size[0]) + downwards * (middle[1] - 0.5 * size[1])
    surface.along, surface.down = right * size[0], downwards * size[1]
    return surface


def papered(surface: np.recarray, texture: int, period: float | None = None, brightness: float = 1.0) -> np.recarray:
    """The rectangle with a texture that repeats every ``period`` [m], or that fits once (None)."""
    surface.texture, surface.brightness = texture, brightness
    sides = np.array([np.linalg.norm(surface.along[0]), np.linalg.norm(surface.down[0])])
    surface.texels = SIZE * (np.ones(2) if period is None else sides / period)
    return surface


@compiled
def scene_point(scene: Scene, state: np.ndarray, camera: Record, pixel: np.ndarray) -> tuple[np.ndarray, int, bool]:
    """What the pixel (2,) shows: the point (3,) [m] in the world, its surface, and whether there is one.

    ``state`` begins with the camera's position and quaternion. The nearest of all rectangles, each asked in turn.
    """
    origin, ray = state[:3], rotation_matrix(state[QUATERNION]) @ ray_from_pixel(camera, pixel)
    nearest, surface = math.inf, -1
    for k in range(scene.surfaces.shape[0]):
        depth = _depth_along(scene.surfaces[k], origin, ray)
        if depth < nearest - _COPLANAR:
            nearest, surface = depth, k
    if surface < 0:
        return np.zeros(3), surface, False
    return origin + nearest * ray, surface, True


@compiled
def _depth_along(surface: Record, origin: np.ndarray, ray: np.ndarray) -> float:
    """The multiple of ``ray`` (3,) at which it meets the rectangle's front, infinite if it does not."""
    height, approach = 0.0, 0.0
    for i in range(3):
        height += surface.normal[i] * (origin[i] - surface.corner[i])
        approach -= surface.normal[i] * ray[i]
    if height <= 0.0 or approach <= 0.0:
        return math.inf
    depth = height / approach
    for edge in (surface.along, surface.down):
        share, square = 0.0, 0.0
        for i in range(3):
            share += edge[i] * (origin[i] + depth * ray[i] - surface.corner[i])
            square += edge[i] * edge[i]
        if not 0.0 <= share <= square:
            return math.inf
    return depth
