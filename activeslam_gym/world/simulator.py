"""Move the true camera and detect points: the only source of measurements."""

import math
from typing import NamedTuple

import numpy as np

from activeslam_gym.camera import View, visible
from activeslam_gym.config import Scenario
from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.kernels import Record, borrowed, compiled, filled, inlined, record
from activeslam_gym.linalg import copy_into
from activeslam_gym.motion import CAMERA_SIZE, POSITION, QUATERNION, VELOCITY, transition
from activeslam_gym.world.noise import normal_pair, normals, uniforms

CLUTTER_LABEL = -1

TRUTH = record(
    camera=("f8", CAMERA_SIZE),  # position, quaternion, velocity, angular velocity
    noise_key=("u8", (1,)),  # the stream of all noise of the run
)
"""What is true of one run, beside where things are."""

SENSOR = record(missed_detection_probability="f8", clutter_rate="f8", clutter_capacity="i8")
"""How points become detections, beside the camera's own numbers."""


class World(NamedTuple):
    """The truth of one run. K fiducials, L landmarks, B boxes. A label is k of a fiducial, or K + l of a landmark."""

    state: Record
    """TRUTH."""
    fiducials: np.ndarray
    """(K, 3) [m]."""
    landmarks: np.ndarray
    """(L, 3) [m]."""
    boxes: np.ndarray
    """(B, 2, 3) lowest and highest corner of what hides things [m]."""


@inlined
def world_at(worlds, i):  # type: ignore[no-untyped-def]
    """World ``i`` of a batch, whose arrays have a leading axis: views."""
    fiducials, landmarks, boxes = worlds.fiducials[i], worlds.landmarks[i], worlds.boxes[i]
    return World(worlds.state[i], borrowed(fiducials), borrowed(landmarks), borrowed(boxes))


def empty_worlds(scenario: Scenario, count: int) -> World:
    """``count`` worlds of the scenario's size, with a leading axis."""
    return World(
        state=np.zeros(count, TRUTH),
        fiducials=np.zeros((count, scenario.fiducial_count, 3)),
        landmarks=np.zeros((count, scenario.landmark_count, 3)),
        boxes=np.zeros((count, len(scenario.boxes), 2, 3)),
    )


def sensor_of(scenario: Scenario) -> Record:
    """The SENSOR record of a scenario. Room for five standard deviations of clutter over its mean."""
    rate = scenario.clutter_rate
    capacity = math.ceil(rate + 5.0 * math.sqrt(rate)) if rate > 0 else 0
    return filled(SENSOR, scenario, clutter_capacity=capacity)


def detection_capacity(scenario: Scenario) -> int:
    """The most detections that one image can yield."""
    return scenario.fiducial_count + scenario.landmark_count + int(sensor_of(scenario).clutter_capacity)


@compiled
def move(motion: Record, world: World, u: np.ndarray, frame: int) -> int:
    """Advance the true camera by one frame under ``u`` (6,) and the disturbance; returns the walls touched.

    A wall zeroes the velocity into it. The disturbance of frame k is draws of (key, k) alone.
    """
    noise = normals(world.state.noise_key, _draws(world) * frame, 6)
    disturbed = np.empty(6)
    for i in range(3):
        disturbed[i] = u[i] + motion.acceleration_std * noise[i]
        disturbed[3 + i] = u[3 + i] + motion.angular_acceleration_std * noise[3 + i]
    x = transition(world.state.camera, disturbed, motion.dt)
    p, v = x[POSITION], x[VELOCITY]
    contacts = 0
    for i in range(3):
        reach = motion.half[i] - motion.wall_margin
        if abs(p[i]) > reach:
            p[i] = math.copysign(reach, p[i])
            if v[i] * p[i] > 0.0:
                v[i] = 0.0
            contacts += 1
    copy_into(world.state.camera, x)
    return contacts


@compiled
def _draws(world: World) -> int:
    """Draws that one frame may use; a generous fixed stride, so that frames never share one."""
    return 4096 + 8 * (world.fiducials.shape[0] + world.landmarks.shape[0])


@compiled
def detect(camera: Record, sensor: Record, world: World, frame: int, candidates: np.ndarray, labels: np.ndarray) -> int:
    """The detections of the present true pose, in random order: visible points, noise, misses, clutter; how many.

    Writes ``candidates.pixel`` and their ``labels`` (M,). Labels are for scoring; a filter must not read them.
    ``camera`` is the true one, which a filter may know wrongly.
    """
    K = world.fiducials.shape[0]
    points = K + world.landmarks.shape[0]
    pose = world.state.camera
    view = View(camera, pose, rotation_matrix(pose[QUATERNION]), world.boxes)
    luck = uniforms(world.state.noise_key, _draws(world) * frame + 8, 4 * points + 4 * sensor.clutter_capacity + 1)
    order, z = np.empty(labels.shape[0]), np.empty(2)
    n = 0
    for i in range(points):
        y = world.fiducials[i] if i < K else world.landmarks[i - K]
        if not visible(view, y, 0.0, z) or luck[2 * points + i] < sensor.missed_detection_probability:
            continue
        noise_u, noise_v = normal_pair(luck[2 * i], luck[2 * i + 1])
        candidates[n].pixel[0] = z[0] + camera.pixel_std * noise_u
        candidates[n].pixel[1] = z[1] + camera.pixel_std * noise_v
        labels[n], order[n] = i, luck[3 * points + i]
        n += 1
    spare = luck[4 * points :]
    for i in range(_poisson(sensor.clutter_rate, spare[0], sensor.clutter_capacity)):
        candidates[n].pixel[0] = camera.width * spare[1 + 3 * i]
        candidates[n].pixel[1] = camera.height * spare[2 + 3 * i]
        labels[n], order[n] = CLUTTER_LABEL, spare[3 + 3 * i]
        n += 1
    _shuffle(candidates, labels, order[:n])
    return n


@compiled
def _poisson(rate: float, luck: float, capacity: int) -> int:
    """A Poisson variate by inversion of one uniform draw, at most ``capacity``."""
    term = math.exp(-rate)
    total = term
    k = 0
    while luck > total and k < capacity:
        k += 1
        term *= rate / k
        total += term
    return k


@compiled
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
