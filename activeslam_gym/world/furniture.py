"""Boxes and inner walls, drawn; and what is free, hit or reached among them."""

import numpy as np

from activeslam_gym.config import Scenario

WALL_THICKNESS = 0.1  # of an inner wall [m]
PASSAGE = 0.8  # between two boxes, or a box and a wall, there is so much [m], or nothing
_CELL, _MOST_CELLS = 0.1, 400  # side of the cells in which ways are searched [m], and how many along a wall
_TRIES = 60
_REACHED_SHARE = 0.97


def draw_boxes(scenario: Scenario, rng: np.random.Generator) -> np.ndarray:
    """(B, 2, 3) the boxes of a room [m]: the scenario's own, inner walls, and what stands on the floor."""
    boxes = [np.array(box) for box in scenario.boxes]
    boxes += _inner_walls(scenario, rng)
    for _ in range(rng.integers(scenario.box_count[0], scenario.box_count[1] + 1)):
        for _ in range(_TRIES):
            box = _draw_box(scenario, rng)
            if _stands_well(box, boxes, scenario):
                boxes.append(box)
                break
    return np.reshape(boxes, (-1, 2, 3))


def _inner_walls(scenario: Scenario, rng: np.random.Generator) -> list[np.ndarray]:
    """Walls from floor to ceiling across the longer side, in about equal distances, each in two parts beside a door."""
    size, count = np.array(scenario.room_size), rng.integers(scenario.inner_walls[0], scenario.inner_walls[1] + 1)
    along = 0 if size[0] > size[2] else 2 if size[2] > size[0] else 2 * int(rng.integers(2))
    across, parts = 2 - along, []
    for k in range(count):
        middle = size[along] * ((k + 1) / (count + 1) - 0.5 + rng.uniform(-0.08, 0.08))
        door = rng.uniform(-scenario.door_reach, scenario.door_reach)
        for side in (-1.0, 1.0):
            part = np.stack((-0.5 * size, 0.5 * size))
            part[:, along] = middle - 0.5 * WALL_THICKNESS, middle + 0.5 * WALL_THICKNESS
            part[0 if side > 0 else 1, across] = door + side * 0.5 * scenario.door_width
            parts.append(part)
    return parts


def _draw_box(scenario: Scenario, rng: np.random.Generator) -> np.ndarray:
    """(2, 3) a box on the floor: somewhere, or (one of two) against a wall."""
    half = [0.5 * side for side in scenario.room_size]
    drawn, size, low = rng.random(7).tolist(), [0.0] * 3, [0.0] * 3
    for k, (least, most) in enumerate((scenario.box_width, scenario.box_height, scenario.box_width)):
        size[k] = min(least + (most - least) * drawn[k], 2.0 * half[k])
        low[k] = -half[k] + (half[k] - size[k] + half[k]) * drawn[3 + k]
    if drawn[6] < 0.5:
        axis, side = 2 * int(rng.integers(2)), int(rng.integers(2))
        low[axis] = (-half[axis], half[axis] - size[axis])[side]
    low[1] = -half[1]
    return np.array((low, [a + b for a, b in zip(low, size, strict=True)]))


def _stands_well(box: np.ndarray, boxes: list[np.ndarray], scenario: Scenario) -> bool:
    """Whether a passage is left between a ``box`` and each of the ``boxes``, and each wall that it does not touch."""
    low, high = box.tolist()
    for k in (0, 2):
        half = 0.5 * scenario.room_size[k]
        if not all(gap == 0.0 or gap >= PASSAGE for gap in (low[k] + half, half - high[k])):
            return False
    each = (other.tolist() for other in boxes)
    return all(max(max(o[0][k] - high[k], low[k] - o[1][k]) for k in (0, 2)) >= PASSAGE for o in each)


def inside_any(points: np.ndarray, boxes: np.ndarray, margin: float = 0.0) -> np.ndarray:
    """(n,) bool: which of ``points`` (n, 3) are in one of the ``boxes`` (B, 2, 3) grown by ``margin`` [m]."""
    p = points[:, None]
    inside = ((p > boxes[:, 0] - margin) & (p < boxes[:, 1] + margin)).all(axis=2)
    return np.logical_or.reduce(inside, axis=1)


def first_hits(boxes: np.ndarray, half: np.ndarray, p: np.ndarray, ways: np.ndarray) -> np.ndarray:
    """(n,) how far along each of ``ways`` (n, 3) from ``p`` (3,) the first box or wall of the room is, in ways."""
    with np.errstate(divide="ignore", invalid="ignore"):
        out = (np.where(ways > 0.0, half, -half) - p) / ways
        walls = np.where(ways == 0.0, np.inf, out).min(axis=1)
        ends = (boxes[None] - p) / ways[:, None, None]  # (n, B, 2, 3)
    if not len(boxes):
        return walls
    first, second = ends[:, :, 0], ends[:, :, 1]
    near, far = np.minimum(first, second).max(axis=2), np.maximum(first, second).min(axis=2)
    return np.minimum(walls, np.where((near < far) & (near > 0.0), near, np.inf).min(axis=1))


def reachable(scenario: Scenario, boxes: np.ndarray, place: np.ndarray, margin: float) -> bool:
    """Whether a camera at ``place`` (>= 3,) can go nearly everywhere that is free at its height, in plan.

    A way goes from one free cell to the next, of 0.1 m, or more where the room has more than `_MOST_CELLS` a side.
    """
    from scipy.ndimage import label

    half = 0.5 * np.array(scenario.room_size)
    x, z = (_cells(margin - half[k], half[k] - margin) for k in (0, 2))
    inside = np.zeros((len(x), len(z)), bool)
    for low, high in boxes:
        if low[1] - margin < place[1] < high[1] + margin:
            across = [(cells > low[k] - margin) & (cells < high[k] + margin) for k, cells in ((0, x), (2, z))]
            inside |= np.outer(*across)
    parts, _ = label(~inside)
    own = parts[np.abs(x - place[0]).argmin(), np.abs(z - place[2]).argmin()]
    return bool(own and (parts == own).sum() >= _REACHED_SHARE * (~inside).sum())


def _cells(first: float, last: float) -> np.ndarray:
    """The middles of the cells from ``first`` to ``last`` along an axis [m]."""
    size = max(_CELL, (last - first) / _MOST_CELLS)
    return np.arange(first, max(last, first + 0.5 * size), size) + 0.5 * size


def surface_points(half: np.ndarray, boxes: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """About ``count`` points [m] uniform on what shows of the walls and of the boxes, with unit normals: (<= count, 6).

    Floor and ceiling have none, nor has the top of a box. ``half`` (3,) of the room's size [m].
    """
    room = np.stack((-half, half))
    faces = [(room, axis, side, -1.0) for axis in (0, 2) for side in (0, 1)]
    faces += [(box, axis, side, 1.0) for box in boxes for axis in (0, 2) for side in (0, 1)]
    areas = np.array([(box[1, 1] - box[0, 1]) * (box[1, 2 - axis] - box[0, 2 - axis]) for box, axis, _, _ in faces])
    chosen = rng.choice(len(faces), count, p=areas / areas.sum())
    of = np.array([box for box, _, _, _ in faces])[chosen]
    axes, sides, signs = (np.array([face[k] for face in faces])[chosen] for k in (1, 2, 3))
    points = of[:, 0] + rng.random((count, 3)) * (of[:, 1] - of[:, 0])
    normals, n = np.zeros((count, 3)), np.arange(count)
    points[n, axes] = of[n, sides, axes]
    normals[n, axes] = np.where(sides, signs, -signs)
    before = points + 0.02 * normals
    shows = ~inside_any(before, boxes) & (np.abs(before) < half).all(axis=1)
    return np.hstack((points, normals))[shows]
