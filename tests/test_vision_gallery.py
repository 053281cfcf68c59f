"""What the front end remembers of features, and which of them it gives up."""

import numpy as np
import pytest

pytest.importorskip("cv2", reason="the extra `vision` is not installed")

from activeslam_gym.camera import camera_of  # noqa: E402
from activeslam_gym.slam.association import DETECTION, REJECTED  # noqa: E402
from activeslam_gym.slam.sight import THING, Sight  # noqa: E402
from activeslam_gym.vision.gallery import Gallery  # noqa: E402
from activeslam_gym.vision.settings import FrontEndSettings  # noqa: E402

from .vision_scene import LENS, image_from, pose_at  # noqa: E402

CAMERA = camera_of(LENS.scenario())
SETTINGS = FrontEndSettings(trials=10, memory=0.9, least_success=0.5, most_residual=1.0)
PIXEL = np.array((160.0, 120.0))


@pytest.fixture(scope="module")
def grey() -> np.ndarray:
    return image_from(pose_at((0.0, 0.0, 0.7)), samples=1).astype(np.float32)


@pytest.fixture()
def gallery(grey) -> Gallery:
    """Features 7 and 8, and fiducial 0."""
    out = Gallery(CAMERA, SETTINGS, 4)
    for id in (7, 8, -1):
        out.hang(id, grey, PIXEL, pose_at((0.0, 0.0, 0.7)), np.zeros(3), 0)
    return out


def seen_at(gallery: Gallery, id: int, error: tuple[float, float]) -> None:
    """One match of ``id``, so far [px] from where the updated belief has it."""
    found = np.zeros(1, DETECTION)
    found["id"], found["match"], found["pixel"] = id, id, PIXEL + error
    thing = np.zeros(1, THING)
    thing["id"], thing["z_hat"] = id, PIXEL
    gallery.remember_residuals(found, Sight(thing, np.zeros((2, 12)), np.eye(2)))


def test_places_are_those_of_the_templates_and_are_used_again(gallery, grey) -> None:
    assert gallery.features == 2 and 7 in gallery and 9 not in gallery
    first = gallery.places([8, 9, 7])
    assert first[1] == -1 and gallery.templates.id[first[[0, 2]]].tolist() == [8, 7]
    gallery.remove(7)
    assert 7 not in gallery and gallery.features == 1
    gallery.hang(9, grey, PIXEL, pose_at((0.0, 0.0, 0.7)), np.zeros(3), 1)
    assert gallery.places([9])[0] == first[2]


def test_a_feature_that_is_missed_where_misses_tell_fails_after_so_many_trials(gallery) -> None:
    for frame in range(9):
        gallery.judge([7, 8, -1], {8}, {7, 8, -1}, frame)
        assert gallery.failed() == []
    for frame in (9, 10):  # rounding decides at which of the two
        gallery.judge([7, 8, -1], {8}, {7, 8, -1}, frame)
    assert gallery.failed() == [7], "8 is matched, and a fiducial is never judged"
    assert gallery.best(1) == [8]


def test_misses_at_the_images_edge_tell_nothing(gallery) -> None:
    for frame in range(30):
        gallery.judge([7, 8], {8}, {8}, frame)
    assert gallery.failed() == []


def test_a_feature_whose_pixels_stay_beside_the_belief_fails_and_one_that_shakes_does_not(gallery) -> None:
    for k in range(40):
        seen_at(gallery, 7, (1.3, 0.4))
        seen_at(gallery, 8, ((-1.0) ** k * 3.0, 0.0))
        seen_at(gallery, -1, (9.0, 0.0))
    assert gallery.failed() == [7]


def test_a_rejected_match_is_no_residual(gallery) -> None:
    for _ in range(40):
        found = np.zeros(1, DETECTION)
        found["id"], found["match"], found["pixel"] = 7, REJECTED, PIXEL + 9.0
        thing = np.zeros(1, THING)
        thing["id"], thing["z_hat"] = 7, PIXEL
        gallery.remember_residuals(found, Sight(thing, np.zeros((2, 12)), np.eye(2)))
    assert gallery.failed() == []


def test_the_longest_unseen_makes_room_unless_all_were_seen_of_late(gallery) -> None:
    gallery.judge([7], {7}, set(), 5)
    gallery.judge([8], {8}, set(), 3)
    assert gallery.longest_unseen(4) == 8
    assert gallery.longest_unseen(3) is None


def test_scouts_search_a_part_of_what_is_too_large_to_search() -> None:
    near, far = SETTINGS.search(scouting=False), SETTINGS.search(scouting=True)
    assert not near.shrink and near.largest_area == SETTINGS.largest_area
    assert far.shrink and far.largest_area == SETTINGS.scout_area


def test_new_looks_keep_the_record(gallery, grey) -> None:
    """The target is drawn anew as it is seen otherwise; what was often matched stays so."""
    gallery.judge([7, -1], {-1}, {7, -1}, 5)
    places, before = gallery.places([-1]), gallery.templates.patch[gallery.places([-1])].copy()
    gallery.hang(-1, grey[::-1].copy(), PIXEL, pose_at((0.1, 0.0, 0.7)), np.zeros(3), 6)
    assert gallery.places([-1]) == places and gallery.best(1) == [-1] and gallery.features == 2
    assert not np.array_equal(gallery.templates.patch[places], before)
    np.testing.assert_array_equal(gallery.templates.camera[places[0]], pose_at((0.1, 0.0, 0.7))[:7])
