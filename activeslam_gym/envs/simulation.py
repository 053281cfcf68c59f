"""All arrays of a run, and one frame of truth and belief together."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from activeslam_gym.camera import CAMERA, camera_of, camera_point, pixel_from_camera_point, ray_from_pixel
from activeslam_gym.config import (
    BOXES,
    KNOWN,
    MOST_HELD_FRAMES,
    Scenario,
    positive_number,
    scenario_from,
    whole_multiple,
)
from activeslam_gym.envs.disproof import VIEWS, disprove
from activeslam_gym.envs.observation import ObservationLayout, layout_of
from activeslam_gym.envs.referee import OWNER, judge_matches, reconcile, true_id
from activeslam_gym.envs.reward import EVALUATION, REWARDS
from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.information.criteria import CRITERIA
from activeslam_gym.information.expectation import EXPECTED, VIEW, WAITING, update_expectation
from activeslam_gym.information.foresight import UNLIMITED, SensorLimits
from activeslam_gym.kernels import Record, borrowed, compiled, filled, inlined, record, row
from activeslam_gym.linalg import copy_into
from activeslam_gym.motion import (
    MOTION,
    MOTION_COUNT,
    POSITION,
    QUATERNION,
    accelerations,
    goal_by,
    motion_of,
    turn_by,
)
from activeslam_gym.sensors.sensor import IMAGES, SENSORS
from activeslam_gym.slam.association import ANYTHING, CANDIDATE
from activeslam_gym.slam.belief import (
    Belief,
    belief_at,
    empty_beliefs,
    feature_capacity,
    reset_belief,
    start_of,
    write_estimate,
    write_points,
)
from activeslam_gym.slam.estimate import EstimateArrays, empty_estimates, estimate_at
from activeslam_gym.slam.estimator import ESTIMATORS
from activeslam_gym.slam.filter import FILTER, filter_frame, filter_of
from activeslam_gym.slam.kalman import feel_contact
from activeslam_gym.world.room import draw_room, expected_points, varied
from activeslam_gym.world.scenes import SCENES, BoxScene, Scene
from activeslam_gym.world.simulator import (
    SENSOR,
    World,
    boxes_of,
    detect,
    detection_capacity,
    empty_worlds,
    keep_off,
    move,
    put_room,
    sensor_of,
    stop_short,
    world_at,
)

TASK = record(
    frames_per_step="i8",
    steps_per_motion="i8",
    steps="i8",  # of an episode
    reward="i8",  # its number in `REWARDS`
    lost_position_error="f8",  # [m]
    end_when_lost="b1",
    labelled_first_match="b1",
    association_known="b1",
)
"""What an environment asks: its rhythm, its reward, and when a run is lost."""

MODELS = record(
    camera=CAMERA,  # as the filter knows it
    true_camera=CAMERA,
    motion=MOTION,
    sensor=SENSOR,
    greatest_change="f8",  # see `SensorLimits`
    wanted="i8",
    filter=FILTER,
    task=TASK,
    landmark_var=("f8", 3),  # of a landmark anywhere in the room, each axis [m^2]
    on_surfaces="b1",  # whether landmarks are expected on the walls
    boxes_known="b1",  # whether the belief knows what hides things
    negative_information="b1",  # whether what was looked at and not found is expected elsewhere
)
"""The constants of a run."""

CONTROL = record(
    goal=("f8", 3),  # of the motion under way [m]
    start=("f8", 3),  # where the reference towards the goal began [m]
    command=("f8", 3),  # the translation under way: camera axes, of which 1 is a step
    frames="i8",  # since it began
)
"""The motion under way."""

EVENTS = record(
    births="i8",
    conversions="i8",
    deletions="i8",
    rejected_matches="i8",
    starvations="i8",
    recoveries="i8",
    restarts="i8",
    wrong_matches="i8",
    false_births="i8",
    wall_contacts="i8",
)
"""What happened in a step: counters; the first six are the filter's own."""

EPISODE = record(
    control=CONTROL,
    events=EVENTS,
    evaluation=EVALUATION,
    potential=("f8", (len(REWARDS.own) + 1,)),  # after the last step, by number; the last one is a registered reward's
    terms=("f8", (len(REWARDS.own) + 2,)),  # gain of each in the last step; the forfeit stands before the last one
    reward="f8",  # of the last step
    total="f8",  # return so far
    gain="f8",  # entropy removed so far [bit]
    first_density="f8",  # log_density at the reset [bit]
    steps="i8",  # so far
    begun="b1",  # there has been a reset
    lost="b1",  # in this step or before
    lost_now="b1",
    sound="b1",  # the estimate is finite, and its covariance positive definite
    detections="i8",  # in the last frame
    views="i8",  # viewpoints so far
    clearance=("f8", (MOTION_COUNT,)),  # how far the camera can go by each motion, where there are boxes [m]
    redraw_key=("u8", (1,)),  # the stream of expected landmarks that are drawn anew
)
"""What one run has been worth so far."""


class Run(NamedTuple):
    """A run; a batch of runs has a leading axis. F feature slots, N = L landmarks, K fiducials, M detections."""

    models: Record
    """MODELS."""
    world: World
    """The truth."""
    ekf: Belief
    """The arrays of the estimator `ekf`: only `slam` reads them."""
    estimate: EstimateArrays
    """What everything else reads of the estimator."""
    expected: np.ndarray
    """(N,) EXPECTED landmarks."""
    viewpoint: np.ndarray
    """(V,) VIEW from which was looked for them; V = 0 without negative information."""
    candidate: np.ndarray
    """(M,) CANDIDATE: the last frame's detections, as the filter gets them."""
    label: np.ndarray
    """(M,) of what each of them is; see `World`. For scoring alone."""
    first_seen: np.ndarray
    """(F, 3) where the camera was when each landmark of the estimate was initialised [m]; (0, 3) where that does not
    limit the sensor."""
    owner: np.ndarray
    """(F,) OWNER, of the landmarks of the estimate in their order. For scoring alone."""
    episode: Record
    """EPISODE."""
    observation: np.ndarray
    """(D,) float32."""


@inlined
def run_at(runs, i):  # type: ignore[no-untyped-def]
    """Run ``i`` of a batch: views."""
    return Run(
        runs.models[i],
        world_at(runs.world, i),
        belief_at(runs.ekf, i),
        estimate_at(runs.estimate, i),
        borrowed(runs.expected[i]),
        borrowed(runs.viewpoint[i]),
        borrowed(runs.candidate[i]),
        borrowed(runs.label[i]),
        borrowed(runs.first_seen[i]),
        borrowed(runs.owner[i]),
        runs.episode[i],
        borrowed(runs.observation[i]),
    )


# From plain arguments to constants ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Setting:
    """Resolved arguments of an environment; times in seconds."""

    scenario: Scenario
    gaze_period: float
    motion_period: float
    duration: float
    reward: str
    models: Record
    """MODELS."""
    layout: ObservationLayout

    @property
    def task(self) -> Record:
        """TASK."""
        return self.models.task

    @property
    def render_rate(self) -> int:
        """Frames a second at which a video of one picture a step shows true time."""
        return max(1, round(1.0 / self.gaze_period))


def resolve(
    scenario: str | Mapping[str, Any] | Scenario,
    gaze_period: float | None,
    motion_period: float,
    duration: float | None,
    reward: str,
    lost_position_error: float,
    end_when_lost: bool = True,
) -> Setting:
    """Check the arguments of an environment and work out its constants.

    Raises:
        ValueError: an argument is unknown, out of range, or no whole number of the period that it must be made of; the
            message names it, its value and what is allowed.
    """
    resolved = scenario_from(scenario)
    frame = resolved.frame_time
    frames_per_step, most = 1, MOST_HELD_FRAMES
    if gaze_period is not None:
        frames_per_step = whole_multiple("gaze_period", gaze_period, "the frame", frame, most)
    step_time = frames_per_step * frame
    steps_per_motion = whole_multiple("motion_period", motion_period, "gaze_period", step_time, most // frames_per_step)
    duration = resolved.duration if duration is None else duration
    steps = whole_multiple("duration", duration, "gaze_period", step_time)
    if not isinstance(end_when_lost, bool):
        raise ValueError(f"end_when_lost must be True or False, got {end_when_lost!r}")
    ESTIMATORS.require(resolved.estimator)
    SENSORS.require(resolved.sensor)
    SCENES.require(resolved.scene)
    CRITERIA.require(resolved.motion_criterion, "scenario.motion_criterion")
    if resolved.sensor == IMAGES and resolved.has_registered_scene:
        raise ValueError(f"scenario.scene must be {BOXES!r} with the sensor {IMAGES!r}, got {resolved.scene!r}")
    task = filled(
        TASK,
        frames_per_step=frames_per_step,
        steps_per_motion=steps_per_motion,
        steps=steps,
        reward=REWARDS.number(reward),
        lost_position_error=positive_number("lost_position_error", lost_position_error, "metres"),
        end_when_lost=end_when_lost,
        labelled_first_match=resolved.labelled_first_match,
        association_known=resolved.association == KNOWN,
    )
    return Setting(
        scenario=resolved,
        gaze_period=step_time,
        motion_period=steps_per_motion * step_time,
        duration=steps * step_time,
        reward=reward,
        models=models_of(resolved, task, steps_per_motion * step_time),
        layout=layout_of(resolved),
    )


def models_of(scenario: Scenario, task: Record, motion_period: float) -> Record:
    """The MODELS record of a scenario."""
    camera = camera_of(scenario)
    true_camera = camera.copy()
    if scenario.true_focal_px is not None:
        true_camera["focal"] = scenario.true_focal_px
    if scenario.true_distortion is not None:
        true_camera["distortion"] = scenario.true_distortion
    return filled(
        MODELS,
        camera=camera,
        true_camera=true_camera,
        motion=motion_of(scenario, motion_period),
        sensor=sensor_of(scenario),
        **sensor_limits(scenario)._asdict(),
        filter=filter_of(scenario),
        task=task,
        landmark_var=scenario.landmark_prior_variance,
        on_surfaces=scenario.on_surfaces,
        boxes_known=scenario.boxes_known,
        negative_information=scenario.negative_information,
    )


# Beginning a run ----------------------------------------------------------------------------------------------------


def empty_runs(scenario: Scenario, count: int) -> Run:
    """``count`` runs of the scenario's capacity: arrays with a leading axis. `reset_run` fills one of them."""
    features, detections = feature_capacity(scenario), detection_capacity(scenario)
    candidate = np.zeros((count, detections), CANDIDATE)
    candidate["R"] = scenario.pixel_std**2 * np.eye(2)
    return Run(
        models=np.zeros(count, MODELS),
        world=empty_worlds(scenario, count, box_capacity(scenario)),
        ekf=empty_beliefs(scenario, count),
        estimate=empty_estimates(features, count),
        expected=np.zeros((count, scenario.landmark_count), EXPECTED),
        viewpoint=np.zeros((count, VIEWS if scenario.negative_information else 0), VIEW),
        candidate=candidate,
        label=np.zeros((count, detections), np.int64),
        first_seen=np.zeros((count, features if scenario.sensor == IMAGES else 0, 3)),
        owner=np.zeros((count, features), OWNER),
        episode=np.zeros(count, EPISODE),
        observation=np.zeros((count, layout_of(scenario).size), np.float32),
    )


def sensor_limits(scenario: Scenario) -> SensorLimits:
    """The limits of the scenario's sensor."""
    if scenario.sensor == IMAGES:
        from activeslam_gym.vision.settings import SIGHTED

        return SensorLimits(SIGHTED.most_change, SIGHTED.visible)
    return UNLIMITED


def box_capacity(scenario: Scenario) -> int:
    """The most boxes that a room of the scenario can have; the rooms of images have their own."""
    if scenario.sensor == IMAGES:
        from activeslam_gym.vision.room.scene import BOX_COUNT

        return BOX_COUNT
    return scenario.box_capacity


class Start(NamedTuple):
    """What is known of a run that has just been reset, beside its arrays."""

    mean: np.ndarray
    """(13,) of the camera's prior."""
    covariance: np.ndarray
    """(12, 12) of the camera's prior."""
    scene: Scene | None
    """The registered scene; None: the boxes of the world's arrays."""


def reset_run(setting: Setting, runs: Run, i: int, key: int) -> Start:
    """Begin a new episode of run ``i`` of ``runs`` from ``key``, a non-negative integer.

    Room, expected landmarks and noise are separate streams of it. `play` with BEGIN evaluates the run.
    """
    room, expected, noise, sight, redraws = np.random.SeedSequence(key).spawn(5)
    rng = np.random.default_rng(room)
    scenario = varied(setting.scenario, rng)
    runs.models[i] = setting.models
    run = row(runs, i)
    if scenario is not setting.scenario:
        runs.models[i] = models_of(scenario, setting.task, setting.motion_period)
        run.candidate["R"] = scenario.pixel_std**2 * np.eye(2)
    drawn = draw_room(scenario, rng)
    put_room(run.world, drawn)
    run.world.state.noise_key[:] = noise.generate_state(1, np.uint64)
    run.expected[:] = np.zeros(1, EXPECTED)
    run.expected["point"] = expected_points(scenario, drawn, np.random.default_rng(expected))
    run.expected["serial"] = WAITING
    run.owner["id"] = 0
    run.estimate.state.count = 0
    runs.episode[i] = np.zeros(1, EPISODE)[0]
    run.episode.begun = True
    run.episode.redraw_key[:] = redraws.generate_state(1, np.uint64)
    mean, covariance = start_of(scenario)
    mean[: len(drawn.place)] = drawn.place
    if scenario.labelled_first_match:
        face_fiducials(run, mean, np.random.default_rng(sight))
    reset_belief(run.ekf, mean, covariance)
    return Start(mean, covariance, drawn.scene)


def box_scenes(runs: Run) -> tuple[BoxScene, ...]:
    """The scene of each run of a batch, where it is `boxes`."""
    halves, counts, boxes = runs.models["motion"]["half"].copy(), runs.world.state["boxes"], runs.world.boxes.copy()
    return tuple(BoxScene(half, own[:n]) for half, n, own in zip(halves, counts.tolist(), boxes, strict=True))


def face_fiducials(run: Run, mean: np.ndarray, rng: np.random.Generator) -> None:
    """Turn the ``mean`` (13,) of the camera so that labelled first sights of the fiducials point at them.

    This is Wahba's problem.
    A prior of 45 degrees is too wide to linearise at its mean; this gives the first update a place to start from.
    Nothing is claimed of the covariance, whose isotropic rotation is the same about any mean.
    """
    from scipy.spatial.transform import Rotation

    camera, pose = run.models.camera, run.world.state.camera
    R_WC, z = rotation_matrix(pose[QUATERNION]), np.empty(2)
    sights, directions = [], []
    for fiducial in run.world.fiducials:
        if pixel_from_camera_point(camera, camera_point(R_WC, pose, fiducial), z):
            sights.append(ray_from_pixel(camera, z + camera.pixel_std * rng.standard_normal(2)))
            directions.append(fiducial - mean[POSITION])
    if len(sights) >= 2:
        sights = [ray / np.linalg.norm(ray) for ray in sights]
        directions = [direction / np.linalg.norm(direction) for direction in directions]
        rotation, _ = Rotation.align_vectors(directions, sights)
        mean[QUATERNION] = rotation.as_quat(scalar_first=True)


# One frame ----------------------------------------------------------------------------------------------------------


@compiled
def begin_motion(run: Run, command: np.ndarray, reach: float) -> None:
    """Read a motion, ``command`` (>= 3,): its goal from where the camera is felt to be, clipped into the room.

    Where there are boxes it stops short of what is in the way, or keeps off it on all sides. ``reach``: so far a
    registered scene lets the camera go [m]; infinite where there is none.
    """
    control, motion, camera = run.episode.control, run.models.motion, felt(run)
    d = np.empty(3)
    for i in range(3):
        control.command[i] = command[i]
        d[i] = motion.step_length * command[i]
    if motion.bodies:
        stop_short(motion, run.world, d, reach)
    elif run.world.state.boxes > 0:
        keep_off(motion, run.world, d)
    copy_into(control.start, camera[POSITION])
    copy_into(control.goal, goal_by(motion, camera, d))
    control.frames = 0


@compiled
def felt(run: Run) -> np.ndarray:
    """(13,) the camera as who moves it feels it: a robot by its estimate, a person's hand by the person's own senses.

    A person does not read the filter, and the filter does not know the person's commands.
    """
    return run.estimate.state.camera if run.models.motion.command_known else run.world.state.camera


@compiled
def known_boxes(run: Run) -> np.ndarray:
    """What the belief knows to hide things: all of the world's boxes, or none."""
    boxes = boxes_of(run.world)
    return boxes if run.models.boxes_known else boxes[:0]


@compiled
def drive(run: Run, gaze: float) -> tuple[np.ndarray, bool]:
    """One frame of control and true motion: (6,) the accelerations as the estimator knows them, and a contact.

    ``gaze`` is a share of the turn rate.
    """
    motion, control = run.models.motion, run.episode.control
    turn = turn_by(motion, gaze, run.world.state.frame * motion.dt)
    seconds = control.frames * motion.dt
    u = accelerations(motion, felt(run), control.start, control.goal, seconds, turn)
    contacts = move(motion, run.world, u)
    run.episode.events.wall_contacts += contacts
    control.frames += 1
    if not motion.command_known:
        u[:] = 0.0
    return u, contacts > 0


@compiled
def advance(run: Run, gaze: float, ends: bool) -> None:
    """One frame: control, true motion, detection, prediction, association, update, initialisation.

    ``ends``: it is the last frame of a step, after which the whole estimate is written.
    """
    u, contact = drive(run, gaze)
    labelled = sense(run)
    take_in(run, u, contact, labelled, ends)


@inlined
def take_in(run: Run, u: np.ndarray, contact: bool, labelled: bool, ends: bool) -> None:
    """The part of a frame after the detections, by the compiled filter; see `advance` and `drive`."""
    models, world, events = run.models, run.world, run.episode.events
    motion = models.motion
    candidates = run.candidate[: run.episode.detections]
    if contact:
        feel_contact(run.ekf, u, motion.dt)
    boxes = known_boxes(run)
    filter_frame(
        models.camera, motion, models.filter, run.ekf, world.fiducials, boxes, u, motion.dt, candidates, labelled,
        events,
    )  # fmt: skip
    if ends:
        present(run)
    else:
        write_points(run.ekf, models.filter.initialisation.mapped_depth_ratio, run.estimate)
    reconcile(run.owner, run.estimate)
    judge(run)
    close_frame(run)


@compiled
def sense(run: Run) -> bool:
    """The detections of the frame under way; whether their ids are the true ones."""
    models, world = run.models, run.world
    run.episode.detections = detect(models.true_camera, models.sensor, world, run.candidate, run.label)
    return identify(run)


@compiled
def identify(run: Run) -> bool:
    """Give the detections their true ids, where the scenario does; whether it does in this frame."""
    task = run.models.task
    labelled = task.association_known or (task.labelled_first_match and run.world.state.frame == 0)
    for i in range(run.episode.detections):
        run.candidate[i].id = true_id(run.owner, run.world.fiducials.shape[0], run.label[i]) if labelled else ANYTHING
    return labelled


@compiled
def judge(run: Run) -> None:
    """Count the wrong matches of a frame, and the features that were born of clutter."""
    count, events = run.episode.detections, run.episode.events
    matches, labels = run.candidate[:count], run.label[:count]
    wrong, false = judge_matches(run.owner, run.estimate, run.world.fiducials.shape[0], matches, labels)
    events.wrong_matches += wrong
    events.false_births += false


@compiled
def present(run: Run) -> None:
    """Write the whole estimate."""
    write_estimate(run.ekf, run.models.filter.initialisation.mapped_depth_ratio, run.estimate)


@compiled
def present_at(runs: Run, i: int) -> None:
    """Write the whole estimate of run ``i``."""
    present(run_at(runs, i))


@compiled
def close_frame(run: Run) -> None:
    """After a frame: features retire expected landmarks, and those looked at and not found are expected elsewhere."""
    models, estimate = run.models, run.estimate
    run.world.state.frame += 1
    update_expectation(run.expected, models.landmark_var, estimate)
    if models.negative_information:
        pose, key, seen = estimate.state.camera, run.episode.redraw_key, run.episode.views
        run.episode.views = disprove(models, known_boxes(run), pose, key, run.expected, run.viewpoint, seen)
