"""The rectangles in view of a pose, from front to back, and those in a tile of the image.

The ray (x, y, 1) in camera axes meets a rectangle's plane at a depth 1/w and at a texel (u/w, v/w), where u, v and w
are linear in (x, y): a homography. It holds beyond the edges too, where a pixel may still be covered in part.

Boxes are asked from front to back, which needs no depth per pixel: what is seen of a convex box does not hide itself,
and of two boxes with a plane between them, the one on the camera's side cannot be hidden by the other.
"""

import numpy as np

from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.kernels import Record, compiled, record
from activeslam_gym.motion import QUATERNION
from activeslam_gym.vision.room.geometry import Scene

SIGHT = record(
    rows=("f4", (3, 3)),  # u, v, w of its homography [texels/m, texels/m, 1/m]
    low=("f4", 2),  # its least texel
    high=("f4", 2),  # and its greatest
    inside=("f8", (5, 3)),  # linear forms of the ray, all positive in its inside: from its four edges, and w
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
    height, along, down, along_square, down_square = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(3):
        away = origin[i] - surface.corner[i]
        height += surface.normal[i] * away
        along += surface.along[i] * away
        down += surface.down[i] * away
        along_square += surface.along[i] ** 2
        down_square += surface.down[i] ** 2
    if height < _NEAREST:
        return False
    texel, texels = surface.texel, surface.texels
    for j in range(3):
        n_j, a_j, d_j = 0.0, 0.0, 0.0
        for i in range(3):
            n_j += R_WC[i, j] * surface.normal[i]
            a_j += R_WC[i, j] * surface.along[i]
            d_j += R_WC[i, j] * surface.down[i]
        w = -n_j / height
        u = texels[0] * (w * along + a_j) / along_square + texel[0] * w
        v = texels[1] * (w * down + d_j) / down_square + texel[1] * w
        sight.rows[0, j], sight.rows[1, j], sight.rows[2, j] = u, v, w
        sight.inside[0, j], sight.inside[1, j] = u - texel[0] * w, (texel[0] + texels[0]) * w - u
        sight.inside[2, j], sight.inside[3, j] = v - texel[1] * w, (texel[1] + texels[1]) * w - v
        sight.inside[4, j] = w
    for i in range(2):
        sight.low[i], sight.high[i] = texel[i], texel[i] + texels[i]
    sight.texture, sight.brightness = surface.texture, surface.brightness
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
        if form <= 0.0:
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
