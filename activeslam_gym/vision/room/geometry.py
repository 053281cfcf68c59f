"""The room as data: textured rectangles, inside the room and outside boxes; rays that meet them, those in view.

A rectangle is corner + s along + t down with s and t in [0, 1]; to somebody who faces it, ``along`` runs to the right
and ``down`` downwards. It is seen from the side of its normal alone.

The ray (x, y, 1) in camera axes meets a rectangle's plane at a depth 1/w and at a texel (u/w, v/w), where u, v and w
are linear in (x, y): a homography. It holds beyond the edges too, where a pixel may still be covered in part. Boxes
are asked from front to back, which needs no depth per pixel: what is seen of a convex box does not hide itself, and of
two boxes with a plane between them, the one on the camera's side cannot be hidden by the other.
"""

import math
from typing import NamedTuple

import numpy as np

from activeslam_gym.camera import camera_from_world, ray_from_pixel, world_from_camera
from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.kernels import Record, compiled, record
from activeslam_gym.motion import QUATERNION
from activeslam_gym.vision.templates import TEMPLATE_HALF

SURFACE = record(
    corner=("f8", 3),  # in the world [m], as the edges are
    along=("f8", 3),
    down=("f8", 3),
    normal=("f8", 3),
    owner="i8",  # the number of a box, or of boxes for the room itself
    plane="i8",  # the number of the first rectangle in its plane: a wall and its posters are in one
    texture="i8",
    texel=("f8", 2),  # at its corner
    texels=("f8", 2),  # how many it is long and high
    brightness="f8",  # the share of the light that it gets
)
"""A rectangle and its texture."""


class Scene(NamedTuple):
    """A room."""

    surfaces: np.ndarray  # (S,) of SURFACE. A poster stands before the face that it hangs on, so that it is met first
    boxes: np.ndarray  # (B, 2, 3) their lowest and highest corners [m]. Their plans do not overlap
    target: np.ndarray  # (4, 3) corners of the black rectangle [m]: top left, top right, bottom left, bottom right
    textures: np.ndarray  # the library that the surfaces refer to, see `texture_library`


SIGHT = record(
    rows=("f4", (3, 3)),  # u, v, w of its homography [texels/m, texels/m, 1/m]
    low=("f4", 2),  # its least texel
    high=("f4", 2),  # and its greatest
    inside=("f8", (5, 3)),  # linear forms of the ray, all positive in its inside: from its four edges, and w
    plane="i8",
    texture="i8",
    brightness="f4",
)
"""A rectangle as a pose sees it."""

OUTSIDE, PARTLY, WHOLLY = 0, 1, 2
_NEAREST = 1e-6  # of a plane, to be seen from its front [m]


@compiled
def look(scene: Scene, state: np.ndarray, view: np.ndarray, sights: np.ndarray) -> int:
    """Fill ``sights`` with the rectangles that the camera ``state`` may see within ``view``; how many.

    From front to back, the room itself at last.
    """
    R_WC = rotation_matrix(state[QUATERNION])
    count, boxes = 0, scene.boxes.shape[0]
    done = np.zeros(boxes, np.bool_)
    for turn in range(boxes + 1):
        owner = boxes
        if turn < boxes:
            owner = _next_box(scene.boxes, state, done)
            done[owner] = True
        for k in range(scene.surfaces.shape[0]):
            if scene.surfaces[k].owner == owner and _sight_of(scene.surfaces[k], state, R_WC, sights[count]):
                if place(sights[count], view) != OUTSIDE:
                    count += 1
    return count


@compiled
def _next_box(boxes: np.ndarray, origin: np.ndarray, done: np.ndarray) -> int:
    """A box (B, 2, 3) that none of the others hides, of those that are not ``done``; the first, if each is hidden.

    (Three boxes hide each other in a ring only if they stand round about the camera, which never sees all three.)
    """
    first = -1
    for a in range(boxes.shape[0]):
        hidden = done[a]
        if first < 0 and not hidden:
            first = a
        for b in range(boxes.shape[0]):
            hidden = hidden or (b != a and not done[b] and _may_hide(boxes[b], boxes[a], origin))
        if not hidden:
            return a
    return first


@compiled
def _may_hide(b: np.ndarray, a: np.ndarray, origin: np.ndarray) -> bool:
    """Whether box ``b`` (2, 3) may be before ``a``: unless a plane has them apart, and the camera on a's side."""
    for i in range(3):
        before, behind = a[1, i] <= b[0, i], b[1, i] <= a[0, i]
        if (before and origin[i] <= b[0, i]) or (behind and origin[i] >= b[1, i]):
            return False
    return True


@compiled
def _sight_of(surface: Record, origin: np.ndarray, R_WC: np.ndarray, sight: Record) -> bool:
    """Write the homography and the forms of ``surface`` into ``sight``. False if the camera is behind it.

    With d the ray in the world, n the normal and h = n . (p - corner): 1/depth = w = -n . d / h. Along the edge a, the
    share of the way is s = a . (p + d/w - corner) / a.a, so that s w = w a . (p - corner) / a.a + a . d / a.a.
    """
    n, a, d, texel, texels = surface.normal, surface.along, surface.down, surface.texel, surface.texels
    away = origin[:3] - surface.corner
    height = np.sum(n * away)
    if height < _NEAREST:
        return False
    along, down, along_square, down_square = np.sum(a * away), np.sum(d * away), np.sum(a * a), np.sum(d * d)
    n_C, a_C, d_C = camera_from_world(R_WC, n), camera_from_world(R_WC, a), camera_from_world(R_WC, d)
    for j in range(3):
        w = -n_C[j] / height
        u = texels[0] * (w * along + a_C[j]) / along_square + texel[0] * w
        v = texels[1] * (w * down + d_C[j]) / down_square + texel[1] * w
        sight.rows[0, j], sight.rows[1, j], sight.rows[2, j] = u, v, w
        sight.inside[0, j], sight.inside[1, j] = u - texel[0] * w, (texel[0] + texels[0]) * w - u
        sight.inside[2, j], sight.inside[3, j] = v - texel[1] * w, (texel[1] + texels[1]) * w - v
        sight.inside[4, j] = w
    for i in range(2):
        sight.low[i], sight.high[i] = texel[i], texel[i] + texels[i]
    sight.plane, sight.texture, sight.brightness = surface.plane, surface.texture, surface.brightness
    return True


@compiled
def place(sight: Record, bounds: np.ndarray) -> int:
    """How a rectangle lies to the rays of ``bounds`` (4,), see `Lens`: OUTSIDE them, PARTLY or WHOLLY over them.

    A linear form a x + b y + c over a box of rays is its value at the middle, give or take |a| and |b| half sides.
    """
    x, y = 0.5 * (bounds[0] + bounds[1]), 0.5 * (bounds[2] + bounds[3])
    half_x, half_y = 0.5 * (bounds[1] - bounds[0]), 0.5 * (bounds[3] - bounds[2])
    answer = WHOLLY
    for k in range(5):
        a, b, c = sight.inside[k, 0], sight.inside[k, 1], sight.inside[k, 2]
        middle, reach = a * x + b * y + c, abs(a) * half_x + abs(b) * half_y
        if middle + reach <= 0.0:
            return OUTSIDE
        if middle - reach <= 0.0:
            answer = PARTLY
    return answer


@compiled
def inverse_depth_at(sight: Record, x: float, y: float) -> float:
    """1/depth [1/m] of the rectangle along the ray (x, y, 1), or zero where it is not."""
    form = 0.0
    for k in range(5):
        form = sight.inside[k, 0] * x + sight.inside[k, 1] * y + sight.inside[k, 2]
        if form < 0.0:
            return 0.0
    return form  # the last is w


@compiled
def candidates(sights: np.ndarray, count: int, bounds: np.ndarray, out: np.ndarray) -> tuple[int, bool]:
    """The first ``count`` of the ``sights`` that a tile may show, into ``out``, up to one that covers it: how many, and
    whether the last of them covers the tile."""
    found = 0
    for k in range(count):
        where = place(sights[k], bounds)
        if where != OUTSIDE:
            out[found] = k
            found += 1
        if where == WHOLLY:
            return found, True
    return found, False


_ANYWHERE = np.array((-99.0, 99.0, -99.0, 99.0))  # bounds of rays in any image
_STEP = 0.05  # what is nearer than its surroundings by such a share is in front of them
_LEAST = 0.05  # a plane that has a smaller share of a template is not followed
_REACH = 4.0  # deviation of the Gaussian by which the contrast around a feature's pixel counts [px]


@compiled
def points_in_sight(
    scene: Scene, state: np.ndarray, camera: Record, image: np.ndarray, pixel: np.ndarray
) -> np.ndarray:
    """(m, 3) the scene points that a template of ``image`` around ``pixel`` (2,) may follow, on the ray of the pixel:
    one for each plane in it, first that of the plane with most contrast.

    The contrast is that of the squared gradient, weighted by a Gaussian of the distance from the pixel. That of an edge
    is what is in front's, and moves with it; but along the edge the template holds on to what is behind.
    """
    half, side, (h, w), count = TEMPLATE_HALF, 2 * TEMPLATE_HALF + 1, image.shape, scene.surfaces.shape[0]
    sights, shown = np.zeros(count, SIGHT), np.zeros(count, np.int64)  # one of the sights in each plane
    contrast, size = np.zeros(count), np.zeros(count)  # of each plane
    plane, distance = np.full((side, side), -1), np.full((side, side), np.inf)
    count = look(scene, state, _ANYWHERE, sights)
    for i in range(side):
        for j in range(side):
            ray = ray_from_pixel(camera, pixel + np.array((j - half, i - half), np.float64))
            for k in range(count):
                inverse_depth = inverse_depth_at(sights[k], ray[0], ray[1])
                if inverse_depth > 0.0:
                    plane[i, j], distance[i, j] = sights[k].plane, math.sqrt(np.sum(ray * ray)) / inverse_depth
                    size[plane[i, j]] += 1.0
                    shown[plane[i, j]] = k
                    break
    column, row = round(pixel[0]) - half, round(pixel[1]) - half
    for i in range(1, side - 1):
        for j in range(1, side - 1):
            v, u, front = row + i, column + j, (i, j)
            if not (0 < v < h - 1 and 0 < u < w - 1):
                continue
            for near_i in range(i - 1, i + 2):
                for near_j in range(j - 1, j + 2):
                    if distance[near_i, near_j] < min((1.0 - _STEP) * distance[i, j], distance[front]):
                        front = (near_i, near_j)
            if plane[front] >= 0:
                g_x = 0.5 * (float(image[v, u + 1]) - float(image[v, u - 1]))
                g_y = 0.5 * (float(image[v + 1, u]) - float(image[v - 1, u]))
                square = (i - half) ** 2 + (j - half) ** 2
                contrast[plane[front]] += (g_x * g_x + g_y * g_y) * math.exp(-0.5 * square / _REACH**2)
    contrast[size < _LEAST * side**2] = -1.0
    ray = ray_from_pixel(camera, pixel)
    length = math.sqrt(np.sum(ray * ray))
    sight_line = np.array(world_from_camera(rotation_matrix(state[QUATERNION]), ray / length))
    planes = int(np.sum(contrast >= 0.0))
    out = np.empty((max(planes, 1), 3))
    out[0] = state[:3] + distance[half, half] * sight_line
    for m in range(planes):
        best = int(np.argmax(contrast))
        contrast[best] = -1.0
        inverse_depth = np.sum(sights[shown[best]].inside[4] * ray)
        there = length / inverse_depth if inverse_depth > 0.0 else np.inf
        window = distance.ravel()[plane.ravel() == best]
        out[m] = state[:3] + min(max(there, window.min()), window.max()) * sight_line
    return out
