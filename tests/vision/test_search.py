"""Templates and search against a ray-cast plane; corners; which features the front end deletes."""

import numpy as np
import pytest

pytest.importorskip("cv2", reason="the extra `vision` is not installed")

from activeslam_gym.kernels import filled
from activeslam_gym.slam.detection import DETECTION
from activeslam_gym.slam.sight import PREDICTED, Sight
from activeslam_gym.vision.corners import new_corners
from activeslam_gym.vision.search import SEARCH, Findings, search
from activeslam_gym.vision.settings import FrontEndSettings
from activeslam_gym.vision.templates import TEMPLATE_SIDE, TemplateMap, empty_templates, predict_appearance, store
from activeslam_gym.vision.views import projected, view_from
from tests.vision_scene import CAMERA, image_from, plane_points, pose_at, texture

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


@pytest.mark.parametrize("step", [(0.0, 0.0), (0.004, 0.0015), (-0.0023, 0.0031), (0.0, -0.0052)])
def test_matches_are_good_to_a_twentieth_of_a_pixel(step) -> None:
    image, pose = image_from(FIRST), pose_at(tuple(FIRST[:3] + (*step, 0.0)))
    now = image_from(pose)
    for pixel in new_corners(image, NOTHING, 8, 20.0, 30, 1e-4):
        templates, point = stored(pixel, image)
        truth = projected(CAMERA, pose, point[None])[0]
        found = searched(pose, templates, point, now, truth + 2.3, 4.0)
        assert found.peaks[0] > 0 and found.score[0, 0] > 0.95
        assert np.abs(found.pixel[0, 0] - truth).max() < 0.05
        assert np.linalg.eigvalsh(found.R[0, 0]).min() >= SETTINGS.floor_std**2


@pytest.mark.parametrize("pixel", [(100.0, 150.0), (160.0, 120.0), (230.0, 100.0)])
def test_the_plane_of_a_feature_is_learned_from_other_views(pixel) -> None:
    """It is seen first from the side, and taken to face the camera."""
    poses = [pose_at((0.5 - 0.05 * k, 0.1, 0.55), (0.0, 0.75 - 0.06 * k, 0.0)) for k in range(6)]
    settings, first = FrontEndSettings(fitted_every=0.05, grain=1.5), np.array(pixel)
    templates = TemplateMap(CAMERA, settings, 2)
    images = [image_from(pose).astype(np.float32) for pose in poses]
    templates.add(1, images[0], first, poses[0], np.zeros(3), 0)
    point, place = np.array((*plane_points(poses[0], first[:1], first[1:])[0], 0.0)), templates.places([1])
    angles = []
    for pose, image in zip(poses, images):
        z = projected(CAMERA, pose, point[None])
        templates.fit_planes(view_from(CAMERA, pose), image, place, point[None], z)
        normal = templates.templates.normal[0]
        angles.append(np.degrees(np.arccos(normal @ BEHIND / np.linalg.norm(normal))))
    assert angles[0] > 20.0 and angles[-1] < 3.0, angles


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


RECORD = FrontEndSettings(trials=10, most_residual=0.3)
PIXEL, HERE = np.array((160.0, 120.0)), pose_at((0.0, 0.0, 0.7))


@pytest.fixture(scope="module")
def grey() -> np.ndarray:
    return image_from(HERE, samples=1).astype(np.float32)


@pytest.fixture()
def gallery(grey) -> TemplateMap:
    """Features 7 and 8, and fiducial 0."""
    out = TemplateMap(CAMERA, RECORD, 4)
    for id in (7, 8, -1):
        out.add(id, grey, PIXEL, HERE, np.zeros(3), 0)
    return out


def searched_in(gallery: TemplateMap, matched: set[int], frame: int, inside: bool = True) -> None:
    """All three are searched in the ``frame``; a feature is missed well ``inside`` the image, or at its edge."""
    ids = np.array([7, 8, -1])
    gallery.judge(ids, np.isin(ids, list(matched)), np.full(3, inside), frame)


def seen_at(gallery: TemplateMap, id: int, error: tuple[float, float]) -> None:
    """One match of ``id``, so far [px] from where the updated estimate has it, with a noise of 0.1 px^2."""
    found, point = np.zeros(1, DETECTION), np.zeros(1, PREDICTED)
    found["R"], found["id"], found["match"], found["pixel"] = 0.1 * np.eye(2), id, id, PIXEL + error
    point["id"], point["z_hat"] = id, PIXEL
    gallery.remember_residuals(found, Sight(point, np.zeros((2, 12)), np.eye(2)))


def test_what_comes_back_into_sight_has_to_prove_itself_again(gallery) -> None:
    """Where something else hides a feature, an edge of that may look like it."""
    for frame in range(20):
        searched_in(gallery, {7, 8}, frame)
    for frame in range(20, 40):
        gallery.judge([8], np.array([frame % 9 > 0]), np.array([True]), frame)
    assert gallery.proven(gallery.places([7, 8])).tolist() == [True, True], "nothing has come back"
    searched_in(gallery, {7, 8}, 40)
    assert gallery.proven(gallery.places([7, 8])).tolist() == [False, True], "8 was never away for long"
    for frame in range(41, 50):
        searched_in(gallery, {7, 8}, frame)
    assert gallery.proven(gallery.places([7, 8])).tolist() == [True, True]


def test_a_feature_fails_after_so_many_misses_inside_the_image(gallery) -> None:
    for frame in range(30):
        searched_in(gallery, {8}, frame, inside=False)
    assert gallery.failed() == [], "misses at the edge tell nothing"
    for frame in range(30, 39):
        searched_in(gallery, {8}, frame)
        assert gallery.failed() == []
    for frame in (39, 40):  # rounding decides at which of the two
        searched_in(gallery, {8}, frame)
    assert gallery.failed() == [7], "8 is matched, and a fiducial is never judged"
    assert gallery.strayed == 0.0, "it was seldom found, and never where it should not be"


@pytest.mark.parametrize("others, failed", [((0.05, 0.02), [7]), ((0.15, 0.15), []), ((0.5, 0.5), [])])
def test_one_alone_that_is_beside_the_estimate_fails_and_not_all_together(grey, others, failed) -> None:
    """Where all are beside it, as before their depths are known, the estimate is at fault."""
    gallery = TemplateMap(CAMERA, RECORD, 4)
    for id in (7, 8, 9):
        gallery.add(id, grey, PIXEL, HERE, np.zeros(3), 0)
    for frame in range(60):
        for id, error in zip((7, 8, 9), (0.5, *others)):
            seen_at(gallery, id, (error, 0.0))
        gallery.judge([7, 8, 9], np.ones(3, bool), np.ones(3, bool), frame)
    assert gallery.failed() == failed
    assert gallery.strayed == pytest.approx(0.5 * len(failed), abs=0.01)
