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
"""A rectangle and its texture."""
_COPLANAR = 1e-9
"""Depths that differ by less [m] are equal: a poster's and its wall's."""


class Scene(NamedTuple):
    """A room."""

    surfaces: np.ndarray  # (S,) of SURFACE. A poster stands before the face that it hangs on, so that it is met first
    boxes: np.ndarray  # (B, 2, 3) their lowest and highest corners [m]. Their plans do not overlap
    target: np.ndarray  # (4, 3) corners of the black rectangle [m]: top left, top right, bottom left, bottom right
    textures: np.ndarray  # the library that the surfaces refer to, see `texture_library`


@compiled
def scene_point(scene: Scene, state: np.ndarray, camera: Record, pixel: np.ndarray) -> tuple[np.ndarray, int, bool]:
    """The scene point of the pixel (2,): (3,) [m] in the world, its surface, and whether there is one.

    ``state`` begins with the camera's position and quaternion. The nearest of all rectangles, each tested in turn.
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
