"""Templates and search against a ray-cast plane; corners."""

import numpy as np
import pytest

pytest.importorskip("cv2", reason="the extra `vision` is not installed")

from activeslam_gym.vision.corners import new_corners  # noqa: E402
from activeslam_gym.vision.search import FOUND, MISSING, UNSEARCHED, Findings, search  # noqa: E402
from activeslam_gym.vision.settings import FrontEndSettings  # noqa: E402
from activeslam_gym.vision.templates import (
    TEMPLATE_HALF,
    TEMPLATE_SIDE,
    empty_templates,
    predict_appearance,
    store,
    tilt,
)  # noqa: E402
from activeslam_gym.vision.views import projected, view_from  # noqa: E402

from .vision_scene import CAMERA, image_from, plane_points, pose_at, texture  # noqa: E402

FIRST = pose_at((0.02, 0.01, 0.7))
ASIDE = pose_at((0.3, 0.2, 0.7), (0.0, 0.7, 0.0))  # sees the plane obliquely
BEHIND, NOTHING = np.array((0.0, 0.0, -1.0)), np.zeros((0, 2))
SETTINGS = FrontEndSettings(least_score=0.7, grain=4.0)


def stored(pixel: np.ndarray, image: np.ndarray):
    templates = empty_templates(2)
    store(view_from(CAMERA, FIRST), templates, 0, 7, image.astype(np.float32), pixel, BEHIND, 0.0)
    return templates, np.array((*plane_points(FIRST, pixel[:1], pixel[1:])[0], 0.0))


def searched(
    pose: np.ndarray, templates, point: np.ndarray, image: np.ndarray, z_hat: np.ndarray, var: float
) -> Findings:
    model, places, S = SETTINGS.search(scouting=False), np.array([0]), var * np.eye(2)[None]
    view = view_from(CAMERA, pose)
    return search(view, model, templates, image.astype(np.float32), places, point[None], z_hat[None], S)


@pytest.mark.parametrize("pixel", [(160.0, 120.0), (60.0, 70.0), (255.0, 190.0)])
@pytest.mark.parametrize("move", [(0.0, 0.0, 0.0), (0.25, 0.0, -0.1), (-0.1, 0.15, 0.25)])
def test_the_warped_template_is_what_rays_see(pixel, move) -> None:
    templates, point = stored(np.array(pixel), image_from(FIRST))
    pose = pose_at(tuple(FIRST[:3] + move), (0.05, -0.1, 0.2))
    drawn = np.empty((TEMPLATE_SIDE, TEMPLATE_SIDE), np.float32)
    assert predict_appearance(view_from(CAMERA, pose), templates, 0, point, drawn, np.empty((3, 2)))
    centre, half = projected(CAMERA, pose, point[None])[0], TEMPLATE_SIDE // 2
    y, x = np.mgrid[-half : half + 1, -half : half + 1].astype(float)
    truth = texture(plane_points(pose, centre[0] + x, centre[1] + y))
    seen = np.isfinite(drawn)
    assert np.corrcoef(drawn[seen], truth[seen])[0, 1] > 0.995
    assert np.abs(drawn - truth)[seen].mean() < 3.0  # grey levels: bilinear sampling of the first image, once


def test_a_view_from_behind_or_far_is_not_predicted() -> None:
    templates, point = stored(np.array((160.0, 120.0)), image_from(FIRST))
    drawn = np.empty((TEMPLATE_SIDE, TEMPLATE_SIDE), np.float32)
    for pose in (pose_at((0.0, 0.0, 3.0)), pose_at((0.0, 0.0, 0.2)), pose_at((0.9, 0.0, 0.15), (0.0, 1.2, 0.0))):
        assert not predict_appearance(view_from(CAMERA, pose), templates, 0, point, drawn, np.empty((3, 2)))


@pytest.mark.parametrize("step", [(0.0, 0.0), (0.004, 0.0015), (-0.0023, 0.0031), (0.0, -0.0052)])
def test_matches_are_good_to_a_twentieth_of_a_pixel(step) -> None:
    image, pose = image_from(FIRST), pose_at(tuple(FIRST[:3] + (*step, 0.0)))
    now = image_from(pose)
    for pixel in new_corners(image, NOTHING, 8, 20.0, 30, 1e-4, 0.0):
        templates, point = stored(pixel, image)
        truth = projected(CAMERA, pose, point[None])[0]
        found = searched(pose, templates, point, now, truth + 2.3, 4.0)
        assert found.state[0] == FOUND and found.score[0, 0] > 0.95
        assert np.abs(found.pixel[0, 0] - truth).max() < 0.05
        assert np.linalg.eigvalsh(found.R[0, 0]).min() >= SETTINGS.floor_std**2


def test_absent_features_are_missing_and_vague_ones_are_not_searched() -> None:
    pixel = np.array((160.0, 120.0))
    templates, point = stored(pixel, image_from(FIRST))
    for var, state in ((4.0, MISSING), (400.0, UNSEARCHED)):
        assert searched(FIRST, templates, point, np.full((240, 320), 90), pixel, var).state[0] == state


def test_new_corners_keep_their_distance_and_go_where_there_are_few() -> None:
    left = np.array([(x, y) for x in (40.0, 80.0, 120.0) for y in (40.0, 100.0, 160.0, 200.0)])
    found = new_corners(image_from(FIRST), left, 6, 15.0, 15, 1e-4, 0.0)
    assert len(found) == 6 and (found[:, 0] > 128).all()
    both = np.vstack((left, found))
    apart = np.abs(both[:, None] - both[None]).max(axis=-1) + 1e3 * np.eye(len(both))
    assert apart.min() >= 14.0
    assert new_corners(np.full((240, 320), 90, np.uint8), left, 6, 15.0, 15, 1e-4, 0.0).shape == (0, 2)


@pytest.mark.parametrize("angle", [0.0, 0.4, 1.1])
def test_a_new_corner_is_where_the_edges_meet(angle) -> None:
    """The corners of a square: the place of greatest strength is up to 3 px away."""
    y, x = np.mgrid[:240, :320].astype(float)
    turn = np.array(((np.cos(angle), np.sin(angle)), (-np.sin(angle), np.cos(angle))))
    a, b = np.tensordot(turn, np.array((x - 160.2, y - 119.7)), 1)
    sides = np.clip(30.5 - np.abs(a), 0.0, 1.0) * np.clip(30.5 - np.abs(b), 0.0, 1.0)
    found = new_corners((60.0 + 140.0 * sides).astype(np.uint8), NOTHING, 4, 15.0, 15, 1e-2, 0.0)
    truth = np.array([(i, j) for i in (-30.0, 30.0) for j in (-30.0, 30.0)]) @ turn + (160.2, 119.7)
    assert len(found) == 4
    assert np.abs(found[:, None] - truth).max(axis=2).min(axis=1).max() <= 1.0


def test_an_edge_bears_no_feature_and_a_corner_does() -> None:
    """A wavy edge is a corner by its strength alone; along itself it is found nowhere in particular."""
    x, y = np.meshgrid(np.arange(320.0), np.arange(240.0))
    edge = np.clip(128.0 + 60.0 * (x - 160.0 - 1.5 * np.sin(y / 5.0)), 60.0, 200.0).astype(np.uint8)
    assert len(new_corners(edge, NOTHING, 4, 13.0, 15, 4e-4, 0.0)) == 4
    assert len(new_corners(edge, NOTHING, 4, 13.0, 15, 4e-4, 0.15)) == 0
    edge[100:140, 60:100] = 220
    found = new_corners(edge, NOTHING, 4, 13.0, 15, 4e-4, 0.15)
    meeting = np.array([(60, 100), (99, 100), (60, 139), (99, 139)])
    assert len(found) == 4 and np.abs(meeting[:, None] - found).max(axis=2).min(axis=0).max() <= 2


@pytest.mark.parametrize("step", [0.0, 0.003])
def test_halves_of_a_template_move_together_on_a_plane_and_apart_at_an_edge_in_depth(step) -> None:
    image, pixel = image_from(FIRST), np.array((160.0, 120.0))
    templates, point = stored(pixel, image)
    pose, beside = (pose_at((FIRST[0] + x, FIRST[1], FIRST[2])) for x in (step, step + 0.002))
    now, z = image_from(pose), projected(CAMERA, pose, point[None])[0]
    moved = z - projected(CAMERA, beside, point[None])[0]
    edge = np.where(np.arange(now.shape[1]) < z[0], now, image_from(beside))  # what is right is nearer
    plane = searched(pose, templates, point, now, z, 2.0).strain[0, 0]
    torn = searched(pose, templates, point, edge, z, 2.0).strain[0, 0]
    assert np.abs(plane).max() < 0.06
    assert np.linalg.norm(moved) > 0.4 and np.dot(torn[:2] - plane[:2], moved) > 0.3 * np.dot(moved, moved)


def seen_from_aside(pixel: tuple[float, float], image: np.ndarray, slope_std: float):
    """A template of the plane, seen obliquely, that is not known to be oblique."""
    templates, z = empty_templates(1), np.array(pixel)
    store(view_from(CAMERA, ASIDE), templates, 0, 7, image.astype(np.float32), z, np.zeros(3), slope_std)
    return templates, np.array((*plane_points(ASIDE, z[:1], z[1:])[0], 0.0))


def moved(steps: float) -> np.ndarray:
    return pose_at(tuple(ASIDE[:3] + steps * np.array((-0.015, 0.008, 0.004))), (0.0, 0.7, 0.0))


ASIDE_PIXELS = [pytest.param(one, marks=pytest.mark.slow) for one in ((160.0, 120.0), (130.0, 140.0))]


@pytest.mark.parametrize("pixel", [*ASIDE_PIXELS, (220.0, 160.0)])
def test_the_slopes_of_a_plane_are_learnt_and_its_pixels_are_right_then(pixel) -> None:
    errors = {}
    for std in (0.0, 0.7):
        templates, point = seen_from_aside(pixel, image_from(ASIDE), std)
        facing = templates.normal[0].copy()
        for k in range(1, 9):
            pose = moved(k)
            z = projected(CAMERA, pose, point[None])[0]
            found = searched(pose, templates, point, image_from(pose), z + 0.3, 4.0)
            assert found.state[0] == FOUND
            tilt(templates, 0, found.slope[0, 0], found.slope_cov[0, 0])
            errors[std] = np.hypot(*(found.pixel[0, 0] - z))
        normal = templates.normal[0] / np.linalg.norm(templates.normal[0])
        learnt = np.degrees(np.arccos(normal @ BEHIND))
        if std == 0.0:
            np.testing.assert_array_equal(templates.normal[0], facing)
            assert learnt > 20.0
        else:
            assert learnt < 3.0
            assert np.sqrt(templates.slope_cov[0].diagonal()).max() < 0.1
    assert errors[0.7] < 0.04 and errors[0.0] > 0.12


def test_what_slopes_shift_agrees_with_differences() -> None:
    """A picture whose grey values are its columns, and one of its rows: a template is of the pixels that it shows."""
    ramps = np.mgrid[: int(CAMERA.height), : int(CAMERA.width)].astype(np.float32)[::-1]
    pose, slopes, h = moved(9.0), np.array((0.3, -0.2)), 1e-3
    slant, drawn = np.empty((3, 2)), np.empty((3, 2, TEMPLATE_SIDE, TEMPLATE_SIDE), np.float32)  # at 0, a + h, b + h
    for axis, ramp in enumerate(ramps):
        for k, more in enumerate(((0.0, 0.0), (h, 0.0), (0.0, h))):
            templates, point = seen_from_aside((170.0, 110.0), ramp, 0.7)
            tilt(templates, 0, slopes + more, np.eye(2))
            own = np.empty((3, 2))
            assert predict_appearance(view_from(CAMERA, pose), templates, 0, point, drawn[k, axis], own)
            slant = own if k == 0 else slant
    at = np.array(((2, 4), (12, 3), (10, 12)))
    for i, j in at:
        shown = drawn[0].astype(float)
        by_x, by_y = shown[:, i, j + 1] - shown[:, i, j - 1], shown[:, i + 1, j] - shown[:, i - 1, j]
        along = np.stack((by_x, by_y), axis=1) / 2.0
        x = np.array((j, i)) - TEMPLATE_HALF
        for k in range(2):
            shift = -np.linalg.solve(along, (drawn[1 + k, :, i, j].astype(float) - shown[:, i, j]) / h)
            np.testing.assert_allclose(slant[0] * (slant[1 + k] @ x), shift, atol=0.03)
