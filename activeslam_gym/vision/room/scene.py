"""Draw a room: what stands in it, what hangs on its walls, and the known target before the start."""

import numpy as np

from activeslam_gym.config import Scenario
from activeslam_gym.vision.room import patterns
from activeslam_gym.vision.room.geometry import SURFACE, Scene, box_faces, decal, papered
from activeslam_gym.vision.room.textures import texture_library, texture_range

TARGET_SIZE = (0.30, 0.21)
"""Width and height of the black rectangle [m]."""
SHEET_SIZE = (
    TARGET_SIZE[0] / (1.0 - 2.0 * patterns.TARGET_MARGIN),
    TARGET_SIZE[1] / (1.0 - 2.0 * patterns.TARGET_MARGIN),
)
"""And of the white board that it is printed on."""
BOX_COUNT = 7
"""With the cabinet that bears the target."""
POSTER_COUNT = 20
_FREE_RADIUS = 1.3
"""In plan, no box comes nearer to the start [m], but for the cabinet, which is as far away as the fiducials are."""
_GAP = 0.06
"""Between boxes, and between a box and a wall [m]."""
_CABINET = np.array([0.62, 0.0, 0.35])
"""Its width and depth [m]; its height is the target's."""
_LIGHT = {0: 0.86, 1: 0.62, 2: 1.0}
"""The share of the light that faces get, by the axis of their normal: the lamps hang in the middle of the room."""

Rectangles = list[np.recarray]


def draw_scene(scenario: Scenario, rng: np.random.Generator, library: int = 0) -> Scene:
    """A room of the scenario's size, with the textures of the ``library`` of that seed.

    The camera starts at the centre, facing +Z: the target is at ``fiducial_distance`` before it, near the image's
    middle. Nothing else is within 1.3 m of it.
    """
    room = 0.5 * np.array([[-1.0], [1.0]]) * np.array(scenario.room_size)
    board = np.array(SHEET_SIZE)
    boxes = _draw_boxes(room, _draw_cabinet(room, scenario.fiducial_distance, board, rng), rng)
    walls = box_faces(room, inside=True)
    sides = [box_faces(box) for box in boxes]
    target = decal(sides[0][4], np.array([0.5 * _CABINET[0], 0.5 * board[1] + 0.05]), board)
    papered(target, texture_range(patterns.target)[0])
    posters = _draw_posters(walls, sides, target, rng)
    for owner, faces in enumerate([*sides, walls]):
        for rectangle in faces:
            rectangle.owner = owner
    _paper_walls(walls, rng)
    for faces in sides:
        _paper_box(faces, rng)
    surfaces = np.concatenate([target, *posters, *(rectangle for faces in [*sides, walls] for rectangle in faces)])
    return Scene(np.array(surfaces, SURFACE), boxes, _target_corners(target), texture_library(library))


# Boxes ----------------------------------------------------------------------------------------------------------------


def _draw_cabinet(
    room: np.ndarray, distance: tuple[float, float], board: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """The box (2, 3) that stands before the start with the target on its front, at the height of the eyes."""
    z = min(rng.uniform(*distance), room[1, 2] - _CABINET[2] - _GAP)
    x = rng.uniform(-0.25, 0.25) * z
    top = rng.uniform(-0.1, 0.15) * z + 0.5 * board[1] + 0.05
    low, high = np.array([x, room[0, 1], z]), np.array([x, top, z]) + np.array([0.0, 0.0, _CABINET[2]])
    low[0], high[0] = x - 0.5 * _CABINET[0], x + 0.5 * _CABINET[0]
    return np.array([low, high])


def _draw_boxes(room: np.ndarray, cabinet: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """All boxes (B, 2, 3), the cabinet first: crates on the floor, one pillar, one lamp case under the ceiling."""
    boxes = [cabinet]
    while len(boxes) < BOX_COUNT:
        size = np.array([rng.uniform(0.35, 0.9), rng.uniform(0.4, 1.3), rng.uniform(0.35, 0.9)])
        if len(boxes) == 1:
            size = np.array([0.28, room[1, 1] - room[0, 1], 0.28])
        if len(boxes) == 2:
            size[1] = 0.35
        reach = np.maximum(room[1] - 0.5 * size - _GAP, 0.0)
        centre = rng.uniform(-reach, reach)
        hangs = len(boxes) == 2
        centre[1] = room[1, 1] - 0.5 * size[1] if hangs else room[0, 1] + 0.5 * size[1]
        box = np.array([centre - 0.5 * size, centre + 0.5 * size])
        if _stands_free(box, boxes):
            boxes.append(box)
    return np.array(boxes)


def _stands_free(box: np.ndarray, others: list[np.ndarray]) -> bool:
    """Whether a box (2, 3) is away from the others and the start in plan, and does not stand before the target."""
    nearest = np.clip(0.0, box[0], box[1])
    if np.hypot(nearest[0], nearest[2]) < _FREE_RADIUS:
        return False
    cabinet = others[0]
    sight = np.array([np.minimum(cabinet[0], -0.3), np.maximum(cabinet[1], 0.3)])
    sight[0, 2] = 0.0
    return all(_apart(box, other) for other in [*others, sight])


def _apart(a: np.ndarray, b: np.ndarray) -> bool:
    """Whether the plans of two boxes (2, 3) keep their distance."""
    return any(a[1, axis] + _GAP <= b[0, axis] or b[1, axis] + _GAP <= a[0, axis] for axis in (0, 2))


# Posters --------------------------------------------------------------------------------------------------------------


def _draw_posters(
    walls: Rectangles, sides: list[Rectangles], target: np.recarray, rng: np.random.Generator
) -> Rectangles:
    """Posters on the upright faces of the room and the boxes, none over another, and most of them different."""
    pictures = rng.permutation(texture_range(patterns.poster))
    faces = [(len(sides), wall, 0.45, 0.95) for wall in (walls[0], walls[1], walls[4], walls[5])] * 3
    faces += [(owner, side, 0.2, 0.32) for owner, box in enumerate(sides) for side in (box[0], box[1], box[4], box[5])]
    faces = faces[:12] + [faces[12 + i] for i in rng.permutation(len(faces) - 12)]
    posters: Rectangles = []
    while len(posters) < POSTER_COUNT:
        owner, on, smallest, largest = faces[len(posters) % len(faces)]
        poster = _place(on, [target, *posters], rng.uniform(smallest, largest), rng)
        papered(poster, pictures[len(posters) % len(pictures)])
        poster.owner = owner
        posters.append(poster)
    target.owner = 0
    return posters


def _place(on: np.recarray, others: Rectangles, width: float, rng: np.random.Generator) -> np.recarray:
    """A rectangle about ``width`` [m] wide somewhere on a face, clear of the others; smaller if it finds no place."""
    sides = np.array([np.linalg.norm(on.along[0]), np.linalg.norm(on.down[0])])
    while True:
        size = np.minimum(width * np.array([1.0, rng.uniform(0.7, 1.4)]), 0.8 * sides)
        poster = decal(on, rng.uniform(0.5 * size + 0.02, sides - 0.5 * size - 0.02), size)
        if all(_clear(poster, other) for other in others):
            return poster
        width *= 0.93


def _clear(a: np.recarray, b: np.recarray) -> bool:
    """Whether the bounding boxes of two rectangles are apart by a centimetre along some axis."""
    low_a, high_a, low_b, high_b = (*_bounds(a), *_bounds(b))
    return bool(np.any((low_a > high_b + 0.01) | (low_b > high_a + 0.01)))


def _bounds(surface: np.recarray) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest coordinates (3,) of a rectangle."""
    ends = np.array([surface.corner[0], surface.corner[0] + surface.along[0] + surface.down[0]])
    return ends.min(0), ends.max(0)


# Textures -------------------------------------------------------------------------------------------------------------


def _paper_walls(walls: Rectangles, rng: np.random.Generator) -> None:
    """Poor and repeated textures on the walls, a rich one on the floor."""
    upright = rng.permutation(
        np.append(texture_range(patterns.plaster), texture_range(patterns.bricks, patterns.wallpaper))
    )
    floor = rng.choice(texture_range(patterns.tiles, patterns.planks, patterns.carpet))
    kinds = [upright[0], upright[1], floor, texture_range(patterns.ceiling)[0], upright[2], upright[3]]
    for index, (wall, kind) in enumerate(zip(walls, kinds, strict=True)):
        papered(wall, kind, rng.uniform(1.4, 2.0), _LIGHT[index // 2])
        wall.texel = rng.uniform(0.0, 256.0, 2)
        if index == 2:
            wall.brightness = 0.8  # the floor, which the lamps shine on


def _paper_box(faces: Rectangles, rng: np.random.Generator) -> None:
    """One material for all faces of a box."""
    kind = rng.choice(texture_range(patterns.crate, patterns.books, patterns.planks, patterns.carpet))
    once = kind in texture_range(patterns.crate, patterns.books)
    for index, surface in enumerate(faces):
        papered(surface, kind, None if once else 0.8, _LIGHT[index // 2] if index != 3 else 1.05)


def _target_corners(target: np.recarray) -> np.ndarray:
    """The corners of the black rectangle on its board (4, 3) [m]."""
    low, high = patterns.TARGET_MARGIN, 1.0 - patterns.TARGET_MARGIN
    shares = np.array([[low, low], [high, low], [high, high], [low, high]])
    return target.corner[0] + shares[:, :1] * target.along[0] + shares[:, 1:] * target.down[0]
