"""The truth: rooms, noise that depends on the frame alone, walls, and what is detected."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from activeslam_gym.camera import camera_of
from activeslam_gym.config import Scenario
from activeslam_gym.geometry import rotation_error, rotation_matrix
from activeslam_gym.kernels import row
from activeslam_gym.motion import motion_of, transition
from activeslam_gym.slam.filter import detections_of
from activeslam_gym.world import simulator
from activeslam_gym.world.noise import normals, uniforms
from activeslam_gym.world.room import draw_room, draw_start, varied
from tests.support import CAMERA, PAPER, pixel_of, replaced

KEY = np.array([12345], np.uint64)
MOTION = motion_of(PAPER, 1.0)
CALM = replaced(MOTION, acceleration_std=0.0, angular_acceleration_std=0.0)


def world(scenario: Scenario = PAPER, seed: int = 0) -> simulator.World:
    out, rng = row(simulator.empty_worlds(scenario, 1, scenario.box_capacity), 0), np.random.default_rng(seed)
    simulator.put_room(out, draw_room(varied(scenario, rng), rng))
    out.state.noise_key[:] = KEY
    return out


def points_of(truth: simulator.World) -> np.ndarray:
    """(K + L, 3) as labels count them."""
    return np.concatenate((truth.fiducials, truth.landmarks))


def look(scenario: Scenario, truth: simulator.World, frame: int) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (M, 2) and labels (M,) of one image."""
    candidates = detections_of(np.zeros((simulator.detection_capacity(scenario), 2)))
    labels = np.zeros(len(candidates), np.int64)
    truth.state.frame = frame
    n = simulator.detect(camera_of(scenario), simulator.sensor_of(scenario), truth, candidates, labels)
    return candidates["pixel"][:n], labels[:n]


def seen(scenario: Scenario, truth: simulator.World, frame: int) -> dict[int, list[float]]:
    """The pixel of each detection, by its label."""
    pixels, labels = look(scenario, truth, frame)
    return dict(zip(labels.tolist(), pixels.tolist(), strict=True))


def test_landmarks_are_uniform_in_the_room() -> None:
    points = np.concatenate([world(seed=seed).landmarks for seed in range(50)])
    assert (np.abs(points) <= 0.5 * np.array(PAPER.room_size)).all()
    np.testing.assert_allclose(points.std(axis=0), np.sqrt(PAPER.landmark_prior_variance), rtol=0.05)
    np.testing.assert_allclose(points.mean(axis=0), 0.0, atol=0.15)


def test_fiducials_are_in_the_first_image_and_the_start_is_drawn_from_the_prior() -> None:
    for truth in (world(seed=seed) for seed in range(5)):
        pixels = np.array([pixel_of(CAMERA, truth.state.camera, y) for y in truth.fiducials])
        assert (0.0 < pixels).all() and (pixels < (320.0, 240.0)).all()
        assert (np.linalg.norm(truth.fiducials - truth.state.camera[:3], axis=1) < 3.0).all()
    centre = np.array((0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0))
    starts = np.array([draw_start(PAPER, np.random.default_rng(seed), centre) for seed in range(400)])
    turns = np.array([rotation_error(np.ascontiguousarray(q), np.array([1.0, 0, 0, 0])) for q in starts[:, 3:7]])
    np.testing.assert_allclose(starts[:, :3].std(axis=0), PAPER.position_std, rtol=0.15)
    np.testing.assert_allclose(turns.std(axis=0), PAPER.orientation_std, rtol=0.15)
    np.testing.assert_allclose(starts[:, 7:10].std(axis=0), PAPER.velocity_std, rtol=0.15)


def test_a_draw_is_a_function_of_key_and_counter_alone() -> None:
    whole, next_key = uniforms(KEY, 0, 100), KEY + np.uint64(1)
    np.testing.assert_array_equal(uniforms(KEY, 40, 10), whole[40:50])
    np.testing.assert_array_equal(normals(KEY, 40, 10), normals(KEY, 0, 100)[40:50])
    assert not np.any(uniforms(next_key, 0, 100) == whole)
    assert abs(np.corrcoef(normals(KEY, 0, 5000), normals(next_key, 0, 5000))[0, 1]) < 0.05


def test_draws_are_uniform_and_normal() -> None:
    from scipy import stats

    z = normals(KEY, 0, 20000)
    assert stats.kstest(uniforms(KEY, 0, 20000), "uniform").pvalue > 0.001
    assert stats.kstest(z, "norm").pvalue > 0.001
    assert abs(np.corrcoef(z[:-1], z[1:])[0, 1]) < 0.03


def test_the_camera_moves_by_the_model_and_by_its_disturbance() -> None:
    truth, u = world(), np.array([0.5, -0.2, 0.1, 0.0, 0.3, 0.0])
    expected = transition(truth.state.camera, u, MOTION.dt)
    assert simulator.move(CALM, truth, u) == 0
    np.testing.assert_array_equal(truth.state.camera, expected)
    truth, speeds = world(), []
    for frame in range(2000):
        truth.state.camera[:], truth.state.frame = [0.0, 0, 0, 1, 0, 0, 0] + [0.0] * 6, frame
        simulator.move(MOTION, truth, np.zeros(6))
        speeds.append(truth.state.camera[7:] / MOTION.dt)
    np.testing.assert_allclose(np.std(speeds, axis=0), [0.5] * 6, rtol=0.07)
    np.testing.assert_allclose(np.mean(speeds, axis=0), 0.0, atol=0.05)


@pytest.mark.parametrize(("axis", "reach"), [(0, 2.9), (1, 0.9), (2, 2.9)])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_wall_stops_what_runs_into_it_alone(axis: int, reach: float, side: float) -> None:
    truth = world()
    p, v = truth.state.camera[:3], truth.state.camera[7:10]
    p[:], v[:] = 0.0, 0.1
    p[axis], v[axis] = side * (reach - 0.001), side
    assert simulator.move(CALM, truth, np.zeros(6)) == 1
    assert p[axis] == pytest.approx(side * reach)
    np.testing.assert_allclose(v, [0.0 if i == axis else 0.1 for i in range(3)])
    v[axis] = -side
    assert simulator.move(CALM, truth, np.zeros(6)) == 0
    assert v[axis] == -side


def test_every_visible_point_is_detected_once_and_nothing_else() -> None:
    truth = world()
    camera, points = truth.state.camera, points_of(truth)
    depths = (points - camera[:3]) @ rotation_matrix(camera[3:7])[:, 2]
    in_front = np.flatnonzero(depths >= PAPER.minimum_depth)
    pixels = np.array([pixel_of(CAMERA, camera, points[i]) for i in in_front])
    inside = ((pixels >= 0.0) & (pixels < [320.0, 240.0])).all(axis=1)
    assert sorted(look(PAPER, truth, 0)[1].tolist()) == in_front[inside].tolist()
    assert inside[:6].all() and not inside.all() and len(in_front) < len(points)


def test_noise_order_and_misses_of_detections_are_as_told() -> None:
    truth = world()
    found = [one for frame in range(300) for one in seen(PAPER, truth, frame).items()]
    errors = [z - pixel_of(CAMERA, truth.state.camera, points_of(truth)[i]) for i, z in found]
    np.testing.assert_allclose(np.std(errors, axis=0), 2.0, rtol=0.05)
    np.testing.assert_allclose(np.mean(errors, axis=0), 0.0, atol=0.1)
    firsts = Counter(int(look(PAPER, truth, frame)[1][0]) for frame in range(200))
    assert len(firsts) >= 6 and max(firsts.values()) < 100
    scenario, truth = replace(PAPER, missed_detection_probability=0.2), world()
    whole = len(look(PAPER, truth, 0)[1])
    kept = np.mean([len(look(scenario, truth, frame)[1]) for frame in range(400)])
    assert kept / whole == pytest.approx(0.8, abs=0.03)


def test_clutter_comes_at_its_rate_over_the_whole_image() -> None:
    scenario, truth = replace(PAPER, clutter_rate=2.0), world()
    looks = [look(scenario, truth, frame) for frame in range(500)]
    false = [pixels[labels == simulator.CLUTTER_LABEL] for pixels, labels in looks]
    counts, pixels = [len(one) for one in false], np.concatenate(false)
    assert np.mean(counts) == pytest.approx(2.0, abs=0.2)
    assert np.var(counts) == pytest.approx(2.0, abs=0.4)
    assert (pixels >= 0).all() and (pixels < [320, 240]).all()
    np.testing.assert_allclose(pixels.mean(axis=0), [160, 120], atol=10)


def test_clutter_does_not_change_the_noise_of_the_points_and_there_is_room_for_it() -> None:
    truth, full = world(), replace(PAPER, clutter_rate=30.0)
    dirty, clean = seen(replace(PAPER, clutter_rate=3.0), truth, 5), seen(PAPER, truth, 5)
    assert {i: z for i, z in dirty.items() if i >= 0} == clean and len(dirty) > len(clean)
    assert max(len(look(full, truth, frame)[1]) for frame in range(300)) <= simulator.detection_capacity(full)
