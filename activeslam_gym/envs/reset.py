"""The start of a run: its room, its prior and its noise."""

import dataclasses
from typing import NamedTuple

import numpy as np

from activeslam_gym.camera import camera_point, pixel_from_camera_point, ray_from_pixel
from activeslam_gym.config import UNIFORM, Scenario
from activeslam_gym.envs.disproof import VIEWS
from activeslam_gym.envs.observation import layout_of
from activeslam_gym.envs.run import EPISODE, MODELS, OWNER, Run
from activeslam_gym.envs.setting import Setting, models_of
from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.information.entropy import EXPECTED, VIEW, WAITING
from activeslam_gym.kernels import row
from activeslam_gym.motion import POSITION, QUATERNION
from activeslam_gym.sensors.sensor import TEXTURED
from activeslam_gym.slam.belief import empty_beliefs, feature_capacity, reset_belief, start_of
from activeslam_gym.slam.detection import DETECTION
from activeslam_gym.slam.estimate import empty_estimates
from activeslam_gym.world.room import draw_room, expected_points, varied
from activeslam_gym.world.scenes import BoxScene, Scene
from activeslam_gym.world.simulator import boxes_of, detection_capacity, empty_worlds, put_room


def empty_runs(scenario: Scenario, count: int) -> Run:
    """``count`` runs of the scenario's capacity: arrays with a leading axis. `reset_run` fills one of them."""
    features, capacity = feature_capacity(scenario), detection_capacity(scenario)
    textured = scenario.sensor in TEXTURED
    box_count = scenario.box_capacity
    if textured:  # their rooms have boxes of their own
        from activeslam_gym.vision.room.scene import BOX_COUNT

        box_count = BOX_COUNT
    detections = np.zeros((count, capacity), DETECTION)
    detections["R"] = scenario.pixel_std**2 * np.eye(2)
    return Run(
        models=np.zeros(count, MODELS),
        world=empty_worlds(scenario, count, box_count),
        ekf=empty_beliefs(scenario, count),
        estimate=empty_estimates(features, count),
        expected=np.zeros((count, scenario.landmark_count), EXPECTED),
        viewpoint=np.zeros((count, VIEWS if scenario.negative_information else 0), VIEW),
        detections=detections,
        label=np.zeros((count, capacity), np.int64),
        first_seen=np.zeros((count, features if textured else 0, 3)),
        owner=np.zeros((count, features), OWNER),
        episode=np.zeros(count, EPISODE),
        observation=np.zeros((count, layout_of(scenario).size), np.float32),
    )


class Start(NamedTuple):
    """The part of a reset that the arrays of the run do not hold."""

    mean: np.ndarray  # (13,) of the camera's prior
    covariance: np.ndarray  # (12, 12) of the camera's prior
    scene: Scene | None  # the foreign scene; None: the boxes of the world's arrays
    scenario: Scenario  # with its varied fields as they are drawn


def reset_run(setting: Setting, runs: Run, i: int, key: int) -> Start:
    """Begin a new episode of run ``i`` of ``runs`` from ``key``, a non-negative integer.

    Room, expected landmarks and noise are separate streams of it. `step_runs` with BEGIN evaluates the run.
    """
    room, expected, noise, sight, redraws = np.random.SeedSequence(key).spawn(5)
    rng = np.random.default_rng(room)
    scenario = varied(setting.scenario, rng)
    runs.models[i] = setting.models
    run = row(runs, i)
    if scenario is not setting.scenario:
        runs.models[i] = models_of(scenario, setting.task, setting.motion_period)
        run.detections["R"] = scenario.pixel_std**2 * np.eye(2)
    anywhere = scenario.sensor in TEXTURED  # landmarks stand for the parts of the room that no feature has
    drawn = draw_room(dataclasses.replace(scenario, landmark_layout=UNIFORM) if anywhere else scenario, rng)
    put_room(run.world, drawn)
    run.world.state.noise_key[:] = noise.generate_state(1, np.uint64)
    run.expected[:] = np.zeros(1, EXPECTED)
    run.expected["point"] = expected_points(scenario, drawn, np.random.default_rng(expected))
    run.expected["feature"] = WAITING
    run.owner["id"] = 0
    run.estimate.state.count, run.estimate.state.whole = 0, False
    runs.episode[i] = np.zeros(1, EPISODE)[0]
    run.episode.redraw_key[:] = redraws.generate_state(1, np.uint64)
    mean, covariance = start_of(scenario)
    mean[: len(drawn.place)] = drawn.place
    if scenario.labelled_first_match:
        face_fiducials(run, mean, np.random.default_rng(sight))
    reset_belief(run.ekf, mean, covariance)
    return Start(mean, covariance, drawn.scene, scenario)


def box_scene(run: Run) -> BoxScene:
    """The scene of a run, where it is `boxes`."""
    return BoxScene(run.models.motion.half.copy(), boxes_of(run.world).copy())


def face_fiducials(run: Run, mean: np.ndarray, rng: np.random.Generator) -> None:
    """Turn the ``mean`` (13,) of the camera so that labelled first detections of the fiducials point at them.

    This is Wahba's problem. A prior of 45 degrees is too wide to linearise at its mean; this gives the first update a
    place to start from. The covariance stays: its isotropic rotation is the same about any mean.
    """
    from scipy.spatial.transform import Rotation

    lens, pose = run.models.lens, run.world.state.camera
    R_WC, z = rotation_matrix(pose[QUATERNION]), np.empty(2)
    rays, directions = [], []
    for fiducial in run.world.fiducials:
        if pixel_from_camera_point(lens, camera_point(R_WC, pose, fiducial), z):
            rays.append(ray_from_pixel(lens, z + lens.pixel_std * rng.standard_normal(2)))
            directions.append(fiducial - mean[POSITION])
    if len(rays) >= 2:
        rays = [ray / np.linalg.norm(ray) for ray in rays]
        directions = [direction / np.linalg.norm(direction) for direction in directions]
        rotation, _ = Rotation.align_vectors(directions, rays)
        mean[QUATERNION] = rotation.as_quat(scalar_first=True)
