"""Templates and search against a ray-cast plane; corners."""

import numpy as np
import pytest

pytest.importorskip("cv2", reason="the extra `vision` is not installed")

from activeslam_gym.camera import camera_of, pixel_from_camera_point  # noqa: E402
from activeslam_gym.geometry import rotation_matrix  # noqa: E402
from activeslam_gym.kernels import filled  # noqa: E402
from activeslam_gym.vision.corners import new_corners  # noqa: E402
from activeslam_gym.vision.search import FOUND, MISSING, SEARCH, UNSEARCHED, search  # noqa: E402
from activeslam_gym.vision.templates import TEMPLATE_SIDE, empty_templates, predict_appearance, store  # noqa: E402

from .vision_scene import LENS, image_from, plane_points, pose_at, texture  # noqa: E402

CAMERA = camera_of(LENS.scenario())
FIRST = pose_at((0.02, 0.01, 0.7))
BEHIND = np.array((0.0, 0.0, -1.0))
MODEL = filled(
    SEARCH,
    gate=11.8,
    least_score=0.7,
    largest_area=4000.0,
    shrink=False,
    floor_std=0.3,
    grain=4.0,
    warp=True,
    subpixel=True,
)


def pixel_of(pose: np.ndarray, point: np.ndarray) -> np.ndarray:
    z = np.empty(2)
    assert pixel_from_camera_point(CAMERA, rotation_matrix(pose[3:]).T @ (point - pose[:3]), z)
    return z


def stored(pixel: np.ndarray, image: np.ndarray, normal: np.ndarray = BEHIND):
    templates = empty_templates(2)
    store(CAMERA, templates, 0, 7, image.astype(np.float32), pixel, FIRST, normal)
    return templates, np.array((*plane_points(FIRST, pixel[:1], pixel[1:])[0], 0.0))


@pytest.mark.parametrize("pixel", [(160.0, 120.0), (60.0, 70.0), (255.0, 190.0)])
@pytest.mark.parametrize("move", [(0.0, 0.0, 0.0), (0.25, 0.0, -0.1), (-0.1, 0.15, 0.25)])
def test_the_warped_template_is_what_rays_see(pixel, move) -> None:
    pixel = np.array(pixel)
    templates, point = stored(pixel, image_from(FIRST))
    pose = pose_at(tuple(FIRST[:3] + move), (0.05, -0.1, 0.2))
    drawn = np.empty((TEMPLATE_SIDE, TEMPLATE_SIDE), np.float32)
    assert predict_appearance(CAMERA, templates, 0, pose, rotation_matrix(pose[3:]), point, True, drawn)
    centre, half = pixel_of(pose, point), TEMPLATE_SIDE // 2
    y, x = np.mgrid[-half : half + 1, -half : half + 1].astype(float)
    truth = texture(plane_points(pose, centre[0] + x, centre[1] + y))
    seen = np.isfinite(drawn)
    assert np.corrcoef(drawn[seen], truth[seen])[0, 1] > 0.995
    assert np.abs(drawn - truth)[seen].mean() < 3.0  # grey levels: bilinear sampling of the first image, once


def test_a_view_from_behind_or_far_is_not_predicted() -> None:
    templates, point = stored(np.array((160.0, 120.0)), image_from(FIRST))
    drawn = np.empty((TEMPLATE_SIDE, TEMPLATE_SIDE), np.float32)
    for pose in (pose_at((0.0, 0.0, 3.0)), pose_at((0.0, 0.0, 0.2)), pose_at((0.9, 0.0, 0.15), (0.0, 1.2, 0.0))):
        assert not predict_appearance(CAMERA, templates, 0, pose, rotation_matrix(pose[3:]), point, True, drawn)


@pytest.mark.parametrize("step", [(0.0, 0.0), (0.004, 0.0015), (-0.0023, 0.0031), (0.0, -0.0052)])
def test_matches_are_good_to_a_twentieth_of_a_pixel(step) -> None:
    image = image_from(FIRST)
    pose = pose_at(tuple(FIRST[:3] + (*step, 0.0)))
    grey = image_from(pose).astype(np.float32)
    for pixel in new_corners(image, np.empty((0, 2)), 8, 20.0, 30, 1e-4):
        templates, point = stored(pixel, image)
        truth = pixel_of(pose, point)
        found = search(
            CAMERA, MODEL, templates, grey, pose, np.array([0]), point[None], truth[None] + 2.3, 4.0 * np.eye(2)[None]
        )
        assert found.state[0] == FOUND and found.score[0, 0] > 0.95
        assert np.abs(found.pixel[0, 0] - truth).max() < 0.05
        assert np.linalg.eigvalsh(found.R[0, 0]).min() >= MODEL.floor_std**2


def test_what_is_not_there_is_missing_and_what_is_too_vague_is_not_searched() -> None:
    pixel = np.array((160.0, 120.0))
    templates, point = stored(pixel, image_from(FIRST))
    empty = np.full((240, 320), 90, np.float32)
    for S, state in ((4.0, MISSING), (400.0, UNSEARCHED)):
        found = search(
            CAMERA, MODEL, templates, empty, FIRST, np.array([0]), point[None], pixel[None], S * np.eye(2)[None]
        )
        assert found.state[0] == state


def test_new_corners_keep_their_distance_and_go_where_there_are_few() -> None:
    image = image_from(FIRST)
    left = np.array([(x, y) for x in (40.0, 80.0, 120.0) for y in (40.0, 100.0, 160.0, 200.0)])
    found = new_corners(image, left, 6, 15.0, 15, 1e-4)
    assert len(found) == 6 and (found[:, 0] > 128).all()
    both = np.vstack((left, found))
    apart = np.abs(both[:, None] - both[None]).max(axis=-1) + 1e3 * np.eye(len(both))
    assert apart.min() >= 14.0
    assert new_corners(np.full((240, 320), 90, np.uint8), left, 6, 15.0, 15, 1e-4).shape == (0, 2)


@pytest.mark.parametrize("angle", [0.0, 0.4, 1.1])
def test_a_new_corner_is_where_the_edges_meet(angle) -> None:
    """The corners of a square: the place of greatest strength is up to 3 px away."""
    y, x = np.mgrid[:240, :320].astype(float)
    x, y = x - 160.2, y - 119.7
    a, b = np.cos(angle) * x + np.sin(angle) * y, np.cos(angle) * y - np.sin(angle) * x
    sides = np.clip(30.5 - np.abs(a), 0.0, 1.0) * np.clip(30.5 - np.abs(b), 0.0, 1.0)
    found = new_corners((60.0 + 140.0 * sides).astype(np.uint8), np.empty((0, 2)), 4, 15.0, 15, 1e-2)
    turn = np.array(((np.cos(angle), np.sin(angle)), (-np.sin(angle), np.cos(angle))))
    truth = np.array([(i, j) for i in (-30.0, 30.0) for j in (-30.0, 30.0)]) @ turn + (160.2, 119.7)
    assert len(found) == 4
    assert np.abs(found[:, None] - truth).max(axis=2).min(axis=1).max() <= 1.0


def test_an_edge_bears_no_feature_and_a_corner_does() -> None:
    """A wavy edge is a corner by its strength alone; along itself it is found nowhere in particular."""
    x, y = np.meshgrid(np.arange(320.0), np.arange(240.0))
    edge = np.clip(128.0 + 60.0 * (x - 160.0 - 1.5 * np.sin(y / 5.0)), 60.0, 200.0).astype(np.uint8)
    nothing = np.zeros((0, 2))
    assert len(new_corners(edge, nothing, 4, 13.0, 15, 4e-4)) == 4
    assert len(new_corners(edge, nothing, 4, 13.0, 15, 4e-4, 0.15)) == 0
    edge[100:140, 60:100] = 220
    found = new_corners(edge, nothing, 4, 13.0, 15, 4e-4, 0.15)
    meeting = np.array([(60, 100), (99, 100), (60, 139), (99, 139)])
    assert len(found) == 4
    assert all(np.abs(meeting - pixel).max(axis=1).min() <= 2 for pixel in found)
