"""Move the true camera and detect points: the only source of measurements."""

import math
from typing import NamedTuple

import numpy as np

from activeslam_gym.camera import distance_between, free_way, view_of, visible
from activeslam_gym.config import Scenario
from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.kernels import Record, borrowed, borrowing, compiled, constants, inlined, record
from activeslam_gym.linalg import copy_into
from activeslam_gym.motion import CAMERA_SIZE, MOTION_AXIS, MOTION_SIGN, POSITION, QUATERNION, VELOCITY, transition
from activeslam_gym.world.noise import normal_pair, normals, uniforms
from activeslam_gym.world.room import Room

CLUTTER_LABEL = -1

TRUTH = record(
    camera=("f8", CAMERA_SIZE),  # position, quaternion, velocity, angular velocity
    noise_key=("u8", (1,)),  # the stream of all noise of the run
    frame="i8",  # the world's clock: frames that are over
    boxes="i8",  # how many boxes the room has
)
"""The ground truth of one run, beside the positions of its room."""

SENSOR, sensor_of = constants(
    Scenario(),
    missed_detection_probability="f8",
    clutter_rate="f8",
    clutter_capacity=lambda s: math.ceil(s.clutter_rate + 5.0 * math.sqrt(s.clutter_rate)),  # five deviations over it
    facing_cosine=lambda s: math.cos(s.facing_angle),  # of the greatest angle at which a landmark on a surface is seen
)
"""How points become detections, beside the camera's own numbers."""


class World(NamedTuple):
    """The truth of one run. K fiducials, L landmarks, B boxes. A label is k of a fiducial, or K + l of a landmark."""

    state: Record  # TRUTH
    fiducials: np.ndarray  # (K, 3) [m]
    landmarks: np.ndarray  # (L, 3) [m]
    normals: np.ndarray
    """(L, 3) unit normals of the surfaces that the landmarks are on; (0, 3) where they are seen from all sides."""
    boxes: np.ndarray
    """(B, 2, 3) lowest and highest corner of what occludes and stops the camera [m]; see `boxes_of`."""


@inlined
def world_at(worlds, i):  # type: ignore[no-untyped-def]
    """World ``i`` of a batch, whose arrays have a leading axis: views."""
    fiducials, landmarks, boxes = worlds.fiducials[i], worlds.landmarks[i], worlds.boxes[i]
    normals = worlds.normals[i]
    return World(worlds.state[i], borrowed(fiducials), borrowed(landmarks), borrowed(normals), borrowed(boxes))


@compiled
def boxes_of(world: World) -> np.ndarray:
    """(B, 2, 3) the boxes that there are, of all that there is room for."""
    return world.boxes[: world.state.boxes]


def empty_worlds(scenario: Scenario, count: int, boxes: int) -> World:
    """``count`` worlds of the scenario's size, with room for ``boxes`` boxes, with a leading axis."""
    return World(
        state=np.zeros(count, TRUTH),
        fiducials=np.zeros((count, scenario.fiducial_count, 3)),
        landmarks=np.zeros((count, scenario.landmark_count, 3)),
        normals=np.zeros((count, scenario.landmark_count if scenario.has_normals else 0, 3)),
        boxes=np.zeros((count, boxes, 2, 3)),
    )


def put_room(world: World, room: Room) -> None:
    """Make a ``room`` that was drawn the truth of a run."""
    world.state.camera[:], world.state.frame = room.camera, 0
    world.fiducials[:], world.landmarks[:], world.normals[:] = room.fiducials, room.landmarks, room.normals
    world.state.boxes = len(room.boxes)
    world.boxes[:] = 0.0
    world.boxes[: len(room.boxes)] = room.boxes


def detection_capacity(scenario: Scenario) -> int:
    """The most detections that one image can yield."""
    return scenario.fiducial_count + scenario.landmark_count + int(sensor_of(scenario).clutter_capacity)


@compiled
def move(motion: Record, world: World, u: np.ndarray) -> int:
    """Advance the true camera by one frame under ``u`` (6,) and the disturbance; returns the walls and boxes touched.

    A wall zeroes the velocity into it. The disturbance of frame k is draws of (key, k) alone.
    """
    noise = normals(world.state.noise_key, _draws(world) * world.state.frame, 6)
    disturbed = np.empty(6)
    for i in range(3):
        disturbed[i] = u[i] + motion.acceleration_std * noise[i]
        disturbed[3 + i] = u[3 + i] + motion.angular_acceleration_std * noise[3 + i]
    x = transition(world.state.camera, disturbed, motion.dt)
    p, v = x[POSITION], x[VELOCITY]
    contacts = _leave_boxes(motion, boxes_of(world), p, v)
    for i in range(3):
        reach = motion.half[i] - motion.wall_margin
        if abs(p[i]) > reach:
            p[i] = math.copysign(reach, p[i])
            if v[i] * p[i] > 0.0:
                v[i] = 0.0
            contacts += 1
    copy_into(world.state.camera, x)
    return contacts


@borrowing
def _leave_boxes(motion: Record, boxes: np.ndarray, p: np.ndarray, v: np.ndarray) -> int:
    """Move ``p`` (3,) out of every box grown by the wall's margin, through the nearest side that faces into the room.

    Zeroes the velocity ``v`` (3,) into that side; returns how many boxes were touched.
    """
    contacts = 0
    for b in range(boxes.shape[0]):
        axis, side, least = -1, 0.0, math.inf
        for i in range(3):
            low, high = boxes[b, 0, i] - motion.wall_margin, boxes[b, 1, i] + motion.wall_margin
            if p[i] <= low or p[i] >= high:
                least = -math.inf
                continue
            reach = motion.half[i] - motion.wall_margin
            if p[i] - low < least and low >= -reach:
                axis, side, least = i, low, p[i] - low
            if high - p[i] < least and high <= reach:
                axis, side, least = i, high, high - p[i]
        if least > -math.inf and axis >= 0:
            if (side - p[axis]) * v[axis] < 0.0:
                v[axis] = 0.0
            p[axis] = side
            contacts += 1
    return contacts


@compiled
def find_clearance(motion: Record, world: World, R_WC: np.ndarray, farthest: float, out: np.ndarray) -> None:
    """Write into ``out`` (7,) how far the true camera can go in each motion's direction [m], ``farthest`` at most.

    What range finders on a body of the wall's margin would say; STAY: the least of the others. ``R_WC`` is the true
    rotation.
    """
    way = np.empty(3)
    out[-1] = farthest
    for index in range(out.shape[0] - 1):
        for i in range(3):
            way[i] = MOTION_SIGN[index] * R_WC[i, MOTION_AXIS[index]]
        out[index] = clearance(motion, world, way, farthest)
        out[-1] = min(out[-1], out[index])


@compiled
def clearance(motion: Record, world: World, direction: np.ndarray, farthest: float) -> float:
    """How far the true camera can go in a ``direction`` (3,), a unit vector of the world [m], ``farthest`` at most."""
    p, way, free = world.state.camera[POSITION], np.empty(3), farthest
    for i in range(3):
        way[i] = farthest * direction[i]
        reach = motion.half[i] - motion.wall_margin
        if abs(direction[i]) > 1e-12:
            free = min(free, max((math.copysign(reach, direction[i]) - p[i]) / direction[i], 0.0))
    return min(free, farthest * free_way(boxes_of(world), motion.wall_margin, p, way))


@compiled
def stop_short(motion: Record, world: World, d: np.ndarray, reach: float) -> None:
    """Shorten the translation ``d`` (3,) [m], in camera axes, to end as far from what is in its way as goals do.

    The camera can go ``reach`` [m] along it at most, whatever else is in its way.
    """
    R_WC, gap = rotation_matrix(world.state.camera[QUATERNION]), motion.goal_margin - motion.wall_margin
    length, way = math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]), np.zeros(3)
    if length == 0.0:
        return
    for i in range(3):
        for j in range(3):
            way[i] += R_WC[i, j] * d[j] / length
    free = min(clearance(motion, world, way, length + gap), reach)
    share = min(max((free - gap) / length, 0.0), 1.0)
    for i in range(3):
        d[i] *= share


@compiled
def keep_off(motion: Record, world: World, d: np.ndarray) -> None:
    """Shorten the translation ``d`` (3,) [m], in camera axes, to end as far from all boxes, on every side, as goals do
    from walls."""
    R_WC, way = rotation_matrix(world.state.camera[QUATERNION]), np.zeros(3)
    for i in range(3):
        for j in range(3):
            way[i] += R_WC[i, j] * d[j]
    share = free_way(boxes_of(world), motion.goal_margin, world.state.camera[POSITION], way)
    for i in range(3):
        d[i] *= share


@compiled
def _draws(world: World) -> int:
    """Draws that one frame may use; a generous fixed stride, so that frames never share one."""
    return 4096 + 8 * (world.fiducials.shape[0] + world.landmarks.shape[0])


@compiled
def detect(lens: Record, sensor: Record, world: World, candidates: np.ndarray, labels: np.ndarray) -> int:
    """The detections of the present true pose, in random order: visible points, noise, misses, clutter; how many.

    Writes ``candidates.pixel`` and their ``labels`` (M,). Labels are for scoring; a filter must not read them.
    ``lens`` is the true one, which a filter may know wrongly.
    """
    K = world.fiducials.shape[0]
    points = K + world.landmarks.shape[0]
    pose = world.state.camera
    view = view_of(lens, pose, boxes_of(world))
    first = _draws(world) * world.state.frame + 8
    draws = uniforms(world.state.noise_key, first, 4 * points + 4 * sensor.clutter_capacity + 1)
    order, z = np.empty(labels.shape[0]), np.empty(2)
    n = 0
    for i in range(points):
        y = world.fiducials[i] if i < K else world.landmarks[i - K]
        if not visible(view, y, 0.0, z) or draws[2 * points + i] < sensor.missed_detection_probability:
            continue
        if i >= K and world.normals.shape[0] > 0 and not faces(world.normals[i - K], y, pose, sensor.facing_cosine):
            continue
        noise_u, noise_v = normal_pair(draws[2 * i], draws[2 * i + 1])
        candidates[n].pixel[0] = z[0] + lens.pixel_std * noise_u
        candidates[n].pixel[1] = z[1] + lens.pixel_std * noise_v
        labels[n], order[n] = i, draws[3 * points + i]
        n += 1
    spare = draws[4 * points :]
    for i in range(_poisson(sensor.clutter_rate, spare[0], sensor.clutter_capacity)):
        candidates[n].pixel[0] = lens.width * spare[1 + 3 * i]
        candidates[n].pixel[1] = lens.height * spare[2 + 3 * i]
        labels[n], order[n] = CLUTTER_LABEL, spare[3 + 3 * i]
        n += 1
    _shuffle(candidates, labels, order[:n])
    return n


@borrowing
def faces(normal: np.ndarray, y: np.ndarray, p: np.ndarray, cosine: float) -> bool:
    """Whether the surface at ``y`` (3,) with that ``normal`` (3,) shows its front to ``p`` (>= 3,), not too aslant."""
    along = normal[0] * (p[0] - y[0]) + normal[1] * (p[1] - y[1]) + normal[2] * (p[2] - y[2])
    return along > cosine * distance_between(p, y)


@compiled
def _poisson(rate: float, draws: float, capacity: int) -> int:
    """A Poisson variate by inversion of one uniform draw, at most ``capacity``."""
    term = math.exp(-rate)
    total = term
    k = 0
    while draws > total and k < capacity:
        k += 1
        term *= rate / k
        total += term
    return k


@borrowing
def _shuffle(candidates: np.ndarray, labels: np.ndarray, order: np.ndarray) -> None:
    """Sort the detections by their random ``order`` (n,), by insertion: there are few."""
    for i in range(1, order.shape[0]):
        for j in range(i, 0, -1):
            if order[j - 1] <= order[j]:
                break
            order[j - 1], order[j] = order[j], order[j - 1]
            labels[j - 1], labels[j] = labels[j], labels[j - 1]
            one, other = candidates[j - 1].pixel, candidates[j].pixel
            for axis in range(2):
                one[axis], other[axis] = other[axis], one[axis]
