"""The truth: rooms, noise that depends on the frame alone, walls, and what is detected."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from activeslam_gym.camera import camera_of
from activeslam_gym.config import SCENARIOS, Scenario
from activeslam_gym.geometry import rotation_matrix
from activeslam_gym.motion import motion_of, transition
from activeslam_gym.world.noise import normals, uniforms
from activeslam_gym.world.room import draw_points, draw_start
from activeslam_gym.world.simulator import CLUTTER_LABEL, Detections, World, detect, detection_capacity, move, sensor_of

from .support import CAMERA, PAPER, pixel_of, rotation_between

KEY = np.array([12345], np.uint64)
MOTION = motion_of(PAPER, 1.0)


def world(scenario: Scenario = PAPER, seed: int = 0) -> World:
    rng = np.random.default_rng(seed)
    start = draw_start(scenario, rng)
    return World(start, draw_points(scenario, start, rng), KEY.copy())


def look(scenario: Scenario, truth: World, frame: int) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (M, 2) and labels (M,) of one image."""
    rows = detection_capacity(scenario)
    out = Detections(np.zeros((rows, 2)), np.zeros(rows, np.int64), np.zeros(1, np.int64))
    detect(camera_of(scenario), sensor_of(scenario), truth, frame, out)
    return out.pixels[: out.used[0]], out.labels[: out.used[0]]


# Rooms --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SCENARIOS)
def test_points_lie_in_the_room(name: str) -> None:
    scenario = SCENARIOS[name]
    points = world(scenario).points
    assert points.shape == (scenario.fiducial_count + scenario.landmark_count, 3)
    assert (np.abs(points) <= 0.5 * np.array(scenario.room_size)).all()


def test_landmarks_are_uniform() -> None:
    points = np.concatenate([world(seed=seed).points[6:] for seed in range(50)])
    np.testing.assert_allclose(points.std(axis=0), np.sqrt(PAPER.landmark_prior_variance), rtol=0.05)
    np.testing.assert_allclose(points.mean(axis=0), 0.0, atol=0.15)


@pytest.mark.parametrize("seed", range(5))
def test_fiducials_are_in_the_first_image_at_their_distance(seed: int) -> None:
    truth = world(seed=seed)
    for y in truth.points[:6]:
        u, v = pixel_of(CAMERA, truth.camera, y)
        assert 0.0 < u < 320.0 and 0.0 < v < 240.0
        assert np.linalg.norm(y - truth.camera[:3]) < 3.0


def test_start_is_drawn_from_the_prior() -> None:
    starts = np.array([draw_start(PAPER, np.random.default_rng(seed)) for seed in range(400)])
    turns = np.array([rotation_between(q, np.array([1.0, 0, 0, 0])) for q in starts[:, 3:7]])
    np.testing.assert_allclose(starts[:, :3].std(axis=0), PAPER.position_std, rtol=0.15)
    np.testing.assert_allclose(turns.std(axis=0), PAPER.orientation_std, rtol=0.15)
    np.testing.assert_allclose(starts[:, 7:10].std(axis=0), PAPER.velocity_std, rtol=0.15)


# Noise --------------------------------------------------------------------------------------------------------------


def test_a_draw_is_a_function_of_key_and_counter_alone() -> None:
    whole = uniforms(KEY, 0, 100)
    np.testing.assert_array_equal(uniforms(KEY, 40, 10), whole[40:50])
    np.testing.assert_array_equal(normals(KEY, 40, 10), normals(KEY, 0, 100)[40:50])
    assert not np.any(uniforms(KEY + np.uint64(1), 0, 100) == whole)


def test_draws_are_uniform_and_normal() -> None:
    from scipy import stats

    assert stats.kstest(uniforms(KEY, 0, 20000), "uniform").pvalue > 0.001
    z = normals(KEY, 0, 20000)
    assert stats.kstest(z, "norm").pvalue > 0.001
    assert abs(np.corrcoef(z[:-1], z[1:])[0, 1]) < 0.03


def test_neighbouring_streams_are_unrelated() -> None:
    assert abs(np.corrcoef(normals(KEY, 0, 5000), normals(KEY + np.uint64(1), 0, 5000))[0, 1]) < 0.05


# Motion -------------------------------------------------------------------------------------------------------------


def test_without_noise_the_camera_moves_by_the_model() -> None:
    truth, u = world(), np.array([0.5, -0.2, 0.1, 0.0, 0.3, 0.0])
    expected = transition(truth.camera, u, MOTION.dt)
    assert move(MOTION._replace(acceleration_std=0.0, angular_acceleration_std=0.0), truth, u, 0) == 0
    np.testing.assert_array_equal(truth.camera, expected)


def test_disturbance_is_as_strong_as_it_says() -> None:
    speeds = []
    for frame in range(2000):
        truth = World(np.array([0.0, 0, 0, 1, 0, 0, 0] + [0.0] * 6), np.zeros((33, 3)), KEY)
        move(MOTION, truth, np.zeros(6), frame)
        speeds.append(truth.camera[7:] / MOTION.dt)
    np.testing.assert_allclose(np.std(speeds, axis=0), [0.5] * 6, rtol=0.07)
    np.testing.assert_allclose(np.mean(speeds, axis=0), 0.0, atol=0.05)


def test_disturbance_of_a_frame_does_not_depend_on_the_past() -> None:
    one, other = world(), world()
    for frame in range(10):
        move(MOTION, one, np.ones(6), frame)
        other.camera[7:] = one.camera[7:]
    before = one.camera[7:].copy()
    move(MOTION, one, np.zeros(6), 10)
    move(MOTION, other, np.zeros(6), 10)
    np.testing.assert_array_equal(one.camera[7:] - before, other.camera[7:] - before)


@pytest.mark.parametrize(("axis", "reach"), [(0, 2.9), (1, 0.9), (2, 2.9)])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_wall_stops_what_runs_into_it_alone(axis: int, reach: float, side: float) -> None:
    still = MOTION._replace(acceleration_std=0.0)
    truth = world()
    truth.camera[:3], truth.camera[7:10] = 0.0, 0.1
    truth.camera[axis], truth.camera[7 + axis] = side * (reach - 0.001), side
    assert move(still, truth, np.zeros(6), 0) == 1
    assert truth.camera[axis] == pytest.approx(side * reach)
    np.testing.assert_allclose(truth.camera[7:10], [0.0 if i == axis else 0.1 for i in range(3)])
    truth.camera[7 + axis] = -side
    assert move(still, truth, np.zeros(6), 1) == 0
    assert truth.camera[7 + axis] == -side


# Detections ---------------------------------------------------------------------------------------------------------


def test_every_visible_point_is_detected_once_and_nothing_else() -> None:
    truth = world()
    in_front = [i for i, y in enumerate(truth.points) if (y - truth.camera[:3]) @ forward(truth) >= PAPER.minimum_depth]
    pixels = np.array([pixel_of(CAMERA, truth.camera, truth.points[i]) for i in in_front])
    inside = ((pixels >= 0.0) & (pixels < [320.0, 240.0])).all(axis=1)
    assert sorted(look(PAPER, truth, 0)[1].tolist()) == [i for i, seen in zip(in_front, inside, strict=True) if seen]
    assert inside[:6].all() and not inside.all() and len(in_front) < len(truth.points)


def forward(truth: World) -> np.ndarray:
    return rotation_matrix(truth.camera[3:7])[:, 2]


def test_noise_is_two_pixels() -> None:
    truth = world()
    errors = []
    for frame in range(300):
        pixels, labels = look(PAPER, truth, frame)
        errors += [z - pixel_of(CAMERA, truth.camera, truth.points[i]) for z, i in zip(pixels, labels, strict=True)]
    np.testing.assert_allclose(np.std(errors, axis=0), 2.0, rtol=0.05)
    np.testing.assert_allclose(np.mean(errors, axis=0), 0.0, atol=0.1)


def test_order_tells_nothing() -> None:
    truth = world()
    firsts = Counter(int(look(PAPER, truth, frame)[1][0]) for frame in range(200))
    assert len(firsts) >= 6
    assert max(firsts.values()) < 100


def test_a_points_noise_is_the_same_from_everywhere() -> None:
    """Paired comparisons: the pixel noise of a point in frame k does not depend on where the camera went."""
    here, there = world(), world()
    there.camera[0] += 0.05
    one, other = (
        {
            int(i): z - pixel_of(CAMERA, truth.camera, truth.points[i])
            for z, i in zip(*look(PAPER, truth, 3), strict=True)
        }
        for truth in (here, there)
    )
    both = set(one) & set(other)
    assert len(both) >= 6
    for i in both:
        np.testing.assert_allclose(one[i], other[i], atol=1e-9)


def test_missed_detections_are_missed_as_often_as_they_say() -> None:
    scenario, truth = replace(PAPER, missed_detection_probability=0.2), world()
    whole = len(look(PAPER, truth, 0)[1])
    seen = np.mean([len(look(scenario, truth, frame)[1]) for frame in range(400)])
    assert seen / whole == pytest.approx(0.8, abs=0.03)


def test_clutter_comes_at_its_rate_over_the_whole_image() -> None:
    scenario, truth = replace(PAPER, clutter_rate=2.0), world()
    counts, false = [], []
    for frame in range(500):
        pixels, labels = look(scenario, truth, frame)
        counts.append(np.sum(labels == CLUTTER_LABEL))
        false.append(pixels[labels == CLUTTER_LABEL])
    pixels = np.concatenate(false)
    assert np.mean(counts) == pytest.approx(2.0, abs=0.2)
    assert np.var(counts) == pytest.approx(2.0, abs=0.4)
    assert (pixels >= 0).all() and (pixels < [320, 240]).all()
    np.testing.assert_allclose(pixels.mean(axis=0), [160, 120], atol=10)


def test_clutter_does_not_change_the_noise_of_the_points() -> None:
    truth = world()
    clean = dict(zip(*(x.tolist() for x in reversed(look(PAPER, truth, 5))), strict=True))
    dirty = dict(zip(*(x.tolist() for x in reversed(look(replace(PAPER, clutter_rate=3.0), truth, 5))), strict=True))
    assert {i: z for i, z in dirty.items() if i >= 0} == clean


def test_there_is_room_for_every_detection() -> None:
    scenario, truth = replace(PAPER, clutter_rate=30.0), world()
    assert max(len(look(scenario, truth, frame)[1]) for frame in range(300)) <= detection_capacity(scenario)
