"""One frame of truth and belief together, and one step of an environment: the kernels behind every environment."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from activeslam_gym.camera import CameraModel, camera_of, camera_point, pixel_from_camera_point, ray_from_pixel
from activeslam_gym.compilation import part
from activeslam_gym.config import Scenario
from activeslam_gym.envs.scoring import Labels, vote
from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.information import Expectation, update_expectation
from activeslam_gym.linking import NO_ENTRY, enter, entry_of
from activeslam_gym.motion import (
    CAMERA_DIM,
    CAMERA_SIZE,
    POSITION,
    QUATERNION,
    MotionModel,
    accelerations,
    goal_of,
    motion_of,
    turn_of,
)
from activeslam_gym.slam.association import NEW
from activeslam_gym.slam.belief import FRAME, Belief, empty_belief, feature_capacity, reset_belief
from activeslam_gym.slam.depth_particles import follow_rays
from activeslam_gym.slam.filter import filter_frame
from activeslam_gym.slam.settings import FilterModel, filter_of
from activeslam_gym.world.room import draw_points, draw_start, uniform_points
from activeslam_gym.world.simulator import Detections, Sensor, World, detect, detection_capacity, move, sensor_of

EVENTS = ("births", "conversions", "deletions", "rejected_matches", "wrong_matches", "wall_contacts")
"""Names of the counters of a step; the first four are the filter's own."""
WRONG_MATCHES, WALL_CONTACTS = 4, 5


class Models(NamedTuple):
    """The constants of a run."""

    camera: CameraModel
    motion: MotionModel
    sensor: Sensor
    filter: FilterModel


class Control(NamedTuple):
    """The motion under way."""

    goal: np.ndarray
    """(3,) [m]."""
    start: np.ndarray
    """(3,) where the reference towards the goal began [m]."""
    command: np.ndarray
    """(2,) index of the motion under way; frames since it began."""


class Simulation(NamedTuple):
    """All arrays of one run."""

    world: World
    belief: Belief
    expectation: Expectation
    labels: Labels
    detections: Detections
    match: np.ndarray
    """(M,) row that each detection of the last frame was matched to; see `slam.association`."""
    control: Control
    points: np.ndarray
    """(F, 3) features of the public belief, oldest first [m]."""
    covariance: np.ndarray
    """(12 + 3 F, 12 + 3 F) covariance of the public belief."""
    mapped: np.ndarray
    """(F,) bool: which features of the public belief are mapped."""
    events: np.ndarray
    """(6,) counters of the last step; see EVENTS."""


def models_of(scenario: Scenario, motion_period: float) -> Models:
    """The constants of a scenario."""
    return Models(camera_of(scenario), motion_of(scenario, motion_period), sensor_of(scenario), filter_of(scenario))


def empty_simulation(scenario: Scenario) -> Simulation:
    """Arrays of the scenario's capacity; `reset_simulation` fills them."""
    features = feature_capacity(scenario)
    points = scenario.fiducial_count + scenario.landmark_count
    rows = detection_capacity(scenario)
    return Simulation(
        world=World(np.zeros(CAMERA_SIZE), np.zeros((points, 3)), np.zeros(1, np.uint64)),
        belief=empty_belief(scenario),
        expectation=Expectation(
            np.zeros((scenario.landmark_count, 3)),
            np.zeros(3),
            np.zeros(scenario.landmark_count, np.int64),
            np.zeros(scenario.landmark_count, np.int64),
        ),
        labels=Labels(
            votes=np.zeros((features, points + 1), np.int64),
            serial=np.zeros(features, np.int64),
            owner=np.zeros(features, np.int64),
        ),
        detections=Detections(np.zeros((rows, 2)), np.zeros(rows, np.int64), np.zeros(1, np.int64)),
        match=np.zeros(rows, np.int64),
        control=Control(np.zeros(3), np.zeros(3), np.zeros(2, np.int64)),
        points=np.zeros((features, 3)),
        covariance=np.zeros((CAMERA_DIM + 3 * features, CAMERA_DIM + 3 * features)),
        mapped=np.zeros(features, np.bool_),
        events=np.zeros(len(EVENTS), np.int64),
    )


def reset_simulation(simulation: Simulation, scenario: Scenario, key: int) -> None:
    """Begin a new run: room, expected landmarks and noise are separate streams of ``key`` (a non-negative integer)."""
    room, expected, noise, sight = np.random.SeedSequence(key).spawn(4)
    rng = np.random.default_rng(room)
    world = simulation.world
    world.camera[:] = draw_start(scenario, rng)
    world.points[:] = draw_points(scenario, world.camera, rng)
    world.noise_key[:] = noise.generate_state(1, np.uint64)
    expectation = simulation.expectation
    expectation.points[:] = uniform_points(scenario, scenario.landmark_count, np.random.default_rng(expected))
    expectation.variance[:] = scenario.landmark_prior_variance
    expectation.slot[:] = -1
    expectation.serial[:] = 0
    reset_belief(simulation.belief, scenario)
    if scenario.labelled_first_match:
        face_fiducials(scenario, simulation, np.random.default_rng(sight))
    for array in (*simulation.labels, *simulation.control, *simulation.detections, simulation.events):
        array[...] = 0


def face_fiducials(scenario: Scenario, simulation: Simulation, rng: np.random.Generator) -> None:
    """Turn the mean so that labelled first sights of the fiducials point at them (Wahba's problem).

    A prior of 45 degrees is too wide to linearise at its mean; this gives the first update a place to start from.
    Nothing is claimed of the covariance, whose isotropic rotation is the same about any mean.
    """
    camera, world, belief = camera_of(scenario), simulation.world, simulation.belief
    R_WC = rotation_matrix(world.camera[QUATERNION])
    sights, directions = [], []
    z = np.empty(2)
    for fiducial in world.points[: scenario.fiducial_count]:
        if pixel_from_camera_point(camera, camera_point(R_WC, world.camera, fiducial), z):
            sights.append(ray_from_pixel(camera, z + camera.pixel_std * rng.standard_normal(2)))
            directions.append(fiducial - belief.camera[POSITION])
    if len(sights) >= 2:
        from scipy.spatial.transform import Rotation

        sights = [ray / np.linalg.norm(ray) for ray in sights]
        directions = [direction / np.linalg.norm(direction) for direction in directions]
        rotation, _ = Rotation.align_vectors(directions, sights)
        belief.camera[QUATERNION] = rotation.as_quat(scalar_first=True)


class FilterEntries(NamedTuple):
    """How the filter's kernels are entered; see `linking`."""

    filter_frame: Any
    follow_rays: Any


def filter_entries(with_rays: bool) -> FilterEntries:
    """For the arrays of any run; ``with_rays``: of a scenario with depth particles. Compiles them if need be."""
    scenario = Scenario()
    models, s = models_of(scenario, 1.0), empty_simulation(scenario)
    camera, model, belief, points, pixels = models.camera, models.filter, s.belief, s.world.points, s.detections.pixels
    arrays = belief, points, np.zeros(6), pixels, np.zeros(0, np.int64), s.match, s.events
    frame = entry_of(filter_frame, camera, models.motion, model, *arrays, NO_ENTRY)
    return FilterEntries(
        frame, entry_of(follow_rays, camera, model, belief, 0, pixels, s.match) if with_rays else NO_ENTRY
    )


@part
def begin_motion(motion: MotionModel, belief: Belief, control: Control, index: int) -> None:
    """Read a motion: its goal from the present estimate, clipped into the room."""
    goal = goal_of(motion, belief.camera, index)
    for i in range(3):
        control.start[i] = belief.camera[i]
        control.goal[i] = goal[i]
    control.command[0] = index
    control.command[1] = 0


@part(inline="always")
def advance(models: Models, simulation: Simulation, gaze: int, first_labels: bool, filtering: FilterEntries) -> None:
    """One frame: control, true motion, detection, prediction, association, update, initialisation.

    ``first_labels``: give the filter the labels of the fiducials, if this is the first frame.
    """
    motion = models.motion
    world = simulation.world
    belief = simulation.belief
    K = world.points.shape[0] - simulation.expectation.points.shape[0]
    frame = belief.size[FRAME]
    elapsed = simulation.control.command[1] * motion.dt
    turn = turn_of(motion, gaze, frame * motion.dt)
    u = accelerations(motion, belief.camera, simulation.control.start, simulation.control.goal, elapsed, turn)
    simulation.events[WALL_CONTACTS] += move(motion, world, u, frame)
    detect(models.camera, models.sensor, world, frame, simulation.detections)
    count = simulation.detections.used[0]
    truth = simulation.detections.labels[:count]
    given = np.full(count if first_labels and frame == 0 else 0, NEW)
    for i in range(given.shape[0]):
        if 0 <= truth[i] < K:
            given[i] = truth[i]
    if not motion.command_known:
        u[:] = 0.0
    fiducials, pixels = world.points[:K], simulation.detections.pixels[:count]
    match, events = simulation.match[:count], simulation.events
    seen = belief, fiducials, u, pixels, given, match, events
    enter(filtering.filter_frame, (models.camera, motion, models.filter, *seen, filtering.follow_rays))
    events[WRONG_MATCHES] += vote(simulation.labels, belief, K, match, truth)
    update_expectation(simulation.expectation, belief)
    simulation.control.command[1] += 1
