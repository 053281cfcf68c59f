"""Draw a room: its boxes, the posters on its walls, and the known target before the start."""

import itertools
from collections.abc import Iterator

import numpy as np

from activeslam_gym.config import CLUSTERS, NoRoomError, Scenario
from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.kernels import Record
from activeslam_gym.motion import POSITION, QUATERNION
from activeslam_gym.vision.room import textures
from activeslam_gym.vision.room.geometry import SURFACE, Scene
from activeslam_gym.vision.room.shading import SIZE
from activeslam_gym.vision.room.textures import texture_library, texture_range

TARGET_SIZE = (0.30, 0.21)  # width and height of the black rectangle [m]
_SHARE = 1.0 - 2.0 * textures.TARGET_MARGIN
SHEET_SIZE = (TARGET_SIZE[0] / _SHARE, TARGET_SIZE[1] / _SHARE)
"""Width and height of the white board that it is printed on [m]."""
BOX_COUNT = 7  # with the cabinet that bears the target
_POSTERS = 20
_GROUP = 6  # posters of a group
_UPRIGHT = (0, 1, 4, 5)  # of the faces of a box
_FREE_RADIUS = 1.3  # in plan, no box but the cabinet, which is where the fiducials are, comes nearer to the start [m]
_GAP = 0.06  # between boxes, and between a box and a wall [m]
_CABINET = np.array((0.62, 0.0, 0.35))  # width and depth [m]; its height is the target's
_TRIES = 50_000  # places that are drawn for the boxes of a room
_SHRINKINGS = 200  # a poster that finds no place is made smaller so often
_LIGHT = (0.86, 0.62, 1.0)  # of faces, by the axis of their normal: the lamps hang in the middle of the room

ORIGIN = np.eye(1, 7, 3)[0]
"""The pose at the room's centre, facing +Z: position and quaternion."""

Rectangles = list[Record]  # of SURFACE
Spot = tuple[Record, float, float, tuple[float, float] | None]
"""Of a poster: its face, its least and greatest width, and the part of the face's length that it may be in [m], or
None: all of it."""


def draw_scene(scenario: Scenario, rng: np.random.Generator, start: np.ndarray = ORIGIN) -> Scene:
    """A room of the scenario's size, in which the camera starts at ``start`` (7,), along an axis of the room.

    The target is at ``fiducial_distance`` before it, or nearer where a wall is, and near the image's middle. No other
    box is within 1.3 m of it. Where landmarks are in clusters the room is bare, but for groups of posters on its walls.
    All is drawn in the camera's frame, and then turned and shifted. Where it finds no place, that is a NoRoomError.
    """
    turn = np.round(rotation_matrix(start[QUATERNION]))
    ends = 0.5 * np.array([[-1.0], [1.0]]) * np.array(scenario.room_size)
    room = np.sort((ends - start[POSITION]) @ turn, axis=0)
    board = np.array(SHEET_SIZE)
    try:
        boxes = _draw_boxes(room, _draw_cabinet(room, scenario.fiducial_distance, board, rng), rng)
    except NoRoomError as error:
        raise NoRoomError(f"scenario.room_size must leave space for {error}, got {scenario.room_size}") from None
    walls, sides = _faces(room, len(boxes), inside=True), [_faces(box, k) for k, box in enumerate(boxes)]
    target = _decal(sides[0][4], np.array([0.5 * _CABINET[0], 0.5 * board[1] + 0.05]), board)
    _paper(target, texture_range(textures.target)[0])
    bare = scenario.landmark_layout == CLUSTERS
    spots = _spots_in_groups(walls, scenario.cluster_count, rng) if bare else _spots_everywhere(walls, sides, rng)
    posters = _hang_posters(spots, target, rng)
    if bare:
        for surface in itertools.chain(walls, *sides):
            _paper(surface, rng.choice(texture_range(textures.plaster)), 2.0, surface.brightness)
    else:
        _paper_walls(walls, rng)
        for faces in sides:
            _paper_box(faces, rng)
    surfaces = [target, *posters, *(surface for faces in [*sides, walls] for surface in faces)]
    low, high = textures.TARGET_MARGIN, 1.0 - textures.TARGET_MARGIN
    shares = np.array([[low, low], [high, low], [low, high], [high, high]])
    corners = target.corner + shares[:, :1] * target.along + shares[:, 1:] * target.down
    every = np.array(surfaces, SURFACE)
    for field in ("corner", "along", "down", "normal"):
        every[field] = every[field] @ turn.T
    every["corner"] += start[POSITION]
    every["plane"] = _planes_of(every["normal"], every["corner"])
    placed = np.sort(boxes @ turn.T + start[POSITION], axis=1)
    return Scene(every, placed, corners @ turn.T + start[POSITION], texture_library())


def _planes_of(normals: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """(S,) the first of the rectangles with these ``normals`` (S, 3) and ``corners`` (S, 3) in the plane of each."""
    turned = np.abs(normals[:, None] - normals).max(axis=2)
    apart = np.abs(np.einsum("ai,abi->ab", normals, corners - corners[:, None]))
    return (np.maximum(turned, apart) < 1e-9).argmax(axis=1)


def _faces(box: np.ndarray, owner: int, inside: bool = False) -> Rectangles:
    """The six faces of a box (2, 3) of the number ``owner``, seen from outside or from ``inside``; -X, +X, ..., +Z.

    Upright faces have ``down`` = -Y. Directions obey down x along = normal.
    """
    extent, faces = box[1] - box[0], []
    for axis, sign in itertools.product(range(3), (-1.0, 1.0)):
        normal, down, middle = np.zeros(3), np.zeros(3), 0.5 * (box[0] + box[1])
        normal[axis] = -sign if inside else sign
        down[1 if axis != 1 else 2] = -1.0
        middle[axis] += 0.5 * sign * extent[axis]
        along = np.cross(normal, down)
        along, down = along * np.abs(along @ extent), down * np.abs(down @ extent)
        surface = np.zeros(1, SURFACE)[0]
        surface.corner, surface.along, surface.down = middle - 0.5 * (along + down), along, down
        surface.normal, surface.owner, surface.brightness = normal, owner, 1.0
        faces.append(surface)
    return faces


def _decal(on: Record, middle: np.ndarray, size: np.ndarray) -> Record:
    """A rectangle of ``size`` (2,) [m] on a face, with its middle at ``middle`` (2,) [m] from the face's corner."""
    surface = on.copy()
    right, downwards = (edge / np.linalg.norm(edge) for edge in (on.along, on.down))
    surface.corner = on.corner + right * (middle[0] - 0.5 * size[0]) + downwards * (middle[1] - 0.5 * size[1])
    surface.along, surface.down = right * size[0], downwards * size[1]
    return surface


def _sides(surface: Record) -> np.ndarray:
    """(2,) length and height of a rectangle [m]."""
    return np.array([np.linalg.norm(surface.along), np.linalg.norm(surface.down)])


def _paper(surface: Record, texture: int, period: float | None = None, brightness: float = 1.0) -> None:
    """Give the rectangle a texture that repeats every ``period`` [m], or that fits once (None)."""
    surface.texture, surface.brightness = texture, brightness
    surface.texels = SIZE * (np.ones(2) if period is None else _sides(surface) / period)


def _draw_cabinet(
    room: np.ndarray, distance: tuple[float, float], board: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """The box (2, 3) that stands before the start with the target on its front, at the height of the eyes."""
    z = min(rng.uniform(*distance), room[1, 2] - _CABINET[2] - _GAP)
    x = np.clip(rng.uniform(-0.25, 0.25) * z, room[0, 0] + 0.5 * board[0], room[1, 0] - 0.5 * board[0])
    top = min(rng.uniform(-0.1, 0.15) * z + 0.5 * board[1] + 0.05, room[1, 1])
    half = 0.5 * _CABINET[0]
    if min(z, *(np.array((room[1, 0], top - 0.05)) - room[0, :2] - board)) < 0.0:
        raise NoRoomError("the target before the camera")
    return np.array([(x - half, room[0, 1], z), (x + half, top, z + _CABINET[2])])


def _draw_boxes(room: np.ndarray, cabinet: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """All boxes (B, 2, 3), the cabinet first: crates on the floor, one pillar, one lamp case under the ceiling."""
    boxes = [cabinet]
    for _ in range(_TRIES):
        if len(boxes) == BOX_COUNT:
            return np.array(boxes)
        size = np.array([rng.uniform(0.35, 0.9), rng.uniform(0.4, 1.3), rng.uniform(0.35, 0.9)])
        hangs = len(boxes) == 2
        if len(boxes) == 1:
            size = np.array([0.28, room[1, 1] - room[0, 1], 0.28])
        if hangs:
            size[1] = 0.35
        least, most, middle = room[0] + 0.5 * size + _GAP, room[1] - 0.5 * size - _GAP, room.mean(axis=0)
        centre = rng.uniform(np.minimum(least, middle), np.maximum(most, middle))
        centre[1] = room[1, 1] - 0.5 * size[1] if hangs else room[0, 1] + 0.5 * size[1]
        box = np.array([centre - 0.5 * size, centre + 0.5 * size])
        if (np.abs(box - middle) <= 0.5 * (room[1] - room[0]) + 1e-9).all() and _stands_free(box, boxes):
            boxes.append(box)
    raise NoRoomError(f"{BOX_COUNT} boxes {_FREE_RADIUS:g} m from the camera")


def _stands_free(box: np.ndarray, others: list[np.ndarray]) -> bool:
    """Whether a box (2, 3) is away from the others and the start in plan, and does not stand before the target."""
    nearest = np.clip(0.0, box[0], box[1])
    if np.hypot(nearest[0], nearest[2]) < _FREE_RADIUS:
        return False
    sight = np.array([np.minimum(others[0][0], -0.3), np.maximum(others[0][1], 0.3)])
    sight[0, 2] = 0.0
    return all(
        any(box[1, axis] + _GAP <= other[0, axis] or other[1, axis] + _GAP <= box[0, axis] for axis in (0, 2))
        for other in [*others, sight]
    )


def _spots_everywhere(walls: Rectangles, sides: list[Rectangles], rng: np.random.Generator) -> Iterator[Spot]:
    """Of posters on the upright faces of the room and the boxes."""
    on_walls: list[Spot] = [(walls[k], 0.45, 0.95, None) for _ in range(3) for k in _UPRIGHT]
    on_boxes: list[Spot] = [(box[k], 0.2, 0.32, None) for box in sides for k in _UPRIGHT]
    spots = on_walls + [on_boxes[i] for i in rng.permutation(len(on_boxes))]
    yield from spots[:_POSTERS]


def _spots_in_groups(walls: Rectangles, count: int, rng: np.random.Generator) -> Iterator[Spot]:
    """Of ``count`` groups of posters on the upright walls of the room, each in a square as high as the wall."""
    upright = [walls[k] for k in _UPRIGHT]
    lengths = np.array([_sides(wall)[0] for wall in upright])
    for chosen in rng.choice(len(upright), count, p=lengths / lengths.sum()):
        length, height = _sides(upright[chosen])
        begin = rng.uniform(0.0, max(length - height, 0.0))
        yield from [(upright[chosen], 0.35, 0.7, (begin, min(begin + height, length)))] * _GROUP


def _hang_posters(spots: Iterator[Spot], target: Record, rng: np.random.Generator) -> Rectangles:
    """A poster at each of the ``spots``, none over another or the ``target``, and most of them different."""
    pictures, posters, taken = rng.permutation(texture_range(textures.poster)), list[Record](), [_bounding_box(target)]
    for on, smallest, largest, along in spots:
        poster = _place(on, np.array(taken), rng.uniform(smallest, largest), rng, along)
        _paper(poster, pictures[len(posters) % len(pictures)])
        posters.append(poster)
        taken.append(_bounding_box(poster))
    return posters


def _place(
    on: Record, taken: np.ndarray, width: float, rng: np.random.Generator, along: tuple[float, float] | None
) -> Record:
    """A rectangle about ``width`` [m] wide on a face, a centimetre from the bounding boxes ``taken`` (n, 2, 3); smaller
    where there is no place. ``along``: see `Spot`."""
    sides = _sides(on)
    begin, end = along or (0.0, sides[0])
    for _ in range(_SHRINKINGS):
        size = np.minimum(width * np.array([1.0, rng.uniform(0.7, 1.4)]), 0.8 * np.array([end - begin, sides[1]]))
        least, most = 0.5 * size + 0.02, sides - 0.5 * size - 0.02
        least[0], most[0] = least[0] + begin, most[0] - (sides[0] - end)
        poster = _decal(on, rng.uniform(least, most), size)
        low, high = _bounding_box(poster)
        if np.all(np.any((low > taken[:, 1] + 0.01) | (taken[:, 0] > high + 0.01), axis=1)):
            return poster
        width *= 0.93
    raise NoRoomError("scenario.room_size and scenario.cluster_count leave no place for a poster")


def _bounding_box(surface: Record) -> np.ndarray:
    """(2, 3) lowest and highest corner of a rectangle."""
    return np.sort([surface.corner, surface.corner + surface.along + surface.down], axis=0)


def _paper_walls(walls: Rectangles, rng: np.random.Generator) -> None:
    """Poor and repeated textures on the walls, a rich one on the floor."""
    kinds = texture_range(textures.plaster), texture_range(textures.bricks, textures.wallpaper)
    upright = rng.permutation(np.concatenate(kinds))
    floor = rng.choice(texture_range(textures.tiles, textures.planks, textures.carpet))
    papers = [upright[0], upright[1], floor, texture_range(textures.ceiling)[0], upright[2], upright[3]]
    light = [*np.repeat(_LIGHT, 2)]
    light[2] = 0.8  # the lamps shine on the floor
    for wall, paper, share in zip(walls, papers, light, strict=True):
        _paper(wall, paper, rng.uniform(1.4, 2.0), share)
        wall.texel = rng.uniform(0.0, 256.0, 2)


def _paper_box(faces: Rectangles, rng: np.random.Generator) -> None:
    """One material for all faces of a box."""
    kind = rng.choice(texture_range(textures.crate, textures.books, textures.planks, textures.carpet))
    once = kind in texture_range(textures.crate, textures.books)
    for index, surface in enumerate(faces):
        _paper(surface, kind, None if once else 0.8, _LIGHT[index // 2] if index != 3 else 1.05)
