"""Draw a room: landmarks, fiducials, boxes, and the true start of the camera."""

import dataclasses
import math
from typing import Any, NamedTuple

import numpy as np

from activeslam_gym.camera import View, camera_of, ray_from_pixel, visible
from activeslam_gym.config import ANYWHERE, CENTRE, CLUSTERS, CORNER, RANGES, UNIFORM, WALL, NoRoomError, Scenario
from activeslam_gym.geometry import quaternion_exp, rotate_left, rotation_matrix
from activeslam_gym.kernels import uncompiled
from activeslam_gym.motion import ANGULAR_VELOCITY, CAMERA_SIZE, POSITION, QUATERNION, VELOCITY
from activeslam_gym.registry import asked, name_of, part_of
from activeslam_gym.world.furniture import draw_boxes, first_hits, inside_any, reachable, surface_points
from activeslam_gym.world.scenes import AROUND, SCENES, CheckedScene, Scene

_FIDUCIAL_IMAGE_SHARE = 0.8
"""Fiducials project into the central part of the first image, of this relative width and height."""
_CORNER_DISTANCE, _WALL_DISTANCE = 1.4, 0.7
"""Of a start in a corner from its two walls, and of one along a wall from it [m]."""
_START_MARGIN = 0.45  # between a start and whatever stops the camera [m]
_TRIES = 1000
_CROWDED_TRIES = 50  # of these so many, at most, with too little space for the landmarks
_MESHES = ".glb", ".gltf", ".obj", ".off", ".ply", ".stl"  # endings of files that are meshes
_BATCHES = 60  # so often landmarks are drawn, until enough are apart


class Room(NamedTuple):
    """What a reset draws. K fiducials, L landmarks, B boxes."""

    place: np.ndarray  # (7,) the expected first pose: position [m] and quaternion
    camera: np.ndarray  # (13,) the true first camera
    fiducials: np.ndarray  # (K, 3) [m]
    landmarks: np.ndarray  # (L, 3) [m]
    normals: np.ndarray  # (L, 3) of the surfaces that the landmarks are on, or (0, 3)
    boxes: np.ndarray  # (B, 2, 3) lowest and highest corners [m]
    scene: Scene | None = None  # the foreign scene; None: the boxes


def scene_factory(scene: Any) -> Any:
    """What makes the scenes of that name or object; of a mesh, by its file or the fields of a `world.mesh` factory."""
    fields = {"path": scene} if isinstance(scene, str) and scene.lower().endswith(_MESHES) else scene
    if isinstance(fields, dict) and {"path"} <= fields.keys() <= {"path", "up", "unit"}:
        try:
            from activeslam_gym.world.mesh import MeshFactory
        except ImportError as error:
            raise ImportError(f"scenario.scene {scene!r} needs the extra mesh: pip install trimesh embreex") from error
        return MeshFactory(**fields)
    return part_of("scenario.scene", scene, SCENES, f"a mesh (*{', *'.join(_MESHES)}, or a dict of path, up, unit)")


def draw_scene(scenario: Scenario, rng: np.random.Generator) -> Scene:
    """The scene of a reset; a wrong answer of a foreign one is a ValueError."""
    scene = asked(f"the scene {name_of(scenario.scene)!r}", scene_factory(scenario.scene), scenario, rng)
    return CheckedScene(scenario, scene) if scenario.has_foreign_scene else scene


def varied(scenario: Scenario, rng: np.random.Generator) -> Scenario:
    """The scenario with its `varied` fields drawn, number by number; itself where there are none.

    The two ends of a range are drawn, and the lower one comes first.
    """
    if not scenario.varied:
        return scenario
    drawn = {name: rng.uniform(least, greatest) for name, least, greatest in scenario.varied}
    ordered = {name: np.sort(drawn[name]) for name in RANGES if name in drawn}
    return dataclasses.replace(scenario, varied=(), **(drawn | ordered))


def draw_room(scenario: Scenario, rng: np.random.Generator) -> Room:
    """A room of the scenario.

    Landmarks are uniform in the room; fiducials are uniform in the image of the first camera and in depth. In other
    layouts, and where there are boxes, rooms are drawn until the start is free, the fiducials are in view and
    everything can be reached. A foreign scene has the landmarks on its surfaces.

    Raises:
        NoRoomError: no such room was found; the scenario's boxes or its points leave too little space, the start is
            too uncertain, or nothing stands at the distance of the fiducials.
        ValueError: a foreign scene gave a wrong answer.
    """
    beyond_wall = scenario.fiducial_distance[1] > 0.5 * scenario.room_size[2]  # fiducials may be, where it is near
    searched = beyond_wall or scenario.has_bodies or scenario.on_surfaces or scenario.point_spacing > 0.0
    searched |= scenario.start != CENTRE or not _sees_floating(scenario)
    foreign, crowded = scenario.has_foreign_scene, 0
    for _ in range(_TRIES):
        scene = draw_scene(scenario, rng) if foreign else None
        boxes = draw_boxes(scenario, rng) if searched and not foreign else np.empty((0, 2, 3))
        place = _draw_place(scenario, boxes, rng)
        if start := getattr(scene, "start", None):
            place[:3] = start(rng)
        camera = draw_start(scenario, rng, place)
        if not _is_free(scenario, boxes, camera[POSITION], scene):
            continue
        if not searched:
            landmarks, nowhere = _landmarks(scenario, boxes, np.empty((0, 3)), rng), np.empty((0, 3))
            fiducials = _floating(scenario, scenario.fiducial_count, camera, rng)
            return Room(place, camera, fiducials, landmarks, nowhere, boxes)
        seen = _in_view(scenario, boxes, camera, rng, scene)
        if seen is None or not (foreign or reachable(scenario, boxes, place, scenario.wall_margin + 0.05)):
            continue
        try:
            found = _landmarks(scenario, boxes, seen, rng, scene)
        except NoRoomError as error:
            crowded += 1
            if crowded == _CROWDED_TRIES:
                raise NoRoomError(f"{error}, in {crowded} tries") from None
            continue
        return Room(place, camera, seen, found[:, :3], found[:, 3:].reshape(-1, 3), boxes, scene)
    if foreign:
        cause = "its bodies stand where the camera starts, or hide its fiducials"
        raise NoRoomError(f"scene {name_of(scenario.scene)!r}: no room was found in {_TRIES} tries: {cause}")
    cause = "too many boxes or walls, boxes, point_spacing or position_std too large, or no view at fiducial_distance"
    raise NoRoomError(f"scenario {scenario.name!r}: no room was found in {_TRIES} tries: {cause}")


def uniform_points(scenario: Scenario, count: int, rng: np.random.Generator) -> np.ndarray:
    """``count`` points (count, 3) [m] uniform in the scenario's room."""
    return (rng.random((count, 3)) - 0.5) * np.array(scenario.room_size)


def expected_points(scenario: Scenario, room: Room, rng: np.random.Generator) -> np.ndarray:
    """(L, 3) where landmarks are expected [m]: in the room beside known boxes, or on its walls and these (surfaces)."""
    layout = scenario.landmark_layout if scenario.on_surfaces else UNIFORM
    known = room.boxes if scenario.boxes_known else room.boxes[:0]
    if layout != scenario.landmark_layout:
        scenario = dataclasses.replace(scenario, landmark_layout=layout)
    return _landmarks(scenario, known, np.empty((0, 3)), rng, spacing=0.0)[:, :3]


def _landmarks(
    scenario: Scenario,
    boxes: np.ndarray,
    taken: np.ndarray,
    rng: np.random.Generator,
    scene: Scene | None = None,
    spacing: float | None = None,
) -> np.ndarray:
    """(L, 3) landmarks in no box, or (L, 6) with the normals of the surfaces that they are on, apart from each other.

    They are as far from the ``taken`` points (n, 3) too. ``scene``: the foreign one, on which they are. ``spacing``
    [m]: in place of the scenario's.
    """
    spacing = scenario.point_spacing if spacing is None else spacing
    count, half = scenario.landmark_count, 0.5 * np.array(scenario.room_size)
    if scenario.landmark_layout == CLUSTERS:
        centres = uniform_points(scenario, scenario.cluster_count, rng) * 0.9
    apart, found = [taken], list[np.ndarray]()
    for _ in range(_BATCHES):
        if scene is not None:
            drawn = np.hstack(scene.sample(count, rng))
        elif scenario.on_surfaces:
            drawn = surface_points(half, boxes, count, rng)
        elif scenario.landmark_layout == CLUSTERS:
            around = centres[rng.integers(len(centres), size=count)]
            drawn = np.clip(around + scenario.cluster_std * rng.standard_normal((count, 3)), -half, half)
        else:
            drawn = uniform_points(scenario, count, rng)
        candidates = drawn if scenario.has_normals else drawn[~inside_any(drawn, boxes)]
        if spacing == 0.0:
            found.extend(candidates[: count - len(found)])
        else:
            free: Any = ~_near(candidates, np.concatenate(apart), spacing).any(axis=1)
            near = _near(candidates, candidates, spacing)
            for k in range(len(candidates)):
                if free[k] and len(found) < count:
                    found.append(candidates[k])
                    free &= ~near[k]
        if len(found) == count:
            return np.array(found)
        apart = [taken, *(point[None, :3] for point in found)]
    crowd = f"its landmarks do not fit in a room, {f'{spacing:g} m apart' if spacing else 'beside its boxes'}"
    raise NoRoomError(f"scenario {scenario.name!r}: {crowd}")


def _near(points: np.ndarray, others: np.ndarray, spacing: float) -> np.ndarray:
    """(n, m) bool: which of ``points`` (n, >= 3) and ``others`` (m, >= 3) are less than ``spacing`` [m] apart."""
    offsets = points[:, None, :3] - others[None, :, :3]
    return np.einsum("ijk,ijk->ij", offsets, offsets) < spacing**2


def _draw_place(scenario: Scenario, boxes: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(7,) the pose at which the belief expects the camera first."""
    half, place = 0.5 * np.array(scenario.room_size), np.zeros(7)
    place[3] = 1.0
    if scenario.start == CORNER:
        sides = rng.choice((-1.0, 1.0), size=2)
        place[[0, 2]] = sides * _from_walls(scenario, _CORNER_DISTANCE)[[0, 2]]
        axis = int(rng.integers(2))  # the wall that it faces is across this one
        _turn(place, math.atan2(sides[0] * axis, sides[1] * (1 - axis)))
    elif scenario.start == WALL:
        axis, side, way = 2 * int(rng.integers(2)), rng.choice((-1.0, 1.0)), rng.choice((-1.0, 1.0))
        place[axis], place[2 - axis] = side * _from_walls(scenario, _WALL_DISTANCE)[axis], -0.4 * way * half[2 - axis]
        _turn(place, math.atan2(way * (axis == 2), way * (axis == 0)))
    elif scenario.start == ANYWHERE:
        for _ in range(_TRIES):
            place[[0, 2]] = rng.uniform(-1.0, 1.0, 2) * _from_walls(scenario, _START_MARGIN)[[0, 2]]
            heading = rng.uniform(-math.pi, math.pi)
            if inside_any(place[None, :3], boxes, _START_MARGIN)[0]:
                continue
            way = np.array([[math.sin(heading), 0.0, math.cos(heading)]])
            ahead = first_hits(boxes, half, place[:3], way)[0]
            least = scenario.fiducial_distance
            if least[0] <= ahead <= least[1] if scenario.on_surfaces else ahead >= least[1]:
                break
        _turn(place, heading)
    return place


def _from_walls(scenario: Scenario, distance: float) -> np.ndarray:
    """(3,) coordinates that far from the walls [m], or the middle of a room whose other wall is nearer than that."""
    half = 0.5 * np.array(scenario.room_size)
    return np.where(half - distance >= scenario.wall_margin - half, half - distance, 0.0)


def _turn(place: np.ndarray, heading: float) -> None:
    """Make the pose (7,) face the ``heading`` [rad], of which 0 is +Z and a quarter turn +X."""
    place[3:7] = math.cos(0.5 * heading), 0.0, math.sin(0.5 * heading), 0.0


def draw_start(scenario: Scenario, rng: np.random.Generator, place: np.ndarray) -> np.ndarray:
    """The true first camera (13,), drawn by the prior about ``place`` (7,)."""
    camera = np.empty(CAMERA_SIZE)
    camera[POSITION] = place[:3] + np.array(scenario.position_std) * rng.standard_normal(3)
    turned = scenario.orientation_std * rng.standard_normal(3)
    camera[QUATERNION] = quaternion_exp(turned)
    camera[VELOCITY] = scenario.velocity_std * rng.standard_normal(3)
    camera[ANGULAR_VELOCITY] = scenario.angular_velocity_std * rng.standard_normal(3)
    if place[3] != 1.0:
        camera[QUATERNION] = rotate_left(turned, place[3:])
    return camera


def _floating(scenario: Scenario, count: int, start: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(count, 3) fiducials that are uniform in the image of the first camera ``start`` (13,) and in depth [m]."""
    camera = camera_of(scenario)
    size = np.array([camera.width, camera.height])
    share = 0.5 + _FIDUCIAL_IMAGE_SHARE * (rng.random((count, 2)) - 0.5)
    depths = rng.uniform(*scenario.fiducial_distance, count)
    R_WC, back_project = uncompiled(rotation_matrix)(start[QUATERNION]), uncompiled(ray_from_pixel)
    half = 0.5 * np.array(scenario.room_size)
    fiducials = [
        np.clip(start[POSITION] + depth * (R_WC @ back_project(camera, pixel)), -half, half)
        for pixel, depth in zip(share * size, depths, strict=True)
    ]
    return np.reshape(fiducials, (-1, 3))


def _sees_floating(scenario: Scenario) -> bool:
    """Whether the first camera sees all `_floating` points, walls aside: those of the corner farthest from the axis."""
    camera, z = camera_of(scenario), np.empty(2)
    size, axis = np.array([camera.width, camera.height]), np.array([camera.u0, camera.v0])
    pixel = (0.5 + 0.5 * _FIDUCIAL_IMAGE_SHARE * np.where(axis < 0.5 * size, 1.0, -1.0)) * size
    view, way = View(camera, np.zeros(3), np.eye(3)), ray_from_pixel(camera, pixel)
    seen = all(visible(view, depth * way, 0.0, z) for depth in scenario.fiducial_distance)
    return seen and np.abs(z - pixel).max() < 1.0  # a pixel beyond the image of infinity has the ray of another


def _is_free(scenario: Scenario, boxes: np.ndarray, p: np.ndarray, scene: Scene | None) -> bool:
    """Whether a camera may start at ``p`` (3,): far enough from the walls, the ``boxes`` and the foreign ``scene``."""
    if (np.abs(p) > 0.5 * np.array(scenario.room_size) - scenario.wall_margin).any():
        return False
    own = len(scenario.boxes)
    for given, margin in ((boxes[:own], scenario.wall_margin), (boxes[own:], _START_MARGIN)):
        if inside_any(p[None], given, margin)[0]:
            return False
    if scene is None:
        return True
    free = scene.clearance(np.repeat(p[None], len(AROUND), axis=0), AROUND, _START_MARGIN)
    return bool((free >= _START_MARGIN).all())


def _in_view(
    scenario: Scenario, boxes: np.ndarray, start: np.ndarray, rng: np.random.Generator, scene: Scene | None = None
) -> np.ndarray | None:
    """(K, 3) fiducials that the first camera ``start`` (13,) sees, or None where it does not see enough.

    In the layout ``surfaces`` they are on surfaces too; elsewhere they float before the boxes or the ``scene``.
    """
    camera, R_WC, half = camera_of(scenario), rotation_matrix(start[QUATERNION]), 0.5 * np.array(scenario.room_size)
    found: list[np.ndarray] = []
    z, view = np.empty(2), View(camera, start, R_WC, boxes)
    for _ in range(20 * scenario.fiducial_count):
        if len(found) == scenario.fiducial_count:
            break
        if scenario.on_surfaces:
            share = 0.5 + _FIDUCIAL_IMAGE_SHARE * (rng.random(2) - 0.5)
            way = R_WC @ ray_from_pixel(camera, share * np.array([camera.width, camera.height]))
            depth = first_hits(boxes, half, start[POSITION], way[None])[0]
            if not scenario.fiducial_distance[0] <= depth <= 1.5 * scenario.fiducial_distance[1]:
                continue
            point = start[POSITION] + depth * way
        else:
            point = _floating(scenario, 1, start, rng)[0]
            if inside_any(point[None], boxes)[0]:
                continue
        hidden = scene is not None and scene.blocks(start[POSITION], point[None])[0]
        near = _near(point[None], np.reshape(found, (-1, 3)), scenario.point_spacing)
        if not hidden and visible(view, point, 0.0, z) and not near.any():
            found.append(point)
    return np.reshape(found, (-1, 3)) if len(found) == scenario.fiducial_count else None
