"""Templates and search against a ray-cast plane; corners."""

import numpy as np
import pytest

pytest.importorskip("cv2", reason="the extra `vision` is not installed")

from activeslam_gym.kernels import filled
from activeslam_gym.vision.corners import new_corners
from activeslam_gym.vision.search import FOUND, MISSING, SEARCH, UNSEARCHED, Findings, search
from activeslam_gym.vision.settings import FrontEndSettings
from activeslam_gym.vision.templates import TEMPLATE_SIDE, empty_templates, predict_appearance, store
from activeslam_gym.vision.views import projected, view_from

from .vision_scene import CAMERA, image_from, plane_points, pose_at, texture

FIRST = pose_at((0.02, 0.01, 0.7))
BEHIND, NOTHING = np.array((0.0, 0.0, -1.0)), np.zeros((0, 2))
SETTINGS = FrontEndSettings(least_score=0.7, grain=4.0)


def stored(pixel: np.ndarray, image: np.ndarray):
    templates = empty_templates(2)
    store(view_from(CAMERA, FIRST), templates, 0, 7, image.astype(np.float32), pixel, BEHIND)
    return templates, np.array((*plane_points(FIRST, pixel[:1], pixel[1:])[0], 0.0))


def searched(
    pose: np.ndarray, templates, point: np.ndarray, image: np.ndarray, z_hat: np.ndarray, var: float
) -> Findings:
    model, places, S = filled(SEARCH, SETTINGS, gate=11.8), np.array([0]), var * np.eye(2)[None]
    view = view_from(CAMERA, pose)
    return search(view, model, templates, image.astype(np.float32), places, point[None], z_hat[None], S)


@pytest.mark.parametrize("pixel", [(160.0, 120.0), (60.0, 70.0), (255.0, 190.0)])
@pytest.mark.parametrize("move", [(0.0, 0.0, 0.0), (0.25, 0.0, -0.1), (-0.1, 0.15, 0.25)])
def test_the_warped_template_is_what_rays_see(pixel, move) -> None:
    templates, point = stored(np.array(pixel), image_from(FIRST))
    pose = pose_at(tuple(FIRST[:3] + move), (0.05, -0.1, 0.2))
    drawn = np.empty((TEMPLATE_SIDE, TEMPLATE_SIDE), np.float32)
    assert predict_appearance(view_from(CAMERA, pose), templates, 0, point, drawn)
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
        assert not predict_appearance(view_from(CAMERA, pose), templates, 0, point, drawn)


@pytest.mark.parametrize("step", [(0.0, 0.0), (0.004, 0.0015), (-0.0023, 0.0031), (0.0, -0.0052)])
def test_matches_are_good_to_a_twentieth_of_a_pixel(step) -> None:
    image, pose = image_from(FIRST), pose_at(tuple(FIRST[:3] + (*step, 0.0)))
    now = image_from(pose)
    for pixel in new_corners(image, NOTHING, 8, 20.0, 30, 1e-4):
        templates, point = stored(pixel, image)
        truth = projected(CAMERA, pose, point[None])[0]
        found = searched(pose, templates, point, now, truth + 2.3, 4.0)
        assert found.state[0] == FOUND and found.score[0, 0] > 0.95
        assert np.abs(found.pixel[0, 0] - truth).max() < 0.05
        assert np.linalg.eigvalsh(found.R[0, 0]).min() >= SETTINGS.floor_std**2


def test_absent_features_are_missing_and_those_beyond_the_border_are_not_searched() -> None:
    pixel, empty = np.array((160.0, 120.0)), np.full((240, 320), 90)
    templates, point = stored(pixel, image_from(FIRST))
    for z, state in ((pixel, MISSING), (np.array((3.0, 120.0)), UNSEARCHED)):
        assert searched(FIRST, templates, point, empty, z, 4.0).state[0] == state


@pytest.mark.parametrize(("area", "found"), [(20000.0, True), (500.0, False)])
def test_of_a_large_ellipse_the_middle_is_searched(area: float, found: bool) -> None:
    """The feature is 15 px beside its prediction, whose ellipse has 14 800 px^2."""
    pixel, image, S = np.array((160.0, 120.0)), image_from(FIRST), 400.0 * np.eye(2)[None]
    templates, point = stored(pixel, image)
    model = filled(SEARCH, SETTINGS, gate=11.8, largest_area=area)
    view, places = view_from(CAMERA, FIRST), np.array([0])
    out = search(view, model, templates, image.astype(np.float32), places, point[None], pixel[None] + (15.0, 0.0), S)
    assert (out.state[0] == FOUND and np.abs(out.pixel[0, 0] - pixel).max() < 0.1) == found


def test_new_corners_keep_their_distance_and_go_where_there_are_few() -> None:
    left = np.array([(x, y) for x in (40.0, 80.0, 120.0) for y in (40.0, 100.0, 160.0, 200.0)])
    found = new_corners(image_from(FIRST), left, 6, 15.0, 15, 1e-4)
    assert len(found) == 6 and (found[:, 0] > 128).all()
    both = np.vstack((left, found))
    apart = np.abs(both[:, None] - both[None]).max(axis=-1) + 1e3 * np.eye(len(both))
    assert apart.min() >= 14.0
    assert new_corners(np.full((240, 320), 90, np.uint8), left, 6, 15.0, 15, 1e-4).shape == (0, 2)


@pytest.mark.parametrize("angle", [0.0, 0.4, 1.1])
def test_a_new_corner_is_where_the_edges_meet(angle) -> None:
    """The corners of a square: the place of greatest strength is up to 3 px away."""
    y, x = np.mgrid[:240, :320].astype(float)
    turn = np.array(((np.cos(angle), np.sin(angle)), (-np.sin(angle), np.cos(angle))))
    a, b = np.tensordot(turn, np.array((x - 160.2, y - 119.7)), 1)
    sides = np.clip(30.5 - np.abs(a), 0.0, 1.0) * np.clip(30.5 - np.abs(b), 0.0, 1.0)
    found = new_corners((60.0 + 140.0 * sides).astype(np.uint8), NOTHING, 4, 15.0, 15, 1e-2)
    truth = np.array([(i, j) for i in (-30.0, 30.0) for j in (-30.0, 30.0)]) @ turn + (160.2, 119.7)
    assert len(found) == 4
    assert np.abs(found[:, None] - truth).max(axis=2).min(axis=1).max() <= 1.0
