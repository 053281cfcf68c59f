"""Move the true camera and detect points: the only source of measurements."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from activeslam_gym.camera import CameraModel, camera_point, inside_image, pixel_from_camera_point
from activeslam_gym.compilation import part
from activeslam_gym.config import Scenario
from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.motion import CAMERA_SIZE, QUATERNION, MotionModel, transition
from activeslam_gym.world.noise import normal_pair, normals, uniforms

CLUTTER_LABEL = -1


class World(NamedTuple):
    """The truth of one run. ``points`` holds the fiducials, then the landmarks; a label is an index into it."""

    camera: np.ndarray
    """(13,) position, quaternion, velocity, angular velocity."""
    points: np.ndarray
    """(P, 3) [m]."""
    noise_key: np.ndarray
    """(1,) uint64: the stream of all noise of the run."""


class Sensor(NamedTuple):
    """How points become detections, beside the camera's own numbers."""

    missed_probability: float
    clutter_rate: float
    clutter_capacity: int


class Detections(NamedTuple):
    """What one image yields, in random order. Labels are for scoring; a filter must not read them."""

    pixels: np.ndarray
    """(M, 2) [px]."""
    labels: np.ndarray
    """(M,) index of the true point, or -1 for a false detection."""
    used: np.ndarray
    """(1,) how many rows are in use."""


def sensor_of(scenario: Scenario) -> Sensor:
    """The sensor of a scenario. Room for five standard deviations of clutter over its mean."""
    rate = scenario.clutter_rate
    capacity = math.ceil(rate + 5.0 * math.sqrt(rate)) if rate > 0 else 0
    return Sensor(float(scenario.missed_detection_probability), float(rate), capacity)


def detection_capacity(scenario: Scenario) -> int:
    """The most detections that one image can yield."""
    return scenario.fiducial_count + scenario.landmark_count + sensor_of(scenario).clutter_capacity


@part
def move(motion: MotionModel, world: World, u: np.ndarray, frame: int) -> int:
    """Advance the true camera by one frame under ``u`` (6,) and the disturbance; returns the walls touched.

    A wall zeroes the velocity into it. The disturbance of frame k is draws of (key, k) alone.
    """
    noise = normals(world.noise_key, _draws(world) * frame, 6)
    disturbed = np.empty(6)
    for i in range(3):
        disturbed[i] = u[i] + motion.acceleration_std * noise[i]
        disturbed[3 + i] = u[3 + i] + motion.angular_acceleration_std * noise[3 + i]
    x = transition(world.camera, disturbed, motion.dt)
    contacts = 0
    half = (motion.half_x, motion.half_y, motion.half_z)
    for i in range(3):
        reach = half[i] - motion.wall_margin
        if abs(x[i]) > reach:
            x[i] = math.copysign(reach, x[i])
            if x[7 + i] * x[i] > 0.0:
                x[7 + i] = 0.0
            contacts += 1
    for i in range(CAMERA_SIZE):
        world.camera[i] = x[i]
    return contacts


@part
def _draws(world: World) -> int:
    """Draws that one frame may use; a generous fixed stride, so that frames never share one."""
    return 4096 + 8 * world.points.shape[0]


@part
def detect(camera: CameraModel, sensor: Sensor, world: World, frame: int, out: Detections) -> None:
    """Fill ``out`` with the detections of the present true pose: visible points, noise, misses, clutter, shuffled."""
    points = world.points.shape[0]
    first = _draws(world) * frame + 8
    luck = uniforms(world.noise_key, first, 4 * points + 4 * sensor.clutter_capacity + 1)
    R_WC = rotation_matrix(world.camera[QUATERNION])
    order = np.empty(out.labels.shape[0])
    z = np.empty(2)
    n = 0
    for i in range(points):
        p_C = camera_point(R_WC, world.camera, world.points[i])
        if p_C[2] < camera.minimum_depth or not pixel_from_camera_point(camera, p_C, z):
            continue
        if not inside_image(camera, z, 0.0) or luck[2 * points + i] < sensor.missed_probability:
            continue
        noise_u, noise_v = normal_pair(luck[2 * i], luck[2 * i + 1])
        out.pixels[n, 0] = z[0] + camera.pixel_std * noise_u
        out.pixels[n, 1] = z[1] + camera.pixel_std * noise_v
        out.labels[n] = i
        order[n] = luck[3 * points + i]
        n += 1
    spare = luck[4 * points :]
    for i in range(_poisson(sensor.clutter_rate, spare[0], sensor.clutter_capacity)):
        out.pixels[n, 0] = camera.width * spare[1 + 3 * i]
        out.pixels[n, 1] = camera.height * spare[2 + 3 * i]
        out.labels[n] = CLUTTER_LABEL
        order[n] = spare[3 + 3 * i]
        n += 1
    out.used[0] = n
    _shuffle(out, order)


@part
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


@part
def _shuffle(out: Detections, order: np.ndarray) -> None:
    """Sort the detections by their random ``order``, by insertion: there are few."""
    for i in range(1, out.used[0]):
        for j in range(i, 0, -1):
            if order[j - 1] <= order[j]:
                break
            order[j - 1], order[j] = order[j], order[j - 1]
            out.labels[j - 1], out.labels[j] = out.labels[j], out.labels[j - 1]
            for axis in range(2):
                out.pixels[j - 1, axis], out.pixels[j, axis] = out.pixels[j, axis], out.pixels[j - 1, axis]
